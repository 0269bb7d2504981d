"""The lights of a model as the ray renderer uses them."""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from sbm_gym.rendering.tables.light_tables import DIRECTIONAL, POINT, SPOT, AmbientTable, LightTable
from sbm_gym.rendering.tables.occupancy import FilledSpace
from sbm_gym.rendering.tables.scene_tables import FIRST_HIDDEN_GROUP

BOUNCE = 0.25
"""Share of the lamps' light that comes back from walls and floor as ambient light: a bright room's first bounces."""
AMBIENT_WITHOUT_LIGHTS = 0.3
"""Ambient light of a model without any light. Source: MuJoCo, ``render_gl3.c``, ``initLights``."""
SKY = np.array([[0.22, 0.42, 0.80], [0.72, 0.82, 0.92], [0.30, 0.29, 0.27]])
"""Linear colours of a clear sky: zenith, horizon, and the ground below it."""
SKY_NUMBERS = "sky"
"""Name of a model's custom numbers, if it has any: nine for the sky's colours as in ``SKY``, and haze per metre."""
TYPICAL_DISTANCE_M = 2.0
"""From a lamp to what it lights."""
BELOW_LAMP_M = 0.3
"""Lamps are looked for from this far below, past their shades."""
FULL_LIGHT = 0.85
"""Typical light in a picture that is exposed as it is: a white wall then stays below white."""
_KINDS = {
    int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL): DIRECTIONAL,
    int(mujoco.mjtLightType.mjLIGHT_POINT): POINT,
    int(mujoco.mjtLightType.mjLIGHT_SPOT): SPOT,
}


def light_table(
    model: mujoco.MjModel, data: mujoco.MjData, camera_to_world: Float[np.ndarray, "4 4"], shadows: bool
) -> LightTable:
    """Active lights in the world, the headlight first. Image-based lights are left out.

    Args:
        model: the compiled model.
        data: where bodies and tracking lights are.
        camera_to_world: the headlight shines from here.
        shadows: whether any light casts shadows.
    """
    numbers = np.array(active_lights(model), int)
    place, direction = _places(model, data, numbers)
    count = len(numbers)
    is_fixed = model.light_mode[numbers] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    is_fixed &= model.body_weldid[model.light_bodyid[numbers]] == 0
    cutoff = np.cos(np.deg2rad(np.asarray(model.light_cutoff[numbers], float)))
    columns = [
        np.array([_KINDS[int(kind)] for kind in model.light_type[numbers]], np.int64),
        place,
        direction,
        np.asarray(model.light_diffuse[numbers], float),
        np.asarray(model.light_specular[numbers], float),
        np.asarray(model.light_attenuation[numbers], float),
        np.stack([cutoff, np.asarray(model.light_exponent[numbers], float)], axis=1).reshape(count, 2),
        np.asarray(model.light_castshadow[numbers], bool) & shadows,
        is_fixed,
    ]
    headlight = model.vis.headlight
    if headlight.active:
        look = np.asarray(camera_to_world, float)
        first = (DIRECTIONAL, look[:3, 3], look[:3, 2], headlight.diffuse, headlight.specular, (1, 0, 0), (-1, 0))
        entries = (*first, False, False)
        columns = [
            np.concatenate([np.asarray(entry, column.dtype)[None], column])
            for entry, column in zip(entries, columns, strict=True)
        ]
    shines = (columns[3] > 0).any(axis=1) | (columns[4] > 0).any(axis=1)
    kind, place, direction, diffuse, specular, attenuation, spot, casts, is_fixed = (c[shines] for c in columns)
    slot = np.where(casts, np.cumsum(casts) - 1, -1).astype(np.int64)
    return LightTable(kind, place, direction, diffuse, specular, attenuation, spot, slot, is_fixed)


def light_key(model: mujoco.MjModel, data: mujoco.MjData, camera_to_world: Float[np.ndarray, "4 4"]) -> bytes:
    """Differs where the light of a world does whose walls stand still; arguments as in ``light_table``."""
    headlight = model.vis.headlight
    columns = [model.light_active, model.light_type, model.light_mode, model.light_castshadow]
    columns += [model.light_pos, model.light_dir, model.light_cutoff, model.light_exponent, model.light_attenuation]
    columns += [model.light_ambient, model.light_diffuse, model.light_specular, model.numeric_data]
    columns += [data.xpos[model.light_bodyid], data.xmat[model.light_bodyid], data.light_xpos, data.light_xdir]
    columns += [headlight.ambient, np.array(headlight.active)]
    if headlight.active:
        columns += [headlight.diffuse, headlight.specular, np.asarray(camera_to_world, float)]
    return b"".join(column.tobytes() for column in columns)


