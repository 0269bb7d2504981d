"""The lights of a model as classic OpenGL can show them."""

import mujoco
import numpy as np
from jaxtyping import Float

from sbm_gym.rendering.tables.light_tables import DIRECTIONAL, POINT, LightTable
from sbm_gym.rendering.tables.lights import BELOW_LAMP_M, LightLevel, is_in_sight, light_table
from sbm_gym.rendering.tables.textures import srgb_encode

MAX_LIGHTS = 8
"""Of the fixed pipeline. Source: OpenGL 2.1 specification, table 6.11."""
FILL_FROM_CAMERA = 0.35
"""Share of the fill light that comes from the camera instead of from everywhere, so that shapes read."""
LAMP_SHADOW_CUTOFF_DEG = 78.0
"""Half angle of the cone below a lamp in which it casts shadows: a shadow map is flat."""
FOCUS_M = 4.0
"""What is looked at is at most this far away, as far as the choice of lamps goes."""
SHADOW_RADIUS_M = 25.0
"""The sun casts shadows this far around what is looked at."""
SUN_DISTANCE_M = 100.0
_DIRECTIONAL = int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
_SPOT = int(mujoco.mjtLightType.mjLIGHT_SPOT)


def place_lights(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    scene: mujoco.MjvScene,
    context: mujoco.MjrContext,
    camera_to_world: Float[np.ndarray, "4 4"],
    level: LightLevel,
    *,
    shadows: bool,
) -> None:
    """Replaces the lights of a scene by what OpenGL can show of them.

    Point lights, which MuJoCo's OpenGL renderer ignores, become spots that shine all around. Only near lamps fit.
    Colours are multiplied as they are encoded, so the strength of light is encoded too: pictures get about as bright as
    those of ``rays``.

    Args:
        model: the compiled model.
        data: where lamps are.
        scene: its lights are overwritten.
        context: its shadow settings are overwritten.
        camera_to_world: the fill light shines from here, and lamps near it are preferred.
        level: how bright the world is.
        shadows: whether lamps cast shadows.
    """
    look = np.asarray(camera_to_world, float)
    eye, forward = look[:3, 3], look[:3, 2]
    table = light_table(model, data, camera_to_world, shadows)
    fill, brightness = level.fill, level.exposure
    ambient = srgb_encode(brightness * fill)
    first = scene.lights[0]
    first.type, first.headlight, first.castshadow, first.id = _DIRECTIONAL, 1, 0, -1
    first.pos, first.dir = eye, forward
    first.ambient, first.diffuse = (1.0 - FILL_FROM_CAMERA) * ambient, FILL_FROM_CAMERA * ambient
    first.specular, first.attenuation = np.zeros(3), (1.0, 0.0, 0.0)
    chosen = _chosen(model, data, table, eye, look_for_m(model, data, eye, forward))
    for slot, row in enumerate(chosen, start=1):
        light = scene.lights[slot]
        light.id, light.headlight, light.castshadow = slot, 0, int(table.shadow_slot[row] >= 0)
        # What a surface gains from the lamp beyond the fill light it has, both encoded.
        full = srgb_encode(brightness * (fill + table.diffuse[row]))
        light.diffuse, light.ambient = np.maximum(full - ambient, 0.0), np.zeros(3)
        light.specular, light.attenuation = table.specular[row], table.attenuation[row]
        light.pos, light.dir = table.position[row], table.direction[row]
        light.type, light.cutoff, light.exponent = _SPOT, 180.0, 0.0
        if table.kind[row] == DIRECTIONAL:
            light.type = _DIRECTIONAL
            context.shadowClip = SHADOW_RADIUS_M
            # The shadow map is centred on what is looked at.
            light.pos = eye + 0.6 * SHADOW_RADIUS_M * forward - SUN_DISTANCE_M * table.direction[row]
        elif table.kind[row] == POINT:
            light.dir = (0.0, 0.0, -1.0)
            context.shadowScale = LAMP_SHADOW_CUTOFF_DEG / 180.0
        else:
            light.cutoff = float(np.rad2deg(np.arccos(table.spot[row, 0])))
            light.exponent = table.spot[row, 1]
    scene.nlight = 1 + len(chosen)


def look_for_m(
    model: mujoco.MjModel, data: mujoco.MjData, eye: Float[np.ndarray, "3"], forward: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """A point just before what stands in the middle of the picture, at most ``FOCUS_M`` away."""
    reach = FOCUS_M
    while reach > 0.5 and not is_in_sight(model, data, eye, eye + reach * forward):
        reach *= 0.7
    return eye + reach * forward


def _chosen(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    table: LightTable,
    eye: Float[np.ndarray, "3"],
    focus: Float[np.ndarray, "3"],
) -> list[int]:
    """Lights that fit beside the fill light: the sun, then lamps in sight of the eye or of what it looks at.

    Near ones come first. Lamps of other rooms would shine through walls beyond the reach of their shadow maps.
    """
    distance = np.where(table.kind == DIRECTIONAL, -1.0, np.linalg.norm(table.position - focus, axis=1))
    found = []
    for row in np.argsort(distance, kind="stable").tolist():
        lamp = table.position[row] - [0.0, 0.0, BELOW_LAMP_M]
        if table.kind[row] == DIRECTIONAL or any(is_in_sight(model, data, place, lamp) for place in (eye, focus)):
            found.append(row)
        if len(found) == MAX_LIGHTS - 1:
            break
    return sorted(found)
