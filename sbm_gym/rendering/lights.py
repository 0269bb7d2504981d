"""The lights of a model as the ray renderer uses them."""

import mujoco
import numpy as np
from jaxtyping import Float

from sbm_gym.rendering.occupancy import FilledSpace
from sbm_gym.rendering.shading import DIRECTIONAL, POINT, SPOT, AmbientTable, LightTable

BOUNCE = 0.25
"""Share of the lamps' light that comes back from walls and floor as ambient light: a bright room's first bounces."""
AMBIENT_WITHOUT_LIGHTS = 0.3
"""Ambient light of a model without any light. Source: MuJoCo, ``render_gl3.c``, ``initLights``."""
SKY = np.array([[0.22, 0.42, 0.80], [0.72, 0.82, 0.92], [0.30, 0.29, 0.27]])
"""Linear colours of a clear sky: zenith, horizon, and the ground below it."""
TYPICAL_DISTANCE_M = 2.0
"""From a lamp to what it lights."""
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
    rows = []
    headlight = model.vis.headlight
    if headlight.active:
        look = np.asarray(camera_to_world, float)
        rows.append(
            (DIRECTIONAL, look[:3, 3], look[:3, 2], headlight.diffuse, headlight.specular, (1, 0, 0), (-1, 0), False)
        )
    for light in active_lights(model):
        position, direction = _place(model, data, light)
        kind = _KINDS[int(model.light_type[light])]
        spot = (np.cos(np.deg2rad(model.light_cutoff[light])), model.light_exponent[light])
        attenuation = model.light_attenuation[light]
        casts = shadows and bool(model.light_castshadow[light])
        rows.append(
            (
                kind,
                position,
                direction,
                model.light_diffuse[light],
                model.light_specular[light],
                attenuation,
                spot,
                casts,
            )
        )
    rows = [row for row in rows if np.any(np.asarray(row[3]) > 0) or np.any(np.asarray(row[4]) > 0)]
    casts = np.array([row[7] for row in rows], bool)
    return LightTable(
        np.array([row[0] for row in rows], np.int64),
        *(np.array([row[column] for row in rows], float).reshape(-1, 3) for column in range(1, 6)),
        np.array([row[6] for row in rows], float).reshape(-1, 2),
        np.where(casts, np.cumsum(casts) - 1, -1).astype(np.int64),
    )


def active_lights(model: mujoco.MjModel) -> list[int]:
    """Lights that are on and of a kind that rays can follow."""
    return [i for i in range(model.nlight) if model.light_active[i] and int(model.light_type[i]) in _KINDS]


def _place(model: mujoco.MjModel, data: mujoco.MjData, light: int):
    """Position and direction of a light. ``mj_kinematics`` alone moves bodies but not lights, so this does it."""
    if model.light_mode[light] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED:
        return np.array(data.light_xpos[light]), np.array(data.light_xdir[light])
    body = int(model.light_bodyid[light])
    rotation = np.asarray(data.xmat[body], float).reshape(3, 3)
    direction = rotation @ model.light_dir[light]
    return data.xpos[body] + rotation @ model.light_pos[light], direction / max(np.linalg.norm(direction), 1e-12)


def ambient_light(model: mujoco.MjModel, filled: FilledSpace, table: LightTable) -> AmbientTable:
    """Light from everywhere: what the model asks for, plus what walls and floor give back of its lamps.

    Args:
        model: the compiled model.
        filled: what stands in the way of ambient light.
        table: the lights of this picture; they decide the exposure.
    """
    lights = active_lights(model)
    # The headlight's ambient part is the world's fill light, whether or not a lamp shines from the camera.
    ambient = np.array(model.vis.headlight.ambient, float)
    if not lights and not model.vis.headlight.active:
        ambient = np.maximum(ambient, AMBIENT_WITHOUT_LIGHTS)
    if lights:
        ambient += model.light_ambient[lights].sum(axis=0)
        # A lamp reaches about half of a room: the mean over surfaces of the cosine and of shadows.
        ambient += BOUNCE * np.minimum(model.light_diffuse[lights].sum(axis=0), 1.5)
    skyboxes = np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    return AmbientTable(
        colour=ambient.astype(float),
        sky=SKY,
        exposure=_exposure(ambient, table),
        sky_texture=int(skyboxes[0]) if len(skyboxes) else -1,
        density=filled.density,
        grid_origin=filled.origin_m,
        cell_m=filled.cell_m,
    )


def _exposure(ambient: Float[np.ndarray, "3"], table: LightTable) -> float:
    """Darkens pictures of brightly lit worlds, as a camera would; dim worlds stay dim."""
    a = table.attenuation
    fall_off = np.maximum(a[:, 0] + TYPICAL_DISTANCE_M * (a[:, 1] + TYPICAL_DISTANCE_M * a[:, 2]), 1e-6)
    strength = table.diffuse.mean(axis=1) / np.where(table.kind == DIRECTIONAL, 1.0, fall_off)
    # Half: the mean of Lambert's cosine over the directions that surfaces face.
    expected = float(ambient.mean() + 0.5 * strength.sum())
    return min(1.0, FULL_LIGHT / max(expected, 1e-6))
