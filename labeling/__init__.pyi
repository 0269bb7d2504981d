from .core.detector import DetectorError as DetectorError
from .core.episode import Episode as Episode
from .core.episode_labels import EpisodeLabels as EpisodeLabels
from .core.errors import SbmError as SbmError
from .core.rle import decode_mask as decode_mask
from .core.rle import encode_mask as encode_mask
from .core.types import Box3d as Box3d
from .core.types import Detection as Detection
from .core.types import GroundTruth as GroundTruth
from .core.types import PseudoLabel as PseudoLabel
from .core.views import Camera as Camera
from .core.views import RgbdViews as RgbdViews
from .detectors.registry import load_detector as load_detector
from .generator.propagate import propagate as propagate
from .generator.settings.label_config import LabelConfig as LabelConfig
from .generator.settings.presets import PRESETS as PRESETS
from .io.episodes import find_episodes as find_episodes
from .io.episodes import read_episode as read_episode
from .io.episodes import write_episode as write_episode
from .io.label_set import LabelSet as LabelSet
from .io.label_set import read_label_set as read_label_set
from .io.recordings.recording_config import RecordingConfig as RecordingConfig
from .metrics.mask_ap import average_precision as average_precision
from .metrics.matching import MaskInstance as MaskInstance

__version__: str
