"""Compiled scenes, ready for an agent: where worlds come from, and a small cache of those in use."""

from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Any, Protocol

import mujoco
import numpy as np
from jaxtyping import Int32

from sbm_gym.detection.visibility import ObjectSurfaces
from sbm_gym.rendering.base import Renderer
from sbm_gym.robot.body import AgentBody, BodyConfig, add_agent
from sbm_gym.scenes.profiles import WorldProfile
from sbm_gym.worlds.world import GEOM_GROUP_COLLISION, World

RENDERERS = ("auto", "rays", "gl")
SPLITS = ("train", "val", "test", "wide", "endless")


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


@dataclass(frozen=True)
class Scene:
    """A compiled world with the agent in it."""

    name: str
    world: World
    """Its ``spec`` is empty: what a model was compiled from takes as much memory as the model, and is done with."""
    model: mujoco.MjModel
    data: mujoco.MjData
    body: AgentBody
    renderer: Renderer
    surfaces: ObjectSurfaces
    instance_of_geom: Int32[np.ndarray, "ngeom_plus_one"]
    """Instance id by geom id; the last entry, which index -1 (no geom) picks, is 0."""
    geoms_of_instance: dict[int, list[int]]
    """The drawn geoms of every object."""

    def for_episode(self, rng: np.random.Generator) -> "Scene":
        """The scene as a new episode finds it: itself, or newly arranged if its world has a stage."""
        if self.world.stage is None:
            return self
        arrangement = self.world.stage.arrange(rng)
        arrangement.apply(self.model)
        # Takes the new poses of mocap bodies into the state.
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)
        world = replace(
            self.world, objects=arrangement.objects, navigable=arrangement.navigable, starts=arrangement.starts
        )
        surfaces = ObjectSurfaces(self.model, self.data, world.objects, world.name, reuse=self.surfaces)
        return replace(self, world=world, surfaces=surfaces, **_instance_tables(world, self.model))


def compile_scene(name: str, world: World, renderer: str, body: BodyConfig) -> Scene:
    """Adds the agent to a world and makes everything that stepping through it needs.

    Args:
        name: name of the scene.
        world: a world that has no agent yet; its ``spec`` gets one.
        renderer: one of ``RENDERERS``.
        body: the agent's body.
    """
    add_agent(world.spec, body)
    model = world.spec.compile()
    world = replace(world, spec=mujoco.MjSpec())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return Scene(
        name=name,
        world=world,
        model=model,
        data=data,
        body=AgentBody(model, data, body),
        renderer=make_renderer(renderer, model),
        surfaces=ObjectSurfaces(model, data, world.objects, world.name),
        **_instance_tables(world, model),
    )


def _instance_tables(world: World, model: mujoco.MjModel) -> dict[str, Any]:
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


def make_renderer(name: str, model: mujoco.MjModel) -> Renderer:
    """The renderer of that name for one model; ``auto`` is ``gl`` where a GPU is, ``rays`` elsewhere.

    Raises:
        ValueError: if there is no such renderer, naming those there are.
        NoOpenGlError: if ``gl`` is asked for and there is no OpenGL, saying what to install.
    """
    check_renderer(name)
    if name == "auto":
        from sbm_gym.rendering.gl.context import gpu_available

        name = "gl" if gpu_available() else "rays"
    if name == "gl":
        from sbm_gym.rendering.gl.context import context_kind
        from sbm_gym.rendering.gl.renderer import GlRenderer

        context_kind()
        return GlRenderer(model)
    from sbm_gym.rendering.rays.renderer import RaysRenderer

    return RaysRenderer(model, shadows=True)


class SceneCache:
    """Keeps the scenes used last, because building one takes about as long as an episode."""

    def __init__(self, source: WorldSource, renderer: str, body: BodyConfig, capacity: int) -> None:
        """Starts empty.

        Args:
            source: where worlds come from.
            renderer: one of ``RENDERERS``.
            body: the agent's body.
            capacity: how many scenes are kept, at least 1.
        """
        if capacity < 1:
            raise ValueError(f"a scene cache holds at least 1 scene, not {capacity}")
        self._source, self._renderer, self._body, self._capacity = source, renderer, body, capacity
        self._scenes: OrderedDict[str, Scene] = OrderedDict()

    def get(self, name: str) -> Scene:
        """The scene of that name, built if it is not at hand."""
        if name not in self._scenes:
            while len(self._scenes) >= self._capacity:
                _, oldest = self._scenes.popitem(last=False)
                oldest.renderer.close()
            self._scenes[name] = compile_scene(name, self._source.build(name), self._renderer, self._body)
        self._scenes.move_to_end(name)
        return self._scenes[name]

    def clear(self) -> None:
        """Forgets all scenes."""
        for scene in self._scenes.values():
            scene.renderer.close()
        self._scenes.clear()

    def make_renderer(self, model: mujoco.MjModel) -> Renderer:
        """A renderer of the scenes' kind for another model."""
        return make_renderer(self._renderer, model)
