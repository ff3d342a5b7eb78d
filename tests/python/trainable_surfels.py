"""Small sets of surfels as tensors, and cameras that see them."""

import pathlib

import numpy as np
import torch
from torch import Tensor

import fastsegsim

# Tensors are small here; beside other programs, several threads of PyTorch take a hundred times as long as one.
torch.set_num_threads(1)
PARAMETERS = ("positions_m", "log_scales", "rotations", "opacity_logits", "sh")
#: Two cameras with the z axis of the world ahead of the first one.
T_WORLD_CAMERA = np.stack([np.eye(4), fastsegsim.look_at((0.3, -0.2, -0.4), (0.0, 0.1, 2.0))])


def random_surfels(count: int, dtype: torch.dtype = torch.float64, sh_degree: int = 1, seed: int = 3) -> list[Tensor]:
    """Leaves in the order of rasterize(), 1.5 to 2.5 m along z."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    positions_m = torch.stack([uniform(count) * 1.6 - 0.8, uniform(count) * 1.2 - 0.6, 1.5 + uniform(count)], dim=1)
    log_scales = torch.log(0.1 + 0.2 * uniform(count, 2))
    drawn = (positions_m, log_scales, normal(count, 4), normal(count), 0.3 * normal(count, (sh_degree + 1) ** 2, 3))
    return [values.to(dtype).requires_grad_() for values in drawn]


def hat(twists: Tensor) -> Tensor:
    """[N, 4, 4] whose exponentials are motions by twists [N, 6], translation first."""
    zero = torch.zeros_like(twists[:, 0])
    x, y, z, a, b, c = twists.unbind(-1)
    rows = [(zero, -c, b, x), (c, zero, -a, y), (-b, a, zero, z), (zero,) * 4]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def read_surfels(file: pathlib.Path) -> list[Tensor]:
    """What a file in the layout of the 2DGS code holds, float32, without harmonics above degree 0."""
    data = file.read_bytes()
    header, _, rows = data.partition(b"end_header\n")
    words = [line.split() for line in header.decode().splitlines()]
    kinds = {"float": "<f4", "ushort": "<u2"}
    table = np.frombuffer(rows, [(line[2], kinds[line[1]]) for line in words if line[0] == "property"])

    def columns(*names: str) -> Tensor:
        return torch.from_numpy(np.stack([table[name].astype(np.float32) for name in names], axis=1))

    return [columns("x", "y", "z"), columns("scale_0", "scale_1"), columns(*(f"rot_{k}" for k in range(4))),
            columns("opacity")[:, 0].contiguous(), columns(*(f"f_dc_{k}" for k in range(3)))[:, None].contiguous()]
