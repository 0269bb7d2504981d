"""The Gymnasium environment: an agent that moves around objects and looks at them."""

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from jaxtyping import Float

from sbm_gym.atlas.scene_atlas import AtlasKey
from sbm_gym.detection.simulated import SimulatedDetectorConfig
from sbm_gym.env import observations
from sbm_gym.env.arguments import (
    check_body,
    check_choices,
    check_numbers,
    check_sizes,
    checked_action,
    checked_options,
    checked_start,
)
from sbm_gym.env.atlases import Atlases
from sbm_gym.env.recording import Capture
from sbm_gym.env.rewards import Reward, RewardWeights, evidence_terms, reward_terms
from sbm_gym.env.simulation import Simulation, SimulationConfig
from sbm_gym.env.state_vector import state_names
from sbm_gym.env.view_detectors import make_detector
from sbm_gym.env.viewer_window import ViewerWindow, check_screen, screen_available
from sbm_gym.registration import MAX_EPISODE_STEPS
from sbm_gym.robot.body import BodyConfig
from sbm_gym.robot.knowledge import RobotKnowledge
from sbm_gym.robot.object_memory import MemoryConfig
from sbm_gym.scenes.compiled import Scene, WorldSource, check_renderer
from sbm_gym.scenes.scene_cache import SceneCache
from sbm_gym.scenes.third_person import ThirdPersonView
from sbm_gym.scenes.world_sources import world_source
from sbm_gym.worlds.geometry.placing import obstacle_rows
from sbm_gym.worlds.moving.motion_config import MotionConfig