def active_lights(model: mujoco.MjModel) -> list[int]:
    """Lights that are on and of a kind that rays can follow."""
    return [i for i in range(model.nlight) if model.light_active[i] and int(model.light_type[i]) in _KINDS]


def _places(
    model: mujoco.MjModel, data: mujoco.MjData, lights: Int[np.ndarray, "l"]
) -> tuple[Float[np.ndarray, "l 3"], Float[np.ndarray, "l 3"]]:
    """Positions and directions of lights. ``mj_kinematics`` alone moves bodies but not lights, so this does it."""
    body = model.light_bodyid[lights]
    rotation = np.asarray(data.xmat[body], float).reshape(-1, 3, 3)
    place = data.xpos[body] + np.einsum("lij,lj->li", rotation, model.light_pos[lights])
    direction = np.einsum("lij,lj->li", rotation, model.light_dir[lights])
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    # Lights that follow something are placed by MuJoCo.
    follows = model.light_mode[lights] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    place[follows], direction[follows] = data.light_xpos[lights][follows], data.light_xdir[lights][follows]
    return place, direction


def skybox_of(model: mujoco.MjModel) -> int:
    """The texture of a model's sky, -1 if it has none."""
    skyboxes = np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    return int(skyboxes[0]) if len(skyboxes) else -1


def ambient_light(model: mujoco.MjModel, filled: FilledSpace, level: "LightLevel", skybox: int) -> AmbientTable:
    """Light from everywhere: what the model asks for, plus what walls and floor give back of its lamps.

    Args:
        model: the compiled model.
        filled: what stands in the way of ambient light.
        level: how bright the world is.
        skybox: texture of its sky, -1 for none.
    """
    sky, haze_per_m = sky_of(model)
    return AmbientTable(
        colour=level.fill,
        sky=sky,
        haze_per_m=haze_per_m,
        exposure=level.exposure,
        sky_texture=skybox,
        density=filled.density,
        grid_origin=filled.origin_m,
        cell_m=filled.cell_m,
    )


def sky_of(model: mujoco.MjModel) -> tuple[Float[np.ndarray, "3 3"], float]:
    """The sky of a model, as ``SKY``, and the share of what is seen that haze replaces in each metre."""
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, SKY_NUMBERS)
    if number < 0:
        return SKY, 0.0
    start = int(model.numeric_adr[number])
    numbers = np.asarray(model.numeric_data[start : start + int(model.numeric_size[number])], float)
    if len(numbers) != 10:
        raise ValueError(f"the custom numbers {SKY_NUMBERS!r} of a model are ten, not {len(numbers)}")
    return numbers[:9].reshape(3, 3), float(numbers[9])


def clear_haze(model: mujoco.MjModel) -> None:
    """Takes the haze off a model's sky."""
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, SKY_NUMBERS)
    if number >= 0:
        model.numeric_data[int(model.numeric_adr[number]) + 9] = 0.0


@dataclass(frozen=True)
class LightLevel:
    """How bright a world is."""

    fill: Float[np.ndarray, "3"]
    """Linear ambient light: the model's own, and a first bounce of the lamps of its brightest room."""
    exposure: float
    """Darkens pictures of brightly lit worlds, as a camera would; dim worlds stay dim."""


class LightMeter:
    """Tells how bright a world is, and measures anew only what has changed: the weather, say."""

    def __init__(self, together: Bool[np.ndarray, "l l"] | None = None) -> None:
        """Has seen nothing yet.

        Args:
            together: which active lights shine on one place, if that is known.
        """
        self.together = together
        """Which active lights shine on one place; None if it has not been looked for."""
        self._last: tuple[bytes, LightLevel] | None = None

    def level(self, model: mujoco.MjModel, data: mujoco.MjData, in_sight: "InSight | None" = None) -> LightLevel:
        """How bright the world is now.

        Args:
            model: the compiled model.
            data: where lamps and walls are.
            in_sight: tells what is in sight in place of ``is_in_sight``, which needs a model's meshes.
        """
        lights, headlight = active_lights(model), model.vis.headlight
        settings = (model.light_ambient, model.light_diffuse, model.light_attenuation, model.light_type)
        settings += (np.array(lights), headlight.ambient, headlight.diffuse, np.array(headlight.active))
        key = b"".join(column.tobytes() for column in settings)
        if self.together is None or len(self.together) != len(lights):
            self.together = _shine_together(model, data, lights, in_sight)
        if self._last is None or self._last[0] != key:
            self._last = (key, light_level(model, data, self.together))
        return self._last[1]


