"""1x1 convolutions that a single CPU thread computes with oneDNN.

PyTorch gives them to the BLAS library where it computes in one thread and fewer than 16 pictures, and to oneDNN
elsewhere (``ConvParams::use_mkldnn`` in ``aten/src/ATen/native/Convolution.cpp``). The BLAS of its wheels, MKL, uses
AVX2 at most on processors that are not Intel's: on one with AVX-512 ``compact`` spent half of a training step there,
and oneDNN takes half of that. Convolutions that are dilated always go to oneDNN, and a kernel of one pixel is the same
however far apart its pixels are.
"""

import torch
from torch import nn
from torch.nn.functional import conv2d

_LEAST_VALUES = 20480
"""A single picture of no more values than this is never given to oneDNN; dilated, it would take a slow path."""


class PointwiseConv2d(nn.Conv2d):
    """A 1x1 convolution; see the module. Parameters, their names and results are ``torch.nn.Conv2d``'s."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(b, inputs, h, w) to (b, outputs, h, w)."""
        is_taken = x.device.type == "cpu" and (x.shape[0] > 1 or x.numel() > _LEAST_VALUES)
        dilation = 2 if is_taken and torch.backends.mkldnn.is_available() else 1
        return conv2d(x, self.weight, self.bias, self.stride, self.padding, dilation, self.groups)


def use_pointwise(module: nn.Module) -> None:
    """Makes all 1x1 convolutions of a module, and of those in it, ``PointwiseConv2d``."""
    for part in module.modules():
        if type(part) is nn.Conv2d and part.kernel_size == (1, 1) and part.padding_mode == "zeros":
            part.__class__ = PointwiseConv2d
