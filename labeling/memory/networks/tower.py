"""The 2-D baseline: views and poses summed up in maps without geometry, from which a recurrent decoder draws a view.

Source: Eslami et al. 2018, "Neural scene representation and rendering": the tower network, and a generator with
convolutional recurrence. Smaller and deterministic, with depth as a fourth channel, so that it is given what the 3-D
memories are given; as in the comparison of Tung et al. 2019.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from labeling.memory.networks.blocks import ConvBlock2d
from labeling.memory.networks.conv_gru import ConvGru
from labeling.memory.networks.plane_decoder import RgbHead
from labeling.memory.networks.view_batch import Cameras, Views
from labeling.memory.settings.memory_spec import MemorySpec

POSE = 9
"""Numbers of a pose: position in units of the grid's radius, forward and right axes."""
STEPS = 4
"""Of the recurrent decoder."""
WIDTH = 64


def pose_code(cameras: Cameras, radius_m: float) -> Float[Tensor, "b v 9"]:
    """Poses as the tower takes them."""
    pose = cameras.camera_to_grid
    return torch.cat([pose[..., :3, 3] / radius_m, pose[..., :3, 2], pose[..., :3, 0]], dim=-1)


class Tower(nn.Module):
    """Views in, a sum of maps, pictures of other views out."""

    def __init__(self, spec: MemorySpec) -> None:
        super().__init__()
        self.spec = spec
        self.eye = nn.Sequential(ConvBlock2d(4, WIDTH // 2, stride=2), ConvBlock2d(WIDTH // 2, WIDTH, stride=2))
        self.with_pose = nn.Sequential(
            ConvBlock2d(WIDTH + POSE, WIDTH), ConvBlock2d(WIDTH, WIDTH), nn.Conv2d(WIDTH, WIDTH, 1)
        )
        self.update = ConvGru(WIDTH + POSE, WIDTH, dimensions=2)
        self.widen = nn.Sequential(
            nn.Conv2d(WIDTH, 4 * spec.width, 1), nn.PixelShuffle(2), ConvBlock2d(spec.width, spec.width)
        )
        self.head = RgbHead(spec.width)

    def remember(self, views: Views) -> Float[Tensor, "b c h4 w4"]:
        """Mean over views of the towers' maps."""
        batch = views.rgb.shape[:2]
        height, width = views.size
        depth = nn.functional.interpolate(views.depth_m.flatten(0, 1)[:, None], size=(height, width), mode="nearest")
        depth = depth / self.spec.grid.radius_m
        maps = self.eye(torch.cat([views.rgb.flatten(0, 1) - 0.5, depth], dim=1))
        code = pose_code(views, self.spec.grid.radius_m).flatten(0, 1)
        seen = self.with_pose(torch.cat([maps, _spread(code, maps)], dim=1))
        return seen.unflatten(0, batch).mean(dim=1)

    def imagine(self, memory: Float[Tensor, "b c h4 w4"], cameras: Cameras) -> Float[Tensor, "b t 3 h w"]:
        """Logits of the pictures that cameras would take."""
        scenes, views = cameras.camera_to_grid.shape[:2]
        maps = memory.repeat_interleave(views, dim=0)
        code = pose_code(cameras, self.spec.grid.radius_m).flatten(0, 1)
        asked = torch.cat([maps, _spread(code, maps)], dim=1)
        state = torch.zeros_like(maps)
        for _ in range(STEPS):
            state = self.update(asked, state)
        return self.head(self.widen(state)).unflatten(0, (scenes, views))

    def forward(self, views: Views, cameras: Cameras) -> Float[Tensor, "b t 3 h w"]:
        """Logits of pictures of ``cameras`` from ``views``."""
        return self.imagine(self.remember(views), cameras)


def _spread(code: Float[Tensor, "n k"], like: Float[Tensor, "n c h w"]) -> Float[Tensor, "n k h w"]:
    """The same numbers at every pixel."""
    return code[:, :, None, None].expand(-1, -1, *like.shape[2:])
