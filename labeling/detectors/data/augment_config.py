"""Settings of augmentation."""

from dataclasses import dataclass

from labeling.runtime.ranges import Interval, NonNegative, Settings, Share


@dataclass(frozen=True)
class AugmentConfig(Settings):
    """How strongly pictures are changed while training; all zeros leave them as they are."""

    flip: Share[float] = 0.5
    """Probability of mirroring left and right."""
    window_px: NonNegative[int] = 0
    """Of pictures larger than this only a window of so many pixels a side is taken, with part of an object in it if
    there is one: less work for the same scale; 0 takes them whole."""
    short_side_px: Interval[int] | None = None
    """Pictures are resized so that their shorter side lies in this range (None: that of the pictures that the network
    looks at; 128 to 320 for ``compact``) ..."""
    scale: Interval[float] = (0.75, 1.33)
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
