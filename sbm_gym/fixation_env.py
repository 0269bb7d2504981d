"""The Gymnasium environment: an agent that moves around objects and looks at them."""

from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from jaxtyping import Float, Int32

from labeling.geometry import intrinsics_from_fov
from labeling.instances import Detection
from sbm_gym.agent_body import BodyConfig
from sbm_gym.object_memory import KnownObject, MemoryConfig, MemoryUpdate, ObjectMemory
from sbm_gym.observations import Situation, encode_depth, observation_space, state_names, state_vector
from sbm_gym.recording import Capture, ground_truth_of_view
from sbm_gym.rendering.base import Frame
from sbm_gym.rendering.third_person import AgentTrace, Find, ThirdPersonView
from sbm_gym.rewards import RewardWeights, reward_terms
from sbm_gym.scenes import SPLITS, Scene, SceneCache, WorldSource, check_renderer
from sbm_gym.simulated_detector import SimulatedDetector, SimulatedDetectorConfig, SimulatedView
from sbm_gym.viewer_window import ViewerWindow, check_screen, screen_available
from sbm_gym.world_sources import world_source
from sbm_gym.worlds.navigable import NavigableMap

DETECTORS = ("simulated",)
GAZES = ("fixate", "free")
RESET_OPTIONS = ("scene", "start", "reuse_scene")
NUM_VIEWS = 25
"""Views of an episode (thesis 5.1.1)."""


