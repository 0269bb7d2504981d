"""Sun and sky over a town: how high the sun stands and where, clouds before it, haze between houses."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from sbm_gym.rendering.tables.lights import SKY_NUMBERS

SUN = "sun"
"""Name of the sun among a model's lights."""
_CLEAR = np.array([[0.10, 0.24, 0.58], [0.56, 0.70, 0.86], [0.22, 0.21, 0.20]])
_OVERCAST = np.array([[0.50, 0.54, 0.60], [0.74, 0.76, 0.79], [0.24, 0.24, 0.24]])
_LOW_SUN = np.array([[0.12, 0.22, 0.50], [0.90, 0.70, 0.50], [0.22, 0.20, 0.18]])


@dataclass(frozen=True)
class Weather:
    """What the light of an episode depends on."""

    elevation_rad: float
    """Height of the sun above the horizon."""
    azimuth_rad: float
    """Direction in which the sun stands, counter-clockwise from +X."""
    overcast: float
    """0: clear sky; 1: the sun is hidden, and everything casts no shadow."""
    haze_per_m: float
    """Share of what is seen that haze replaces in each metre."""

    def sun(self) -> Float[np.ndarray, "3"]:
        """Linear colour of sunlight; lower suns are redder and weaker."""
        height = np.sin(self.elevation_rad)
        warm = np.array([1.0, 0.80 + 0.17 * height, 0.58 + 0.34 * height])
        return 1.15 * (0.55 + 0.45 * np.sqrt(height)) * (1.0 - self.overcast) ** 1.5 * warm

    def ambient(self) -> Float[np.ndarray, "3"]:
        """Linear light of the sky from all sides."""
        clear, grey = np.array([0.38, 0.42, 0.50]), np.array([0.76, 0.78, 0.81])
        return (1.0 - self.overcast) * clear + self.overcast * grey

    def sky(self) -> Float[np.ndarray, "10"]:
        """Linear colours of zenith, horizon and the ground below it, and haze per metre."""
        evening = float(np.clip(1.0 - self.elevation_rad / np.deg2rad(28.0), 0.0, 1.0))
        colours = (1.0 - evening) * _CLEAR + evening * _LOW_SUN
        colours = (1.0 - self.overcast) * colours + self.overcast * _OVERCAST
        # Haze whitens the sky near the horizon too, and some of it everywhere.
        milky = min(self.haze_per_m * 60.0, 0.6)
        colours[0] = (1.0 - milky) * colours[0] + milky * colours[1]
        return np.append(colours.ravel(), self.haze_per_m)

    def direction(self) -> Float[np.ndarray, "3"]:
        """Direction in which sunlight travels."""
        flat = np.cos(self.elevation_rad)
        return -np.array([flat * np.cos(self.azimuth_rad), flat * np.sin(self.azimuth_rad), np.sin(self.elevation_rad)])

    def _sunlight(self) -> dict[str, Float[np.ndarray, "3"]]:
        direction, colour = self.direction(), self.sun()
        return {"pos": -60.0 * direction, "dir": direction, "diffuse": colour, "specular": 0.6 * colour}

    def add_to(self, spec: mujoco.MjSpec) -> None:
        """Puts sun, skylight and sky into a world that has none."""
        spec.visual.headlight.active = 0
        spec.visual.headlight.ambient = self.ambient()
        kind = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        spec.worldbody.add_light(name=SUN, type=kind, ambient=[0.0, 0.0, 0.0], castshadow=True, **self._sunlight())
        spec.add_numeric(name=SKY_NUMBERS, data=self.sky())

    def apply(self, model: mujoco.MjModel) -> None:
        """Changes the light of a compiled world that ``add_to`` lit."""
        sun = model.light(SUN).id
        for name, value in self._sunlight().items():
            getattr(model, f"light_{name}")[sun] = value
        model.vis.headlight.ambient = self.ambient()
        start = int(model.numeric_adr[model.numeric(SKY_NUMBERS).id])
        model.numeric_data[start : start + 10] = self.sky()


def draw_weather(rng: np.random.Generator) -> Weather:
    """Draws the weather: half of the days are clear, a quarter overcast, the rest between; sometimes it is hazy."""
    kind = rng.random()
    overcast = 0.0 if kind < 0.5 else 1.0 if kind > 0.75 else float(rng.uniform(0.15, 0.7))
    haze = float(rng.uniform(0.003, 0.008)) if rng.random() < 0.25 else float(rng.uniform(0.0005, 0.002))
    return Weather(
        elevation_rad=float(np.deg2rad(rng.uniform(18.0, 65.0))),
        azimuth_rad=float(rng.uniform(-np.pi, np.pi)),
        overcast=overcast,
        haze_per_m=haze,
    )
