"""GRNN: a 3-D memory that a convolutional GRU writes, and that pictures of any view are decoded from.

Source: Tung et al. 2019, "Learning Spatial Common Sense with Geometry-Aware Recurrent Networks"; thesis 2.1.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from labeling.memory.networks.conv_gru import ConvGru
from labeling.memory.networks.mapper import ViewMapper
from labeling.memory.networks.plane_decoder import PlaneDecoder, RgbHead
from labeling.memory.networks.scene_memory import SceneMemory
from labeling.memory.networks.view_batch import Cameras, Views
from labeling.memory.settings.memory_spec import MemorySpec


class Grnn(nn.Module):
    """Views in, memory, pictures of other views out."""

    def __init__(self, spec: MemorySpec) -> None:
        super().__init__()
        self.spec = spec
        self.mapper = ViewMapper(spec.grid, spec.channels)
        self.update = ConvGru(spec.channels, spec.channels, dimensions=3)
        self.decoder = PlaneDecoder(spec.grid, spec.channels, spec.planes, spec.width, spec.width)
        self.head = RgbHead(spec.width)

    def remember(self, views: Views) -> SceneMemory:
        """The memory after all views, one after the other."""
        mapped = self.mapper(views)
        state = torch.zeros_like(mapped.features[:, 0])
        for view in range(views.rgb.shape[1]):
            state = self.update(mapped.features[:, view], state)
        return SceneMemory(state, mapped.occupied.amax(dim=1), mapped.seen.amax(dim=1))

    def imagine(self, memory: SceneMemory, cameras: Cameras) -> Float[Tensor, "b t 3 h w"]:
        """Logits of the pictures that cameras would take."""
        maps = self.decoder(memory.features, cameras, memory.occupied)
        return self.head(maps).unflatten(0, cameras.camera_to_grid.shape[:2])

    def forward(self, views: Views, cameras: Cameras) -> Float[Tensor, "b t 3 h w"]:
        """Logits of pictures of ``cameras`` from a memory of ``views``."""
        return self.imagine(self.remember(views), cameras)