class FixationEnv(gym.Env, EzPickle):
    """A robot that looks for objects, fixates them and circles them.

    ## Description
    A round robot with an RGB-D camera 1.5 m above the floor stands somewhere in a furnished scene, or, with a camera
    at 1.65 m, near two vehicles in a street. (The values that differ are the world's `sbm_gym.profiles.WorldProfile`;
    those of streets are given in brackets.) Its detector is sure of objects in easy views only. The robot earns reward
    for finding objects that its detector is confident about, and for seeing these objects from many sides: from such
    views the label generator makes labels. One step is one move, one look and one detection. The robot knows what its
    own senses tell it (detector, depth, odometry); observations and rewards never use the simulator's ground truth.

    ## Action Space
    `Box(-1, 1, (4,), float32)`

    | | action | 1 means |
    |---|---|---|
    | 0 | forward | one stride (0.5 m [2.5 m]) to where the camera points |
    | 1 | left | one stride to the left of it |
    | 2 | gaze yaw, left is positive | with a fixation target: 45 degrees left of it; without: turn left by 60 degrees |
    | 3 | gaze pitch, up is positive | with a fixation target: 45 degrees above it; without: tilt up by 30 degrees |

    Moves longer than a stride are shortened to one. The robot moves first, in the frame of its heading before the step,
    then looks. Obstacles stop it or let it slide along. The fixation target is the first confirmed object (the most
    confident one of the first view that has any); offset zero keeps its estimated centroid in the middle of the
    picture. `env.unwrapped.fixate(object_id)` chooses another.

    ## Observation Space
    `Dict` of
    - `rgb`: `Box(0, 255, (84, 84, 3) [(64, 192, 3)], uint8)`, field of view 90 degrees across;
    - `depth`: `Box(0, 255, (84, 84, 1) [(64, 192, 1)], uint8)`, z-depth in levels of 4 cm [20 cm], 0 = no return;
    - `state`: `Box(-1, 1, (n,), float32)`: what the robot knows (target, candidate, time left, sectors covered, free
      space); `env.unwrapped.state_names` says what each entry means, `sbm_gym.observations.state_names` how they are
      scaled.

    ## Rewards
    The sum of the terms in `info["reward_terms"]` (weights: `sbm_gym.rewards.RewardWeights`):
    - `discovery`: +1 for an object confirmed for the first time (a detection with confidence >= 0.9 that is not near a
      known object), and up to +0.5 for raising the best confidence of a known one to 1;
    - `diversity`: +0.25 for each new 20 degree sector from which a confirmed object is seen, +0.05 for a new range or
      elevation within a known sector; only where depth says that nothing stands before the object;
    - `collision`: -0.1 if an obstacle cut the move short;
    - `step`: 0 by default.

    ## Starting State
    A scene of the split, a place where the robot can stand and a heading, all drawn evenly. In towns each episode
    places two vehicles where vehicles naturally stand and draws the weather; the robot starts 3 to 15 m from the first,
    and the map ends 24 m from it. Options of `reset`: `scene` (a name), `start` (`(x, y)` or `(x, y, yaw)`, metres and
    radians) and `reuse_scene` (stay in the current scene).

    ## Episode End
    Never terminated; truncated after 25 views (steps).

    ## Arguments
    - `worlds`: the name of a kind of world, or an object that builds them (`sbm_gym.scenes.WorldSource`).
    - `split`: "train", "val", "test" or None for all scenes.
    - `detector`: "simulated", or a `SimulatedDetectorConfig`. Steps run it on the picture of the observation, captures
      on the captured one.
    - `renderer`: "rays", "gl", or "auto": `gl` where a GPU is, `rays` elsewhere.
    - `image_size`: height and width of the observed pictures, pixels; like `memory`, `body`, `stride_m` and
      `render_size` from the world's profile if None.
    - `antialias`: smooth edges in observed pictures (captures and `render` always do).
    - `reward_weights`, `memory`, `body`: frozen dataclasses of settings.
    - `stride_m`: longest move of one step.
    - `gaze`: "fixate" (see above) or "free" (gaze actions always turn the camera).
    - `num_views`: steps of an episode; None takes `max_episode_steps` of the registered env, else 25. Episodes longer
      than that need `gym.make(..., num_views=n, max_episode_steps=n)`.
    - `episodes_per_scene`: without a seed, `reset` moves on to another scene after this many episodes.
    - `scene_cache`: how many scenes are kept in memory.
    - `render_mode`: "rgb_array" (what the robot sees), "depth_array" (metres, float32), "third_person" (the robot from
      above, with its path, its camera's frustum and what it has found), each at `render_size` pixels; or "human"
      (MuJoCo's viewer).

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
        detector: str | SimulatedDetectorConfig = "simulated",
        renderer: str = "auto",
        image_size: tuple[int, int] | None = None,
        antialias: bool = False,
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
    ) -> None:
        """Makes an environment; scenes are built when first needed. Arguments: see the class.

        Raises:
            ValueError: if an argument makes no sense, naming the alternatives.
        """
        EzPickle.__init__(**{name: value for name, value in locals().items() if name != "__class__"})
        if split is not None and split not in SPLITS:
            raise ValueError(f"unknown split {split!r}; known: {', '.join(SPLITS)}, or None for all scenes")
        if gaze not in GAZES:
            raise ValueError(f"unknown gaze {gaze!r}; known: {', '.join(GAZES)}")
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"unknown render_mode {render_mode!r}; known: {', '.join(self.metadata['render_modes'])}")
        if render_mode == "human":
            check_screen()
        elif not screen_available():
            # So that checkers and wrappers that try every mode of an env leave out what cannot work here.
            modes = [mode for mode in self.metadata["render_modes"] if mode != "human"]
            self.metadata = {**self.metadata, "render_modes": modes}
        if num_views is not None and num_views < 1:
            raise ValueError(f"num_views must be at least 1, not {num_views}")
        if stride_m is not None and not stride_m > 0.0:
            raise ValueError(f"stride_m must be positive, not {stride_m}")
        if episodes_per_scene < 1:
            raise ValueError(f"episodes_per_scene must be at least 1, not {episodes_per_scene}")
        check_renderer(renderer)
        self._source = world_source(worlds) if isinstance(worlds, str) else worlds
        self.profile = self._source.profile
        """What fits this kind of world: body, strides, distances, picture sizes."""
        self._detector = _make_detector(detector, self.profile.detector)
        self.scene_names = self._source.scenes(split)
        """Names of the scenes that ``reset`` draws from."""
        self._weights = reward_weights or RewardWeights()
        self._memory_config = memory or self.profile.memory
        self._bins = self._memory_config.bins
        self._size, self._antialias = image_size or self.profile.image_size, antialias
        self._stride_m = self.profile.stride_m if stride_m is None else stride_m
        self._gaze, self._num_views = gaze, num_views
        self._episodes_per_scene = episodes_per_scene
        self._cache = SceneCache(self._source, renderer, body or self.profile.body, scene_cache)
        self.render_mode, self._render_size = render_mode, render_size or self.profile.capture_size
        self.state_names = state_names(self._bins)
        """What the entries of the ``state`` observation mean."""
        self.action_space = spaces.Box(-1.0, 1.0, (4,), np.float32)
        self.observation_space = observation_space(*self._size, self._bins)
        self._scene: Scene | None = None
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
        options = dict(options or {})
        unknown = sorted(set(options) - set(RESET_OPTIONS))
        if unknown:
            raise ValueError(f"unknown reset option {unknown[0]!r}; known: {', '.join(RESET_OPTIONS)}")
        scene = self._choose_scene(options, seeded=seed is not None).for_episode(self.np_random)
        position_m, yaw_rad = self._choose_start(scene, options)
        self._scene = scene
        self._entropy = int(self.np_random.integers(2**62))
        self._step_index, self._collided, self._path_m = 0, False, 0.0
        self.memory = ObjectMemory(self._memory_config)
        """What the robot knows about objects."""
        self._target_id: int | None = None
        scene.body.place(position_m, yaw_rad, self.profile.rest_tilt_rad)
        self._origin_m = position_m
        self._places_m = [position_m]
        update = self._look()
        terms = dict.fromkeys(reward_terms(update, False, self._weights), 0.0)
        self._show_human()
        return self._observation(update), self._info(terms)

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Moves, looks, detects.

        Args:
            action: as the action space says; values beyond are clipped.

        Raises:
            ValueError: if the action is not four finite numbers.
            gymnasium.error.ResetNeeded: before the first ``reset``.
        """
        scene = self._current_scene()
        action = np.asarray(action, float)
        if action.shape != (4,) or not np.all(np.isfinite(action)):
            raise ValueError(f"an action is four finite numbers (forward, left, gaze yaw, gaze pitch), not {action}")
        action = np.clip(action, -1.0, 1.0)
        before = scene.body.position_m
        move = scene.body.move(self._displacement_m(action[:2], scene.body.yaw_rad))
        self._path_m += float(np.linalg.norm(scene.body.position_m - before))
        self._places_m.append(scene.body.position_m)
        self._collided = move.collided
        self._aim(action[2:])
        self._step_index += 1
        update = self._look()
        terms = reward_terms(update, move.collided, self._weights)
        # Made by gym.make without num_views, TimeLimit decides: it alone knows a max_episode_steps given there.
        truncated = self._step_index >= self.num_views and (self._num_views is not None or self.spec is None)
        self._show_human()
        return self._observation(update), float(sum(terms.values())), False, truncated, self._info(terms)

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
        frame, _, _ = self._draw(*self._render_size, antialias=self.render_mode == "rgb_array")
        return frame.rgb if self.render_mode == "rgb_array" else frame.depth_m

    def close(self) -> None:
        """Frees the scenes; ``reset`` builds them again."""
        self._window.close()
        if self._third_person is not None:
            self._third_person[1].close()
            self._third_person = None
        self._cache.clear()
        self._scene = None

    def _view_from_outside(self) -> np.ndarray:
        scene = self._current_scene()
        if self._third_person is None or self._third_person[0].model is not scene.model:
            if self._third_person is not None:
                self._third_person[1].close()
            view = ThirdPersonView(scene.model, self._cache.make_renderer, float(scene.body.camera_to_world[2, 3]))
            self._third_person = (scene, view)
        return self._third_person[1].draw(scene.data, self._trace(), *self._render_size)

    def _show_human(self) -> None:
        if self.render_mode == "human":
            scene = self._current_scene()
            self._window.show(scene.model, scene.data, self._trace())

    def _trace(self) -> AgentTrace:
        """What a picture from outside shows of the agent."""
        return AgentTrace(
            camera_to_world=self._current_scene().body.camera_to_world,
            intrinsics=self._intrinsics,
            picture_size_px=self._size,
            path_m=tuple(self._places_m),
            finds=tuple(
                Find(
                    known.centroid_m,
                    float(np.max(known.extent_m)),
                    f"{known.category} {known.best_confidence:.2f}",
                    known.object_id == self._target_id,
                )
                for known in self.memory.objects
            ),
        )

    # For policies and recorders ---------------------------------------------------------------------------------------

    @property
    def num_views(self) -> int:
        """Steps of an episode."""
        if self._num_views is not None:
            return self._num_views
        return (self.spec.max_episode_steps if self.spec is not None else None) or NUM_VIEWS

    @property
    def categories(self) -> tuple[str, ...]:
        """What the detector can say."""
        return self._detector.config.categories

    @property
    def stride_m(self) -> float:
        """Longest move of one step."""
        return self._stride_m

    @property
    def num_azimuths(self) -> int:
        """Into how many sectors the directions around an object are divided."""
        return self._bins.num_azimuths

    def azimuth_bin(self, azimuth_rad: float) -> int:
        """The sector of a direction from an object, counter-clockwise from +X."""
        return self._bins.azimuth_bin(azimuth_rad)

    @property
    def navigable(self) -> NavigableMap:
        """The map the robot navigates by."""
        return self._current_scene().world.navigable

    @property
    def scene(self) -> Scene:
        """The compiled scene, for tests and pictures; policies have no business here."""
        return self._current_scene()

    def fixate(self, object_id: int) -> None:
        """Makes another confirmed object the fixation target, from the next step on.

        Raises:
            ValueError: if no object with this id has been confirmed.
        """
        if not 0 <= object_id < len(self.memory.objects):
            raise ValueError(f"no confirmed object {object_id}; there are {len(self.memory.objects)}, counted from 0")
        self._target_id = object_id

    def capture(self, height_px: int | None = None, width_px: int | None = None) -> Capture:
        """A full frame of the current view. Changes nothing: the rollout goes on as if it had not been taken.

        Args:
            height_px: picture height; by default that of the world's profile, as is the width.
            width_px: picture width; the field of view is 90 degrees across.
        """
        scene = self._current_scene()
        height_px, width_px = height_px or self.profile.capture_size[0], width_px or self.profile.capture_size[1]
        frame, instance_map, intrinsics = self._draw(height_px, width_px, antialias=True)
        camera_to_world = scene.body.camera_to_world
        return Capture(
            rgb=frame.rgb,
            depth_m=frame.depth_m,
            intrinsics=intrinsics,
            camera_to_world=camera_to_world,
            detections=tuple(self._detect(frame, instance_map, intrinsics)),
            ground_truth=ground_truth_of_view(
                scene.world,
                scene.renderer,
                scene.data,
                instance_map,
                scene.geoms_of_instance,
                intrinsics,
                camera_to_world,
                self._step_index,
            ),
        )

    # Parts of a step --------------------------------------------------------------------------------------------------

    def _current_scene(self) -> Scene:
        if self._scene is None:
            raise gym.error.ResetNeeded("call reset() first: there is no scene yet")
        return self._scene

    def _choose_scene(self, options: dict[str, Any], seeded: bool) -> Scene:
        """The scene asked for, the current one while its episodes last, or one drawn from the split."""
        self._episodes_in_scene += 1
        stay = bool(options.get("reuse_scene", not seeded and self._episodes_in_scene <= self._episodes_per_scene))
        if "scene" in options:
            name = self._source.canonical(options["scene"])
        elif stay and self._scene is not None:
            return self._scene
        else:
            name = self.scene_names[int(self.np_random.integers(len(self.scene_names)))]
        self._episodes_in_scene = 1
        return self._cache.get(name)

    def _choose_start(self, scene: Scene, options: dict[str, Any]) -> tuple[Float[np.ndarray, "2"], float]:
        yaw_rad = float(self.np_random.uniform(-np.pi, np.pi))
        position_m = (scene.world.starts or scene.world.navigable).random_point(self.np_random)
        if options.get("start") is not None:
            start = np.asarray(options["start"], float)
            if start.shape not in ((2,), (3,)) or not np.all(np.isfinite(start)):
                raise ValueError(
                    f"option 'start' is (x, y) or (x, y, yaw) in metres and radians, not {options['start']}"
                )
            if not scene.world.navigable.is_free(start[:2]):
                free = scene.world.navigable.nearest_free(start[:2])
                raise ValueError(
                    f"option 'start': the robot cannot stand at ({start[0]:g}, {start[1]:g}); "
                    f"the nearest free place is ({free[0]:.2f}, {free[1]:.2f})"
                )
            position_m = start[:2]
            yaw_rad = float(start[2]) if len(start) == 3 else yaw_rad
        return position_m, yaw_rad

    def _displacement_m(self, forward_left: Float[np.ndarray, "2"], yaw_rad: float) -> Float[np.ndarray, "2"]:
        """World displacement of a move command, at most one stride long."""
        forward, left = forward_left / max(1.0, float(np.linalg.norm(forward_left)))
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        return self._stride_m * np.array([cos * forward - sin * left, sin * forward + cos * left])

    def _aim(self, yaw_pitch: Float[np.ndarray, "2"]) -> None:
        """Turns the camera: around the target's direction, or on from where it points."""
        body, target = self._current_scene().body, self._target
        if target is None or self._gaze == "free":
            body.look(
                body.yaw_rad + yaw_pitch[0] * np.deg2rad(60.0),
                body.tilt_rad + yaw_pitch[1] * np.deg2rad(30.0),
            )
            return
        offset = target.centroid_m - body.camera_to_world[:3, 3]
        yaw_rad = float(np.arctan2(offset[1], offset[0]))
        tilt_rad = float(np.arctan2(offset[2], np.hypot(offset[0], offset[1])))
        body.look(yaw_rad + yaw_pitch[0] * np.deg2rad(45.0), tilt_rad + yaw_pitch[1] * np.deg2rad(45.0))

    @property
    def _target(self) -> KnownObject | None:
        return None if self._target_id is None else self.memory.objects[self._target_id]

    def _look(self) -> MemoryUpdate:
        """Draws what the robot sees now, detects, and lets the memory learn from it."""
        scene = self._current_scene()
        frame, instance_map, intrinsics = self._draw(*self._size, antialias=self._antialias)
        self._frame = frame
        self._intrinsics = intrinsics
        self._detections = self._detect(frame, instance_map, intrinsics)
        update = self.memory.observe(self._detections, frame.depth_m, intrinsics, scene.body.camera_to_world)
        if self._target_id is None and self.memory.objects:
            self._target_id = 0
        return update

    def _draw(
        self, height_px: int, width_px: int, antialias: bool
    ) -> tuple[Frame, Int32[np.ndarray, "h w"], Float[np.ndarray, "3 3"]]:
        scene = self._current_scene()
        intrinsics = intrinsics_from_fov(width_px, height_px, 0.5 * np.pi)
        frame = scene.renderer.render(
            scene.data, intrinsics, scene.body.camera_to_world, height_px, width_px, antialias=antialias
        )
        return frame, scene.instance_of_geom[frame.geom_id], intrinsics

    def _detect(self, frame: Frame, instance_map: Int32[np.ndarray, "h w"], intrinsics) -> list[Detection]:
        """Detections in a frame. Noise belongs to the step, so that looking twice at one view gives one answer."""
        scene = self._current_scene()
        view = SimulatedView(
            view_index=self._step_index,
            instance_map=instance_map,
            depth_m=frame.depth_m,
            objects=tuple(scene.surfaces.observe(instance_map, intrinsics, scene.body.camera_to_world)),
        )
        return self._detector.detect(np.random.default_rng([self._entropy, self._step_index]), view)

    # What the step returns --------------------------------------------------------------------------------------------

    def _observation(self, update: MemoryUpdate) -> dict[str, np.ndarray]:
        scene, target = self._current_scene(), self._target
        body = scene.body
        situation = Situation(
            position_m=body.position_m,
            yaw_rad=body.yaw_rad,
            tilt_rad=body.tilt_rad,
            camera_m=body.camera_to_world[:3, 3],
            target=target,
            target_visible=target is not None and target.object_id in update.visible,
            target_confidence_now=0.0 if target is None else update.confidence_now.get(target.object_id, 0.0),
            candidate=update.candidate,
            num_confirmed=len(self.memory.objects),
            collided=self._collided,
            time_left=max(0.0, 1.0 - self._step_index / self.num_views),
        )
        self._visible = update.visible
        return {
            "rgb": self._frame.rgb.copy(),
            "depth": encode_depth(self._frame.depth_m, self.profile.scales.depth_level_m),
            "state": state_vector(situation, self._bins, scene.world.navigable, self.profile.scales),
        }

    def _info(self, terms: dict[str, float]) -> dict[str, Any]:
        scene, target = self._current_scene(), self._target
        known = [self._describe(known) for known in self.memory.objects]
        return {
            "scene": scene.name,
            "detections": list(self._detections),
            "fixation_target": {} if target is None else self._describe(target),
            "confirmed_objects": known,
            "reward_terms": terms,
            "agent": {
                "position_m": scene.body.position_m,
                "yaw_rad": scene.body.yaw_rad,
                "tilt_rad": scene.body.tilt_rad,
                "camera_to_world": scene.body.camera_to_world,
                "intrinsics": self._intrinsics.copy(),
            },
            "collided": self._collided,
            "is_success": bool(known),
            "coverage": max((len(k.azimuths) for k in self.memory.objects), default=0) / self._bins.num_azimuths,
            "path_length_m": self._path_m,
        }

    def _describe(self, known: KnownObject) -> dict[str, Any]:
        """A known object as ``info`` shows it."""
        return {
            "object_id": known.object_id,
            "category": known.category,
            "best_confidence": known.best_confidence,
            "centroid_m": known.centroid_m.copy(),
            "extent_m": known.extent_m,
            "visible": known.object_id in self._visible,
            "azimuths": sorted(known.azimuths),
        }


def _make_detector(detector: str | SimulatedDetectorConfig, fitting: SimulatedDetectorConfig) -> SimulatedDetector:
    if isinstance(detector, SimulatedDetectorConfig):
        return SimulatedDetector(detector)
    if detector not in DETECTORS:
        raise ValueError(f"unknown detector {detector!r}; known: {', '.join(DETECTORS)}, or a SimulatedDetectorConfig")
    return SimulatedDetector(fitting)
