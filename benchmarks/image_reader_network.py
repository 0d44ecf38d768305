"""The network of the reader of images as torch trains it, and how it becomes the weights that Sounding runs.

Between each convolution of 3 x 3 and its max(x, 0) stands a batch normalisation, which is folded into the convolution
when training is over.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from sim.world.sensing.image_reader.frames import N_CHANNELS


class Convolution(nn.Module):
    """A convolution of 3 x 3 with its normalisation and max(x, 0)."""

    def __init__(self, n_in: int, n_out: int) -> None:
        super().__init__()
        self.weigh = nn.Conv2d(n_in, n_out, 3, padding=1, bias=False)
        self.norm = nn.BatchNorm2d(n_out)

    def forward(self, maps: torch.Tensor) -> torch.Tensor:
        return functional.relu(self.norm(self.weigh(maps)), inplace=True)

    def folded(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Weights and biases of the convolution with the normalisation in them."""
        norm = self.norm
        assert norm.running_var is not None
        assert norm.running_mean is not None
        factor = norm.weight / torch.sqrt(norm.running_var + norm.eps)
        bias = norm.bias - norm.running_mean * factor
        return (self.weigh.weight * factor[:, None, None, None]).detach().numpy(), bias.detach().numpy()


class Network(nn.Module):
    """The network of sim/world/sensing/image_reader/network.py."""

    def __init__(self, widths: tuple[int, ...]) -> None:
        super().__init__()
        before = (N_CHANNELS, *widths[:-1])
        self.down = nn.ModuleList(
            nn.Sequential(Convolution(a, b), Convolution(b, b)) for a, b in zip(before, widths, strict=True)
        )
        self.mix = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in pairwise(widths))
        self.up = nn.ModuleList(Convolution(width, width) for width in widths[:-1])
        self.head = nn.Conv2d(widths[0], 1, 1)

    def forward(self, frames: torch.Tensor) -> torch.Tensor:
        """The answers for frames, shape (N, rows, columns)."""
        levels, maps = [], frames
        for n, down in enumerate(self.down):
            maps = down(functional.max_pool2d(maps, 2) if n else maps)
            levels.append(maps)
        for mix, up, skipped in reversed(list(zip(self.mix, self.up, levels, strict=False))):
            maps = up(skipped + functional.interpolate(mix(maps), scale_factor=2))
        return self.head(maps)[:, 0]

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """The numbers by the names of `shapes_of`, normalisations folded in."""
        arrays = {}
        for level, pair in enumerate(self.down):
            for n, convolution in enumerate(pair):
                arrays[f"down{level}.{n}.weight"], arrays[f"down{level}.{n}.bias"] = convolution.folded()
        for level, (mix, up) in enumerate(zip(self.mix, self.up, strict=True)):
            arrays[f"mix{level}.weight"] = mix.weight.detach().numpy()[:, :, 0, 0]
            arrays[f"mix{level}.bias"] = mix.bias.detach().numpy()
            arrays[f"up{level}.weight"], arrays[f"up{level}.bias"] = up.folded()
        arrays["head.weight"] = self.head.weight.detach().numpy()[0, :, 0, 0]
        arrays["head.bias"] = self.head.bias.detach().numpy()
        return {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in arrays.items()}
