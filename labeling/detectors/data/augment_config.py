"""Settings of augmentation."""

from dataclasses import dataclass

from labeling.core.errors import UsageError
from labeling.runtime.ranges import NonNegative, Share, check_ranges


@dataclass(frozen=True)
class AugmentConfig:
    """How strongly pictures are changed while training; all zeros leave them as they are."""

    flip: Share[float] = 0.5
    """Probability of mirroring left and right."""
    window_px: NonNegative[int] = 0
    """Of pictures larger than this only a window of so many pixels a side is taken, with part of an object in it if
    there is one: less work for the same scale; 0 takes them whole."""
    short_side_px: tuple[int, int] = (128, 320)
    """Pictures are resized so that their shorter side lies in this range ..."""
    scale: tuple[float, float] = (0.75, 1.33)
    """... and is this many times what it was."""
    crop: Share[float] = 0.5
    """Probability of cutting out a part; objects that lose nearly all of themselves are ignored."""
    crop_least: Share[float] = 0.6
    """Least side of such a part, as a share of the whole."""
    colour: Share[float] = 0.3
    """Brightness, contrast, saturation and hue change by up to this share (hue by a tenth of it)."""
    blur: Share[float] = 0.15
    """Probability of Gaussian blur, up to 1.2 px."""
    noise: Share[float] = 0.3
    """Probability of sensor noise, up to 4 % of full scale."""

    def check(self) -> None:
        """Refuses settings that make no sense.

        Raises:
            UsageError: naming the setting.
        """
        check_ranges(self)
        if not 0 < self.scale[0] <= self.scale[1] or not 0 < self.short_side_px[0] <= self.short_side_px[1]:
            raise UsageError("--scale and --short-side-px are ranges above 0: low, then high")


NO_AUGMENTATION = AugmentConfig(flip=0.0, scale=(1.0, 1.0), crop=0.0, colour=0.0, blur=0.0, noise=0.0)
