"""Normals of depth images."""

from typing import Any

import torch
from torch import Tensor

from fastsegsim import InputError
from fastsegsim.differentiable.rasterize import check_tensor


def depth_normals(depth_m: Tensor, T_world_camera: Any, K: Any) -> Tensor:
    """Normals [H, W, 3] of the surface that a depth image [H, W] shows: world frame, unit, towards the camera.

    They are those of the points that lie left, right, above and below of a pixel; the outermost pixels have none, which
    is 0. depth_m holds metres along the camera's z. T_world_camera: [4, 4], K: [3, 3]. With the views as first axis,
    [V, H, W] and [V, 4, 4] and [3, 3] or [V, 3, 3].
    """
    if isinstance(depth_m, Tensor) and depth_m.dim() == 2:
        return depth_normals(depth_m[None], torch.as_tensor(T_world_camera)[None], K)[0]
    check_tensor("depth_m", depth_m, ("V", "H", "W"))
    views, height, width = depth_m.shape
    pose = torch.as_tensor(T_world_camera).to(depth_m)
    camera = torch.as_tensor(K).to(depth_m)
    check_tensor("T_world_camera", pose, (views, 4, 4))
    if camera.dim() == 2:
        camera = camera[None]
    if camera.shape not in ((1, 3, 3), (views, 3, 3)):
        raise InputError(f"K: expected shape [3, 3] or [{views}, 3, 3], found {list(camera.shape)}")

    x = torch.arange(width, dtype=depth_m.dtype, device=depth_m.device) + 0.5
    y = torch.arange(height, dtype=depth_m.dtype, device=depth_m.device) + 0.5
    across = (x - camera[:, 0, 2, None]) / camera[:, 0, 0, None]
    down = (y - camera[:, 1, 2, None]) / camera[:, 1, 1, None]
    points = torch.stack([across[:, None, :] * depth_m, down[:, :, None] * depth_m, depth_m], dim=-1)
    to_right = points[:, 1:-1, 2:] - points[:, 1:-1, :-2]
    to_below = points[:, 2:, 1:-1] - points[:, :-2, 1:-1]
    inside = torch.nn.functional.normalize(torch.linalg.cross(to_below, to_right), dim=-1)
    inside = inside @ pose[:, None, :3, :3].transpose(-1, -2)
    return torch.nn.functional.pad(inside, (0, 0, 1, 1, 1, 1))
