"""torchvision's Mask R-CNN with its COCO weights: the detector of the thesis."""

from urllib.error import URLError

from labeling.core.detector import DetectorError
from labeling.detectors.data.coco_names import RENAMED
from labeling.detectors.networks.mask_rcnn import Network, build_network
from labeling.detectors.networks.spec import NetworkSpec
from labeling.detectors.networks.torchvision_operators import torchvision


def category_names_of_coco(coco: list[str]) -> tuple[str, ...]:
    """Names of the outputs 1, 2, ... of a network trained on COCO.

    Args:
        coco: its list, as torchvision has it: from 0, with "__background__" and "N/A" for outputs without a meaning.
    """
    return tuple("" if name == "N/A" else RENAMED.get(name, name) for name in coco[1:])


def coco_spec() -> NetworkSpec:
    """Its classes under our names, and the picture sizes that torchvision trained it for."""
    weights = torchvision.models.detection.MaskRCNN_ResNet50_FPN_Weights.COCO_V1
    return NetworkSpec(
        "maskrcnn_resnet50_fpn",
        category_names_of_coco(weights.meta["categories"]),
        short_side_px=(800, 800),
        long_side_px=1333,
    )


def load_coco_network() -> Network:
    """The network, with weights from torchvision's cache or, the first time, from its server.

    Raises:
        DetectorError: if they cannot be had.
    """
    import torch

    weights = torchvision.models.detection.MaskRCNN_ResNet50_FPN_Weights.COCO_V1
    try:
        state = weights.get_state_dict(progress=True, check_hash=True)
    except (URLError, OSError, RuntimeError) as error:
        raise DetectorError(
            f"the COCO weights of maskrcnn_resnet50_fpn are not in {torch.hub.get_dir()}/checkpoints and cannot be "
            f"downloaded ({error}); with a network once, or put {weights.url} there; compact needs no download"
        ) from None
    network = build_network(coco_spec())
    network.load_state_dict(state)
    return network