class FixationEnv(gym.Env, EzPickle):
    """A robot that looks for objects, fixates them and circles them.

    ## Description
    A round robot with an RGB-D camera 1.5 m above the floor stands somewhere in a furnished scene, or, with a camera
    at 1.65 m, near two vehicles in a street. (The values that differ are the world's
    `sbm_gym.scenes.profiles.WorldProfile`; those of streets are given in brackets.) Its detector is sure of objects in
    easy views only. The robot earns reward for finding objects that its detector is confident about, and for seeing
    these objects from many sides: from such views the label generator makes labels. One step is one move, one look and
    one detection. The robot is given a complete map of where it can stand, rooms that it has not seen included, exact
    as the simulator has it. What there is, and which floor has been seen, it knows from its own senses (detector,
    depth, odometry). Observations and rewards use no other ground truth.

    ## Action Space
    `Box(-1, 1, (4,), float32)`

    | | action | 1 means |
    |---|---|---|
    | 0 | forward | one stride (0.5 m [2.5 m]) to where the camera points |
    | 1 | left | one stride to the left of it |
    | 2 | gaze yaw, left is positive | with a fixation target: half a turn from it; without: turn left by 60 degrees |
    | 3 | gaze pitch, up is positive | with a fixation target: 45 degrees above it; without: tilt up by 30 degrees |

    Moves longer than a stride are shortened to one. The robot moves first, in the frame of its heading before the step,
    then looks. Obstacles stop it or let it slide along. With a fixation target, gaze actions of zero keep its estimated
    centroid in the middle of the picture; a gaze yaw of a is 45 a + 135 a^3 degrees from it (0.1 is 4.6 degrees, 0.5 is
    39). The fixation target is at first the first confirmed object (the most confident one of the first view that has
    any); another visible one takes its place once it is nearer to the middle of the picture by 10 degrees.
    `env.unwrapped.knowledge.fixate(object_id)` chooses one outright.

    ## Observation Space
    `Dict` of
    - `rgb`: `Box(0, 255, (84, 84, 3) [(64, 192, 3)], uint8)`, field of view 90 degrees across;
    - `depth`: `Box(0, 255, (84, 84, 1) [(64, 192, 1)], uint8)`, z-depth in levels of 4 cm [20 cm], 0 = no return;
    - `state`: `Box(-1, 1, (n,), float32)`: what the robot knows (target, other objects, sectors covered, candidates,
      time left, free and unseen floor around it); `env.unwrapped.state_names` says what each entry means,
      `sbm_gym.env.state_vector.state_names` how they are scaled.

    ## Rewards
    The sum of the terms in `info["reward_terms"]` (weights: `sbm_gym.env.rewards.RewardWeights`):
    - `discovery`: +1 for an object confirmed for the first time (a detection with confidence >= 0.9 that is not near a
      known object), and up to +0.5 for raising the best confidence of a known one to 1;
    - `diversity`: +0.25 for each new 20 degree sector from which a confirmed object is seen, +0.05 for a new range or
      elevation within a known sector; only where depth says that nothing stands before the object;
    - `collision`: -0.1 if an obstacle cut the move short;
    - `step`: 0 by default.

    With `reward="evidence"` looks are paid by what they are for, in other terms:
    - `labels`: +0.1 for each label more that may be expected to be right: for every thing that the detector has pointed
      at, sure or not, the chance that it is what it is called, from all looks at it
      (`labeling.generator.objects.object_posterior`), times the number of views that show it, n views from one place
      counting as n to the power of 0.8. What the sum loses is taken away;
    - `discovery`: +0.5 for a thing whose chance reaches one half for the first time, times the share of views left;
    - `collision`, `step`: as above.

    ## Starting State
    A scene of the split, a place where the robot can stand and a heading, all drawn evenly. In towns each episode
    places two vehicles where vehicles naturally stand and draws the weather; the robot starts 3 to 15 m from the first,
    and the map ends 24 m from it. Options of `reset`: `scene` (a name), `start` (`(x, y)` or `(x, y, yaw)`, metres and
    radians) and `reuse_scene` (stay in the current scene).

    ## Episode End
    Never terminated; truncated after 25 views (steps).

    ## Arguments
    - `worlds`: the name of a kind of world, or an object that builds them (`sbm_gym.scenes.compiled.WorldSource`).
    - `split`: "train", "val", "test" (the thesis' 15, 1 and 2 interiors, 3, 1 and 1 towns), "wide" (40 more
      interiors or 12 more towns to test on), "final" (as many again, for the last test of a release), "endless"
      (100,000 others to learn from), or None for all of the thesis'.
    - `unseen_models`: keep the furniture and vehicle models that validation and test scenes show out of all other
      scenes, and furnish final ones from them alone, so that testing is on models never seen in training. Only with a
      name as `worlds`.
    - `detector`: "simulated", "simulated_weak" (as seldom sure as a small real one, some episodes more, some less),
      "simulated:compact" (fitted to what `compact` says), a `SimulatedDetectorConfig`, or a real one by a
      name that `labeling.detectors.registry` knows ("compact", the folder of a fine-tuning run, ...). At every step a
      simulated one looks at the picture of the observation, a real one at a picture of `detector_size` with smooth
      edges; captures run it on the captured picture.
    - `detector_size`: height and width of that picture, pixels; by default that of captures.
    - `renderer`: "rays", "gl", or "auto": `gl` where a GPU is, `rays` elsewhere.
    - `image_size`: height and width of the observed pictures, pixels; like `memory`, `body`, `stride_m` and
      `render_size` from the world's profile if None.
    - `antialias`: smooth edges in observed pictures (captures and `render` always do).
    - `colours`: False leaves observed pictures black and saves the time it takes to light them, for policies that look
      at none (the simulated detector does not either).
    - `atlas`: a folder of `python -m sbm_gym.build_atlas`: the robot keeps to the places and headings of the atlas,
      its camera to one tilt, and what it sees is looked up: pictures are black, depth is true to a millimetre, and a
      real detector costs no more than a look at a file. Scenes are those of the split that the folder holds. Rooms
      only.
    - `reward`: "views" or "evidence", see above.
    - `reward_weights`, `memory`, `body`: frozen dataclasses of settings.
    - `stride_m`: longest move of one step.
    - `gaze`: "fixate" (see above) or "free" (gaze actions always turn the camera).
    - `num_views`: steps of an episode; None takes `max_episode_steps` of the registered env, else 25. Episodes longer
      than that need `gym.make(..., num_views=n, max_episode_steps=n)`; shorter ones `num_views=n` alone, since with
      `max_episode_steps=n` alone the robot counts on more views than there are.
    - `episodes_per_scene`: without a seed, `reset` moves on to another scene after this many episodes.
    - `scene_cache`: how many scenes are kept in memory. Those that come with sbm_gym are kept on disk, too, once any
      process has compiled them (`SBM_SCENE_CACHE`: how many GB of them, or "off").
    - `render_mode`: "rgb_array" (what the robot sees), "depth_array" (metres, float32), "third_person" (the robot from
      above, with its path, its camera's frustum and what it has found); or "human" (MuJoCo's viewer).
    - `render_size`: height and width of what `render` returns, pixels.
    - `moving`: so many things move while the robot does, at most: vehicles that drive along lanes and turn, chairs and
      other furniture carried through rooms. They set out anew in every episode, wait for the robot and for each other,
      and stop the robot like any obstacle; its map does not have them. A step takes as long as a full stride does
      (0.4 s [0.83 s]). Observations and rewards are as without.
    - `shifted`: so many pieces of furniture stand elsewhere than in the last episode in the same scene, at most. Rooms
      only.
    - `moving_speed`: a factor of the speed of what moves; with 0 the same things stand where they would have set out.

    ## Version History
    - v0: initial version.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "render_modes": ["rgb_array", "depth_array", "third_person", "human"],
        "render_fps": 5,
    }

    def __init__(
        self,
        worlds: str | WorldSource = "indoor",
        split: str | None = "train",
        unseen_models: bool = False,
        detector: str | SimulatedDetectorConfig = "simulated",
        detector_size: tuple[int, int] | None = None,
        renderer: str = "auto",
        image_size: tuple[int, int] | None = None,
        antialias: bool = False,
        colours: bool = True,
        atlas: str | Path | None = None,
        reward: Reward = "views",
        reward_weights: RewardWeights | None = None,
        memory: MemoryConfig | None = None,
        body: BodyConfig | None = None,
        stride_m: float | None = None,
        gaze: str = "fixate",
        num_views: int | None = None,
        episodes_per_scene: int = 1,
        scene_cache: int = 3,
        render_mode: str | None = None,
        render_size: tuple[int, int] | None = None,
        moving: int = 0,
        shifted: int = 0,
        moving_speed: float = 1.0,
    ) -> None:
        """Makes an environment; scenes are built when first needed. Arguments: see the class.

        Raises:
            ValueError: if an argument makes no sense, naming the alternatives.
        """
        EzPickle.__init__(**{name: value for name, value in locals().items() if name != "__class__"})
        check_choices(split, gaze, reward, render_mode, self.metadata["render_modes"])
        check_numbers(num_views, stride_m, episodes_per_scene)
        check_sizes(image_size=image_size, detector_size=detector_size, render_size=render_size)
        check_renderer(renderer)
        if render_mode == "human":
            check_screen()
        elif not screen_available():
            # So that checkers and wrappers that try every mode of an env leave out what cannot work here.
            modes = [mode for mode in self.metadata["render_modes"] if mode != "human"]
            self.metadata = {**self.metadata, "render_modes": modes}
        self._motion = MotionConfig(moving, shifted, moving_speed)
        if atlas is not None and self._motion.is_any:
            raise ValueError("an atlas holds views of scenes in which nothing moves: leave out atlas, or what moves")
        self._source = world_source(worlds, unseen_models, movable=self._motion.is_any)
        self.profile = self._source.profile
        """What fits this kind of world: body, strides, distances, picture sizes."""
        check_body(body or self.profile.body)
        self._detector = make_detector(detector, self.profile, load=atlas is None)
        self._reward, self._weights = reward, reward_weights or RewardWeights()
        robot = replace(
            self.profile,
            body=body or self.profile.body,
            memory=memory or self.profile.memory,
            stride_m=stride_m or self.profile.stride_m,
        )
        self._config = SimulationConfig(
            robot=robot,
            image_size=image_size or self.profile.image_size,
            antialias=antialias,
            colours=colours,
            detector_size=detector_size or self.profile.capture_size,
            gaze=gaze,
        )
        self._num_views, self._episodes_per_scene = num_views, episodes_per_scene
        # MuJoCo's viewer shows the very model that moves, which is then the one with all textures and meshes.
        self._cache = SceneCache(self._source, renderer, robot.body, scene_cache, on_disk=render_mode != "human")
        self._atlases = Atlases(None if atlas is None else Path(atlas), self._config, detector)
        self.scene_names = self._atlases.held(self._source.scenes(split))
        """Names of the scenes that ``reset`` draws from."""
        self.render_mode, self._render_size = render_mode, render_size or self.profile.capture_size
        self.state_names = state_names(robot.memory.bins)
        """What the entries of the ``state`` observation mean."""
        self.action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)
        self.observation_space = observations.observation_space(*self._config.image_size, robot.memory.bins)
        self._simulation: Simulation | None = None
        self._third_person: tuple[Scene, ThirdPersonView] | None = None
        self._window = ViewerWindow()
        self._episodes_in_scene = 0

    # The gymnasium interface ------------------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Starts an episode.

        Args:
            seed: makes everything that follows reproducible; None goes on with the current generator.
            options: see "Starting State" of the class.

        Raises:
            ValueError: if an option or scene is unknown, naming the alternatives, or the start is not free.
        """
        super().reset(seed=seed)
        options = checked_options(options)
        seconds = self.num_views * self._config.robot.step_s
        chosen = self._choose_scene(options, seeded=seed is not None)
        scene = chosen.for_episode(self.np_random, self._motion, seconds)
        position_m, yaw_rad = self._choose_start(scene, options)
        entropy = int(self.np_random.integers(2**62))
        atlas = self._atlases.of_scene(scene)
        self._simulation = Simulation(
            scene, self._config, self._detector, entropy, position_m, yaw_rad, self.num_views, atlas
        )
        terms = dict.fromkeys(self._terms(self._simulation), 0.0)
        self._show_human()
        observation = observations.observation(self._simulation, self.profile.scales)
        return observation, observations.info(self._simulation, terms)

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Moves, looks, detects.

        Args:
            action: as the action space says; values beyond are clipped.

        Raises:
            ValueError: if the action is not four finite numbers.
            gymnasium.error.ResetNeeded: before the first ``reset``.
        """
        simulation = self.simulation
        simulation.act(checked_action(action))
        terms = self._terms(simulation)
        # Made by gym.make without num_views, TimeLimit decides: it alone knows a max_episode_steps given there.
        truncated = simulation.step_index >= self.num_views and (self._num_views is not None or self.spec is None)
        self._show_human()
        observation = observations.observation(simulation, self.profile.scales)
        return observation, float(sum(terms.values())), False, truncated, observations.info(simulation, terms)

    def render(self) -> np.ndarray | None:
        """The current view, without aliasing, as ``render_mode`` says; None if there is none, or it is a window."""
        if self.render_mode is None:
            gym.logger.warn("render() needs a render_mode; pass render_mode='rgb_array' to gym.make")
            return None
        if self.render_mode == "human":
            self._show_human()
            return None
        if self.render_mode == "third_person":
            return self._view_from_outside()
        frame = self.simulation.draw(*self._render_size, antialias=self.render_mode == "rgb_array").frame
        return frame.rgb if self.render_mode == "rgb_array" else frame.depth_m

    def close(self) -> None:
        """Frees the scenes; ``reset`` builds them again."""
        self._window.close()
        if self._third_person is not None:
            self._third_person[1].close()
            self._third_person = None
        self._cache.clear()
        self._simulation = None

    # For policies and recorders ---------------------------------------------------------------------------------------

    @property
    def num_views(self) -> int:
        """Steps of an episode."""
        if self._num_views is not None:
            return self._num_views
        # What gym.make gives to an environment no longer says it: TimeLimit, around it, counts the steps.
        registered = None if self.spec is None else gym.registry.get(self.spec.id)
        return (None if registered is None else registered.max_episode_steps) or MAX_EPISODE_STEPS

    @property
    def categories(self) -> tuple[str, ...]:
        """What the detector can say."""
        return self._detector.categories

    @property
    def knowledge(self) -> RobotKnowledge:
        """What a policy may ask of the robot in this episode, typed and without the simulator's ground truth."""
        return self.simulation.robot

    @property
    def scene(self) -> Scene:
        """The compiled scene, for tests and pictures; policies have no business here."""
        return self.simulation.scene

    @property
    def simulation(self) -> Simulation:
        """The running episode with all that the simulator knows, for tests and recorders; policies ask ``knowledge``.

        Raises:
            gymnasium.error.ResetNeeded: before the first ``reset``.
        """
        if self._simulation is None:
            raise gym.error.ResetNeeded("call reset() first: there is no scene yet")
        return self._simulation

    def atlas_key(self) -> AtlasKey:
        """What an atlas of the current scene depends on; see ``sbm_gym.build_atlas``.

        Raises:
            UsageError: if scenes of this kind cannot have one.
        """
        return self._atlases.key(self.scene)

    def capture(self, height_px: int | None = None, width_px: int | None = None) -> Capture:
        """A full frame of the current view. Changes nothing: the rollout goes on as if it had not been taken.

        Args:
            height_px: picture height; by default that of the world's profile, as is the width.
            width_px: picture width; the field of view is 90 degrees across.
        """
        height, width = self.profile.capture_size
        return self.simulation.capture(height_px or height, width_px or width)

    # Parts of the above -----------------------------------------------------------------------------------------------

    def _terms(self, simulation: Simulation) -> dict[str, float]:
        """Of the reward for the latest step."""
        if self._reward == "views":
            return reward_terms(simulation.update, simulation.collided, self._weights)
        left = max(0.0, 1.0 - simulation.step_index / simulation.num_views)
        return evidence_terms(simulation.robot.beliefs.update, simulation.collided, left, self._weights)

    def _choose_scene(self, options: dict[str, Any], seeded: bool) -> Scene:
        """The scene asked for, the current one while its episodes last, or one drawn from the split."""
        self._episodes_in_scene += 1
        stay = bool(options.get("reuse_scene", not seeded and self._episodes_in_scene <= self._episodes_per_scene))
        if "scene" in options:
            name = self._source.canonical(options["scene"])
        elif stay and self._simulation is not None:
            return self._simulation.scene
        else:
            name = self.scene_names[int(self.np_random.integers(len(self.scene_names)))]
        self._episodes_in_scene = 1
        return self._cache.get(name)

    def _choose_start(self, scene: Scene, options: dict[str, Any]) -> tuple[Float[np.ndarray, "2"], float]:
        yaw_rad = float(self.np_random.uniform(-np.pi, np.pi))
        position_m = (scene.world.starts or scene.world.navigable).random_point(self.np_random)
        if options.get("start") is None:
            return position_m, yaw_rad
        movers = () if scene.arrangement is None else scene.arrangement.movers
        taken = obstacle_rows(one.box(0.0) for one in movers)
        start = checked_start(options["start"], scene.world.navigable.without(taken))
        return start[:2], float(start[2]) if len(start) == 3 else yaw_rad

    def _view_from_outside(self) -> np.ndarray:
        scene = self.scene
        if self._third_person is None or self._third_person[0].model is not scene.model:
            if self._third_person is not None:
                self._third_person[1].close()
            height_m = float(scene.body.camera_to_world[2, 3])
            view = ThirdPersonView(scene.whole_model(), self._cache.make_renderer, height_m)
            self._third_person = (scene, view)
        drawn, view = self._third_person
        if scene.arrangement is not None and scene.arrangement is not drawn.arrangement:
            view.arrange(scene.arrangement)
            self._third_person = (scene, view)
        return view.draw(scene.whole_data(), self.simulation.trace(), *self._render_size)

    def _show_human(self) -> None:
        if self.render_mode == "human":
            self._window.show(self.scene.model, self.scene.data, self.simulation.trace())
