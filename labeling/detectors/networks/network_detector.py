"""A network as a detector: pictures of any size in, masks in the pictures' own pixels out."""

import numpy as np
import torch
from jaxtyping import Float32, UInt8

from labeling.core.detector import PictureDetections
from labeling.core.masks import MASK_THRESHOLD, paste_mask
from labeling.detectors.data.augment import resize_picture
from labeling.detectors.networks.calibration import calibrated
from labeling.detectors.networks.mask_rcnn import STRIDE, Network, fused
from labeling.detectors.networks.spec import PREDICTED_MASK_THRESHOLD
from labeling.runtime.threads import settle_network_threads


class NetworkDetector:
    """Runs a network."""

    def __init__(
        self,
        network: Network,
        name: str,
        digest: str = "",
        device: str | torch.device = "cpu",
        batch_size: int = 8,
        mask_threshold: float = PREDICTED_MASK_THRESHOLD,
    ) -> None:
        """Takes a network, and moves a copy of it to a device.

        Args:
            network: any.
            name: of the detector.
            digest: of its weights.
            device: where it runs.
            batch_size: pictures at a time.
            mask_threshold: from which probability on a pixel is part of a mask, in [0, 1].
        """
        settle_network_threads()
        self.name, self.digest, self.batch_size = name, digest, batch_size
        self.spec, self.categories = network.spec, network.spec.names
        self._device, self._mask_threshold = torch.device(device), mask_threshold
        self.network = fused(network).to(self._device)

    def detect(
        self, rgb: UInt8[np.ndarray, "b h w 3"], depth_m: Float32[np.ndarray, "b h w"] | None = None
    ) -> list[PictureDetections]:
        """See ``labeling.core.detector.Detector``; depth is not used."""
        found: list[PictureDetections] = []
        for start in range(0, len(rgb), self.batch_size):
            found.extend(self._detect_batch(rgb[start : start + self.batch_size]))
        return found

    def _detect_batch(self, rgb: UInt8[np.ndarray, "b h w 3"]) -> list[PictureDetections]:
        size = (int(rgb.shape[1]), int(rgb.shape[2]))
        height, width = self.spec.input_size(size)
        pictures = torch.zeros(
            len(rgb), 3, *(-(-side // STRIDE) * STRIDE for side in (height, width)), dtype=torch.uint8
        )
        for index, picture in enumerate(rgb):
            small = np.ascontiguousarray(resize_picture(picture, (height, width)))
            pictures[index, :, :height, :width] = torch.from_numpy(small).permute(2, 0, 1)
        on_gpu = self._device.type == "cuda"
        with torch.inference_mode(), torch.autocast(self._device.type, torch.float16, enabled=on_gpu):
            outputs = self.network(pictures.to(self._device), [(height, width)] * len(rgb))
        grow = np.array([size[1] / width, size[0] / height] * 2, np.float32)
        return [self._as_detections({k: v.cpu() for k, v in one.items()}, grow, size) for one in outputs]

    def _as_detections(self, output: dict, grow: np.ndarray, size: tuple[int, int]) -> PictureDetections:
        names = [self.spec.categories[label - 1] for label in output["labels"].tolist()]
        boxes = output["boxes"].float().numpy() * grow
        # Pasting cuts at MASK_THRESHOLD. What is added to all cells alike moves the cut: it interpolates linearly.
        probability = output["masks"][:, 0].float().numpy() + np.float32(MASK_THRESHOLD - self._mask_threshold)
        scores = calibrated(output["scores"].float().numpy(), self.spec.calibration)
        kept, masks = [], []
        for index, name in enumerate(names):
            mask = paste_mask(probability[index], boxes[index], size) if name else None
            if mask is not None and mask.any():
                kept.append(index)
                masks.append(mask)
        return PictureDetections(
            categories=tuple(names[index] for index in kept),
            scores=scores[kept],
            boxes_xyxy=boxes[kept],
            masks=np.stack(masks) if masks else np.zeros((0, *size), bool),
        )