def light_level(
    model: mujoco.MjModel, data: mujoco.MjData, together: Bool[np.ndarray, "l l"] | None = None
) -> LightLevel:
    """Measures how bright a world is in its brightest room. Takes milliseconds: for once per scene, not per picture.

    Args:
        model: the compiled model.
        data: where lamps and walls are.
        together: which active lights shine on one place, if that is known.
    """
    lights = active_lights(model)
    headlight = model.vis.headlight
    # The headlight's ambient part is the world's fill light, whether or not a lamp shines from the camera.
    fill = np.array(headlight.ambient, float)
    if not lights and not headlight.active:
        fill = np.maximum(fill, AMBIENT_WITHOUT_LIGHTS)
    from_camera = float(np.mean(headlight.diffuse)) if headlight.active else 0.0
    if not lights:
        return LightLevel(fill, _exposure(fill, from_camera))
    fill += model.light_ambient[lights].sum(axis=0)
    diffuse = np.asarray(model.light_diffuse[lights], float)
    a = np.asarray(model.light_attenuation[lights], float)
    fall_off = np.maximum(a[:, 0] + TYPICAL_DISTANCE_M * (a[:, 1] + TYPICAL_DISTANCE_M * a[:, 2]), 1e-6)
    is_lamp = model.light_type[lights] != mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    strength = diffuse.mean(axis=1) / np.where(is_lamp, fall_off, 1.0)
    together = _shine_together(model, data, lights) if together is None else together
    brightest = together[int(np.argmax(together @ strength))]
    # A lamp reaches about half of a room: the mean over surfaces of the cosine and of shadows.
    fill = fill + BOUNCE * np.minimum(diffuse[brightest].sum(axis=0), 1.5)
    return LightLevel(fill, _exposure(fill, from_camera + float(strength[brightest].sum())))


def _exposure(fill: Float[np.ndarray, "3"], strength: float) -> float:
    # Half: the mean of Lambert's cosine over the directions that surfaces face.
    return min(1.0, FULL_LIGHT / max(float(fill.mean()) + 0.5 * strength, 1e-6))


def _shine_together(
    model: mujoco.MjModel, data: mujoco.MjData, lights: list[int], in_sight: "InSight | None" = None
) -> Bool[np.ndarray, "l l"]:
    """Which lights shine on one place: lamps that see each other, and whatever shines from afar."""
    in_sight = in_sight or functools.partial(is_in_sight, model, data)
    count = len(lights)
    together = np.eye(count, dtype=bool)
    place = _places(model, data, np.array(lights, np.int64))[0] - [0.0, 0.0, BELOW_LAMP_M]
    far_away = model.light_type[lights] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    for i in range(count):
        for j in range(i):
            seen = far_away[i] or far_away[j] or in_sight(place[i], place[j])
            together[i, j] = together[j, i] = seen
    return together


InSight = Callable[[Float[np.ndarray, "3"], Float[np.ndarray, "3"]], bool]
"""Whether nothing that is drawn and stands still lies between two points."""


def is_in_sight(
    model: mujoco.MjModel, data: mujoco.MjData, start_m: Float[np.ndarray, "3"], end_m: Float[np.ndarray, "3"]
) -> bool:
    """Whether nothing that is drawn and stands still lies between two points."""
    way = np.asarray(end_m, float) - start_m
    if np.linalg.norm(way) < 1e-6:
        return True
    groups = np.array([1] * FIRST_HIDDEN_GROUP + [0] * (mujoco.mjNGROUP - FIRST_HIDDEN_GROUP), np.uint8)
    # In units of the way; -1 if nothing is hit.
    distance = mujoco.mj_ray(model, data, np.asarray(start_m, float), way, groups, 1, -1, np.zeros(1, np.int32))
    return not 0.0 <= distance < 1.0
