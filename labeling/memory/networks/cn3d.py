"""C-N3D: a 3-D memory that is the mean of what views have seen, and features of it that contrast is trained on.

Top-down features come from the memory of other views, projected into a view; bottom-up ones from that view itself.
Source: Harley et al. 2020, "Learning from Unlabelled Videos Using Contrastive Predictive Neural 3D Mapping"; thesis
2.3.
"""

from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from labeling.memory.lifting.running_mean import mean_over_views
from labeling.memory.networks.blocks import UNet2d
from labeling.memory.networks.mapper import MappedViews, ViewMapper
from labeling.memory.networks.plane_decoder import PlaneDecoder
from labeling.memory.networks.scene_memory import SceneMemory
from labeling.memory.networks.view_batch import Cameras, Views
from labeling.memory.settings.memory_spec import MemorySpec

UNSEEN_WEIGHT = 0.05
"""Weight in the mean of what a view has not seen but its 3-D network imagines: it counts where no view has seen."""


class Cn3d(nn.Module):
    """Views in, memory, features of pixels and voxels out, of length 1."""

    def __init__(self, spec: MemorySpec) -> None:
        super().__init__()
        self.spec = spec
        self.mapper = ViewMapper(spec.grid, spec.channels)
        self.decoder = PlaneDecoder(spec.grid, spec.channels, spec.planes, spec.width, spec.embedding)
        self.bottom_up = UNet2d(3, spec.embedding, 2 * spec.channels)
        self.voxels_top_down = nn.Conv3d(spec.channels, spec.embedding, 1)
        self.voxels_bottom_up = nn.Conv3d(spec.channels, spec.embedding, 1)

    def remember(self, views: Views) -> SceneMemory:
        """The memory: does not depend on the order of views."""
        return self.merge(self.mapper(views))

    def merge(self, mapped: MappedViews) -> SceneMemory:
        """The memory of views that have been mapped."""
        mean = mean_over_views(mapped.features, mapped.seen + UNSEEN_WEIGHT)
        return SceneMemory(mean, mapped.occupied.amax(dim=1), mapped.seen.amax(dim=1))

    def imagine(self, memory: SceneMemory, cameras: Cameras) -> Float[Tensor, "b t e h2 w2"]:
        """Top-down features of the pixels of views, at half their size."""
        maps = self.decoder(memory.features, cameras, memory.occupied)
        return functional.normalize(maps, dim=1).unflatten(0, cameras.camera_to_grid.shape[:2])

    def look(self, rgb: Float[Tensor, "b t 3 h w"]) -> Float[Tensor, "b t e h2 w2"]:
        """Bottom-up features of the pixels of pictures, at half their size."""
        maps = self.bottom_up(rgb.flatten(0, 1) - 0.5)
        return functional.normalize(maps, dim=1).unflatten(0, rgb.shape[:2])

    def voxel_features(
        self, memory: SceneMemory, seen: MappedViews
    ) -> tuple[Float[Tensor, "b e z y x"], Float[Tensor, "b t e z y x"]]:
        """Features of voxels: top-down from the memory, bottom-up from views by themselves."""
        top_down = functional.normalize(self.voxels_top_down(memory.features), dim=1)
        bottom_up = functional.normalize(self.voxels_bottom_up(seen.features.flatten(0, 1)), dim=1)
        return top_down, bottom_up.unflatten(0, seen.features.shape[:2])

    def forward(self, views: Views, cameras: Cameras) -> Float[Tensor, "b t e h2 w2"]:
        """Top-down features of ``cameras`` from a memory of ``views``."""
        return self.imagine(self.remember(views), cameras)
