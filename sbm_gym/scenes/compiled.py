"""Compiled scenes, ready for an agent, and where their worlds come from."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol, get_args

import mujoco
import numpy as np
from jaxtyping import Float, Int32

from labeling.core.errors import UsageError
from sbm_gym.detection.visibility import ObjectSurfaces, points_of_moved
from sbm_gym.rendering.base import Renderer
from sbm_gym.rendering.tables.looks import Looks
from sbm_gym.robot.body import AgentBody, BodyConfig, add_agent
from sbm_gym.scenes.profiles import WorldProfile
from sbm_gym.worlds.moving.motion_config import STILL, MotionConfig
from sbm_gym.worlds.moving.movers import moved_box
from sbm_gym.worlds.splits import Split
from sbm_gym.worlds.world import GEOM_GROUP_COLLISION, Arrangement, MovingStage, World, WorldContents

RENDERERS = ("auto", "rays", "gl")
SPLITS = get_args(Split)


class WorldSource(Protocol):
    """Something that knows scenes by name and builds them. Must survive pickling if given to an env's constructor."""

    @property
    def profile(self) -> WorldProfile:
        """What fits its worlds: body, strides, distances, picture sizes."""
        ...

    def scenes(self, split: str | None) -> tuple[str, ...]:
        """Names of the scenes of a split, of all scenes for None."""
        ...

    def canonical(self, scene: str | int) -> str:
        """The one name of a scene that someone asked for; sources may know more scenes than their splits hold.

        Raises:
            ValueError: if there is no such scene, naming those there are.
        """
        ...

    def build(self, scene: str) -> World:
        """Builds a scene; the same name gives the same world in every process."""
        ...


class WholeModel:
    """A scene's model with its meshes and textures, which pictures by OpenGL and from outside need, and its state."""

    def __init__(self, make: Callable[[], mujoco.MjModel]) -> None:
        """Makes nothing yet."""
        self._make, self._model, self._data = make, None, None

    def get(self) -> mujoco.MjModel:
        """The model, made when it is first asked for."""
        if self._model is None:
            self._model = self._make()
        return self._model

    def data(self) -> mujoco.MjData:
        """A state of the model, always the same one."""
        if self._data is None:
            self._data = mujoco.MjData(self.get())
        return self._data


@dataclass(frozen=True)
class Scene:
    """A compiled world with the agent in it."""

    name: str
    world: WorldContents
    model: mujoco.MjModel
    """What physics and poses need; may have boxes in place of meshes, and no textures."""
    data: mujoco.MjData
    body: AgentBody
    renderer: Renderer
    surfaces: ObjectSurfaces
    points_of_moved: Mapping[str, Float[np.ndarray, "k 3"]]
    """See ``ObjectSurfaces.rearranged``."""
    whole: WholeModel
    instance_of_geom: Int32[np.ndarray, "ngeom_plus_one"]
    """Instance id by geom id; the last entry, which index -1 (no geom) picks, is 0."""
    geoms_of_instance: dict[int, list[int]]
    """The drawn geoms of every object."""
    arrangement: Arrangement | None = None
    """Of this episode, if the world has a stage."""

    def for_episode(self, rng: np.random.Generator, motion: MotionConfig = STILL, seconds: float = 0.0) -> "Scene":
        """The scene as a new episode finds it: itself, or newly arranged if its world has a stage.

        Args:
            rng: draws the arrangement. What moves is drawn by a child of it, so that all else stays as it is without.
            motion: what moves.
            seconds: how long the episode lasts.

        Raises:
            UsageError: if things are to move in a world in which nothing can.
        """
        stage = self.world.stage
        if motion.is_any and not isinstance(stage, MovingStage):
            raise UsageError(f"nothing can move in scene {self.name!r}: its world has no stage with set_in_motion")
        if stage is None:
            return self
        arrangement = stage.arrange(rng)
        if motion.is_any:
            assert isinstance(stage, MovingStage)
            arrangement = stage.set_in_motion(arrangement, rng.spawn(1)[0], motion, seconds)
        arrangement.apply(self.model)
        # Takes the new poses of mocap bodies into the state.
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)
        world = replace(
            self.world, objects=arrangement.objects, navigable=arrangement.navigable, starts=arrangement.starts
        )
        surfaces = self.surfaces.rearranged(self.model, self.data, world.objects, self.points_of_moved)
        tables = _instance_tables(world, self.model)
        return replace(self, world=world, surfaces=surfaces, arrangement=arrangement, **tables)

    def moved(self, poses: Mapping[int, Float[np.ndarray, "4 4"]]) -> "Scene":
        """The scene after some of its objects have moved. State and surfaces follow them.

        Args:
            poses: object to world of each, by instance id; see ``Traffic.poses``.
        """
        for instance in self.world.objects:
            if instance.instance_id in poses:
                pose = poses[instance.instance_id]
                mocap = int(self.model.body_mocapid[self.model.body(instance.body_name).id])
                self.data.mocap_pos[mocap] = pose[:3, 3]
                mujoco.mju_mat2Quat(self.data.mocap_quat[mocap], pose[:3, :3].ravel())
        mujoco.mj_kinematics(self.model, self.data)
        objects = tuple(
            replace(one, box_3d=moved_box(one.box_3d, poses[one.instance_id])) if one.instance_id in poses else one
            for one in self.world.objects
        )
        surfaces = self.surfaces.rearranged(self.model, self.data, objects, self.points_of_moved)
        return replace(self, world=replace(self.world, objects=objects), surfaces=surfaces)

    def whole_model(self) -> mujoco.MjModel:
        """The model with all meshes and textures, as this episode has it; where it has to be made it takes a second."""
        model = self.whole.get()
        if self.arrangement is not None and model is not self.model:
            self.arrangement.apply(model)
        return model

    def whole_data(self) -> mujoco.MjData:
        """The state of the whole model in which everything stands as it does in ``data``."""
        model = self.whole_model()
        if model is self.model:
            return self.data
        data = self.whole.data()
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = self.data.qpos, self.data.mocap_pos, self.data.mocap_quat
        mujoco.mj_forward(model, data)
        return data


