"""Settings of the label generator. Lengths are given in object sizes, so that one set of defaults fits a shelf bin and
a room; the object size itself is measured in the data (labeling.generator.cloud.object_scale).
"""

from dataclasses import dataclass, field
from typing import Literal

from labeling.core.types import CONFIDENT, MIN_POSTERIOR
from labeling.generator.settings.published_defects import PublishedDefects
from labeling.runtime.ranges import NonNegative, Positive, PositiveShare, Settings, Share


@dataclass(frozen=True)
class LabelConfig(Settings):
    """Settings of label generation.

    Example:
        >>> LabelConfig(confident=0.7, free_space=False).confident
        0.7
        >>> LabelConfig(confident=1.5).check()
        Traceback (most recent call last):
        ...
        labeling.core.errors.UsageError: --confident must lie above 0 and at most at 1, not 1.5
    """

    confident: PositiveShare[float] = CONFIDENT
    """Detections at least this confident become sources of labels. Source: thesis A.2.2."""
    weak_evidence: bool = True
    """Let detections below ``confident`` vote, with the weight of their score, on objects that a source has found."""
    min_posterior: Share[float] = MIN_POSTERIOR
    """Objects that no view is sure of are labelled too if the chance of their category, from all looks at them, reaches
    this (labeling.generator.objects.object_posterior). 1 leaves them out, as in the thesis."""
    fuse_views: bool = True
    """Detections of one object speak for it together. False: every confident detection is segmented alone, and where
    masks then overlap in a view the most confident one is kept, as in the thesis."""
    max_sources: NonNegative[int] = 0
    """Confident views of an object that seed it at most, the most confident first; 0 takes all."""
    min_mask_px: NonNegative[int] = 32
    """Smaller detections are passed over. Source: field notes (published code)."""
    max_range_m: Positive[float] = 50.0
    """Depth beyond this is not used. Source: field notes (published code)."""
    erode: NonNegative[float] = 0.015
    """Width of the unknown band inside a mask, as a share of the square root of its pixels (thesis: 3x3, once)."""
    dilate: NonNegative[float] = 0.05
    """Width of the unknown band outside a mask, as a share of the square root of its pixels (published code: 4 px)."""
    erosions: NonNegative[int] | None = None
    """Instead of ``erode``: how often the mask is eroded by 3x3 pixels (thesis: once in rooms, 3 times in streets)."""
    dilations: NonNegative[int] | None = None
    """Instead of ``dilate``: how often the mask is dilated by 3x3 pixels."""
    seed_outliers: Literal["median", "mean", "off"] = "median"
    """Which seeds are dropped as outliers in space: further than ``outlier_spread`` deviations from their median, or
    from their mean (published code), or none."""
    outlier_spread: Positive[float] = 3.0
    """How many standard deviations. Source: field notes (published code: 3 in rooms, 2 in streets)."""
    voxel_share: Positive[float] = 1 / 16
    """Voxel edge as a share of the object size (3-4 cm for furniture, 8 mm for a book)."""
    voxel_m: Positive[float] | None = None
    """Voxel edge in metres; None derives it from object size and pixel footprint."""
    max_voxels: Positive[int] = 300_000
    """Voxels grow until the cloud has at most this many: bounds time and memory."""
    crop: Positive[float] = 0.25
    """Margin around an object's seeds within which points may belong to it, in sizes of this object (thesis: 1 m)."""
    crop_cut: Positive[float] = 0.7
    """The same for an object that the border of the picture cuts off in all of its sources, since it goes on beyond: as
    a share of the longest side of what is seen of it."""
    colour_beyond: Share[float] = 0.5
    """How much colour alone decides at points of such an object that none of its sources has seen."""
    crop_m: Positive[float] | None = None
    """Instead of ``crop``: half edge of a cube around the seeds, metres, which grows until it holds seeds of both
    classes (published code: 1 in rooms, 6 in streets)."""
    max_crop_m: Positive[float] = 5.0
    """How far that cube grows at most. Source: field notes (published code)."""
    gaussian_share: Share[float] = 0.75
    """Weight of a Gaussian per class beside the SVM (quadratic discriminant analysis); 0 for the SVM alone, as in the
    thesis, 1 for the Gaussians alone."""
    votes: bool = True
    """Let detections vote directly on the points they saw; False: they only train the classifier, as in the thesis."""
    min_vote: Share[float] = 0.75
    """Least probability that a vote is right on objects that no detection is confident of: those are unsure what it is,
    not where."""
    clamp_seeds: bool = False
    """Hold seeds at probability .99 and .01 whatever the classifier says. Source: field notes (published code)."""
    outer_share: Share[float] = 0.0
    """Share of the object's training points that comes from the outermost fifth of its seeds (published code: .5)."""
    appearance_weight: NonNegative[float] = 4.0
    """Weight of the appearance kernel (position and colour), nats."""
    appearance_width: Positive[float] = 0.35
    """Its standard deviation in space, in object sizes."""
    appearance_width_m: Positive[float] | None = None
    """The same in metres; None takes ``appearance_width``."""
    appearance_colour: Positive[float] = 0.1
    """Its standard deviation in colour, channels in [0, 1]."""
    smoothness_weight: NonNegative[float] = 1.0
    """Weight of the smoothness kernel (position only), nats."""
    smoothness_width_voxels: Positive[float] = 1.5
    """Its standard deviation in voxels."""
    smoothness_width_m: Positive[float] | None = None
    """The same in metres; None takes ``smoothness_width_voxels``."""
    iterations: NonNegative[int] = 5
    """Mean-field updates. Source: field notes (published code)."""
    exclusive: bool = True
    """One CRF in which objects compete for points; False: one binary CRF per object, as in the thesis."""
    merge_overlap: PositiveShare[float] = 0.5
    """Detections (or segments) that share this much of the space both can see are one object."""
    nested_masks: bool = True
    """What a confident mask shows inside a larger one of another category is background to that, as a cup is to its
    table; where other views disagree, votes decide."""
    segment_outliers: Literal["pieces", "mean", "off"] = "pieces"
    """What is taken out of a finished segment: small pieces that lie apart, points more than ``outlier_spread``
    deviations from its mean (published code), or nothing."""
    min_piece: NonNegative[float] = 0.05
    """Connected components of a segment that hold less than this share of it are taken out."""
    piece_reach: NonNegative[float] = 0.15
    """So are components, however large, that lie further from the body of the object than this share of its diagonal:
    the ground, or another object. The body is the component with the most votes of detections."""
    visibility: Literal["own", "z-buffer"] = "own"
    """What a pixel with depth shows: its own point, or the nearest point that any view puts there."""
    fill_px: NonNegative[float] | None = None
    """Reach of hole filling in pixels; None takes half a voxel, 0 fills nothing."""
    fill_edge: Positive[float] = 0.3
    """Change of colour (sum over channels in [0, 1]) that stops hole filling as far as its reach does."""
    fill_views: Positive[int] = 2
    """Views that must have measured what another one shows where it has no depth: what one alone has measured is too
    often noise, floating before the objects."""
    consistency: bool = False
    """Keep only objects that at least four views are confident of, all under one name. Source: thesis A.5."""
    erode_doubt: NonNegative[float] = 0.15
    """How much wider the unknown band inside a mask is for a detection of confidence 0 than for one of 1, as ``erode``:
    masks of low confidence are less exact. 0 as in the thesis."""
    dilate_doubt: NonNegative[float] = 0.1
    """The same for the band outside, as ``dilate``."""
    refine_poses: Literal["auto", "on", "off"] = "auto"
    """Refine the poses of views by their depth and brightness: if errors exceed the voxels and refined poses fit better
    (``auto``), whenever refined poses fit better (``on``), or never; what the check finds is reported in any case."""
    free_space: bool = True
    """Drop depth that other views look through: mixed pixels, noise, things that moved on."""
    moving: bool = True
    """Take what some views measured and others look through for things that move, and label these in the views where
    they are, where they are (labeling.generator.objects.tracks); a view that looks through most of any object has no
    label of it, unless it has moved and shows there (labeling.generator.draw.gone_objects). False: everything
    stands still, as in the thesis."""
    calibrate: bool = True
    """Give each label its expected IoU as confidence, from what all views say about its object
    (labeling.generator.quality.label_quality); False: the chance of its object's category times the mean probability in
    its mask."""
    min_confidence: Share[float] = 0.05
    """Labels below are left out; where ``ignore_unconfirmed`` marks regions, they are such regions instead."""
    ignore_unconfirmed: Share[float] = 1.0
    """Where the confidences of detections that no label explains add up to this over all views, regions are marked to
    be ignored in every view, so that nobody learns that there is background; 1 marks none. Of a detector that finds
    most things hardly any of these places holds one, and detectors learn from what is background there; .3 is for one
    that misses much."""
    doubt_across_views: bool = True
    """False: a view knows only its own detections when it marks such regions."""
    complete_boxes: bool = True
    """Let 3-D boxes reach down to what their objects stand on."""
    clear_ground: bool = True
    """Take out of objects what they have of the ground, unless they are flat on it, and out of seeds that are mostly
    ground: masks reach over lower edges, and what an object is made of may let the ground be seen."""
    level_surfaces: bool = True
    """Give objects the rest of level surfaces above the ground that they have the greater part of, such as table tops:
    detectors leave out what lies far behind."""
    end_boards: bool = True
    """Give objects the boards that end them, such as the heads of beds: upright layers as wide as the side that they
    stand at, which detectors leave out."""
    thin_parts: bool = True
    """Give objects their legs, stems and feet: thin pieces between them and the ground, which detectors leave out."""
    class_sizes: bool = True
    """Let an object's size in metres have a say in what it is (labeling.generator.objects.object_sizes)."""
    seed: NonNegative[int] = 0
    """Seed of the sampling of training points."""
    published: PublishedDefects = field(default_factory=PublishedDefects)
    """Defects of the published code."""