def compile_scene(name: str, world: World, renderer: str, body: BodyConfig, whole: bool = False) -> Scene:
    """Adds the agent to a world and makes everything that stepping through it needs.

    Args:
        name: name of the scene.
        world: a world that has no agent yet; its ``spec`` gets one.
        renderer: one of ``RENDERERS``.
        body: the agent's body.
        whole: whether the scene's model has meshes and textures though its renderer does without.
    """
    left_out = None if whole or renderer_kind(renderer) == "gl" else world.left_out
    if left_out is not None and left_out.is_in_spec:
        left_out = None
    spec = world.spec if left_out is None else world.bare
    add_agent(spec, body)
    model = spec.compile()
    looks = None if left_out is None else left_out.looks(model)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    surfaces = ObjectSurfaces.sampled(model, data, world.objects, world.name, looks=looks)
    moved = {} if world.stage is None else points_of_moved(model, data, looks)
    drawn = make_renderer(renderer, model, looks)
    whole_model = WholeModel((lambda: model) if looks is None else (lambda: world.spec.compile()))
    return assemble(name, world.contents, model, data, body, drawn, surfaces, moved, whole_model)


def assemble(
    name: str,
    world: WorldContents,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    body: BodyConfig,
    renderer: Renderer,
    surfaces: ObjectSurfaces,
    moved: Mapping[str, Float[np.ndarray, "k 3"]],
    whole: WholeModel,
) -> Scene:
    """A scene of its parts; arguments are its fields, but for ``moved``, which is ``points_of_moved``."""
    tables = _instance_tables(world, model)
    return Scene(name, world, model, data, AgentBody(model, data, body), renderer, surfaces, moved, whole, **tables)


def _instance_tables(world: WorldContents, model: mujoco.MjModel) -> dict[str, Any]:
    """Which object each geom belongs to, and which geoms each object has: fields of a ``Scene``."""
    instance_of_geom = world.instance_of_geom(model).astype(np.int32)
    drawn = model.geom_group < GEOM_GROUP_COLLISION
    return {
        "instance_of_geom": np.append(instance_of_geom, np.int32(0)),
        "geoms_of_instance": {
            instance.instance_id: np.flatnonzero(drawn & (instance_of_geom == instance.instance_id)).tolist()
            for instance in world.objects
        },
    }


def check_renderer(name: str) -> None:
    """Checks a renderer's name before anything is built.

    Raises:
        ValueError: if there is no such renderer, naming those there are.
    """
    if name not in RENDERERS:
        raise ValueError(f"unknown renderer {name!r}; known: {', '.join(RENDERERS)}")


def renderer_kind(name: str) -> str:
    """The renderer of that name: "rays" or "gl"; ``auto`` is ``gl`` where a GPU is, ``rays`` elsewhere.

    Raises:
        ValueError: if there is no such renderer, naming those there are.
    """
    check_renderer(name)
    if name == "auto":
        from sbm_gym.rendering.gl.context import gpu_available

        name = "gl" if gpu_available() else "rays"
    return name


def make_renderer(name: str, model: mujoco.MjModel, looks: Looks | None = None) -> Renderer:
    """The renderer of that name for one model; ``auto`` is ``gl`` where a GPU is, ``rays`` elsewhere.

    Args:
        name: one of ``RENDERERS``.
        model: the compiled model.
        looks: meshes and pictures, if the model was compiled without them, which is for ``rays`` only.

    Raises:
        ValueError: if there is no such renderer, naming those there are.
        NoOpenGlError: if ``gl`` is asked for and there is no OpenGL, saying what to install.
    """
    if renderer_kind(name) == "gl":
        from sbm_gym.rendering.gl.context import context_kind
        from sbm_gym.rendering.gl.renderer import GlRenderer

        context_kind()
        return GlRenderer(model)
    from sbm_gym.rendering.rays.renderer import RaysRenderer

    return RaysRenderer(model, shadows=True, looks=looks)
