"""How a loss changes with the camera, from how it changes with the surfels.

A camera that moves and surfels that move the other way about its eye c give the same images, so that the rasterizer
needs to know of no poses (reconstruction/training/internal/pose_gradient.h has the formula). Three things do not move
with the surfels, and are put right: the quaternions turn with them, colours depend on the direction of view in the
world, and images of normals are in the world frame.
"""

import torch
from torch import Tensor

SH_C0 = 0.28209479177387814  # The harmonic of degree 0, which knows no direction.


def _harmonics(direction: Tensor, degree: int) -> Tensor:
    """Those of degrees 1 to 3, as renderer/scene/surfel_geometry.h has them: [N, (degree + 1)^2 - 1]."""
    x, y, z = direction.unbind(-1)
    values = [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    xx, yy, zz = x * x, y * y, z * z
    if degree > 1:
        values += [1.0925484305920792 * x * y, -1.0925484305920792 * y * z, 0.31539156525252005 * (2 * zz - xx - yy),
                   -1.0925484305920792 * x * z, 0.5462742152960396 * (xx - yy)]
    if degree > 2:
        values += [-0.5900435899266435 * y * (3 * xx - yy), 2.890611442640554 * x * y * z,
                   -0.4570457994644658 * y * (4 * zz - xx - yy), 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
                   -0.4570457994644658 * x * (4 * zz - xx - yy), 1.445305721320277 * z * (xx - yy),
                   -0.5900435899266435 * x * (xx - 3 * yy)]
    return torch.stack(values, dim=-1)


def _torque_by_colours(offset_m: Tensor, sh: Tensor, by_sh: Tensor, degree: int) -> Tensor:
    """What colours would add to the torque if they did not turn with the surfels."""
    direction = torch.nn.functional.normalize(offset_m, dim=-1).requires_grad_()
    by_colour = by_sh[:, 0] / SH_C0
    with torch.enable_grad():
        harmonics = _harmonics(direction, degree)
        used = sh[:, 1:1 + harmonics.shape[1]]
        total = torch.einsum("nk,nkc,nc->", harmonics, used, by_colour)
    [slope] = torch.autograd.grad(total, direction)
    return torch.linalg.cross(direction.detach(), slope)


def camera_gradient(surfels: list[Tensor], gradients: list[Tensor], active_sh_degree: int, T_world_camera: Tensor,
                    normal: Tensor, by_normal: Tensor | None) -> Tensor:
    """By the pose [4, 4], from those of one view by the surfels: along motions that keep it a pose.

    normal: the image of normals, and the loss's derivative by it.
    """
    positions_m, _, rotations, _, sh = (values.double() for values in surfels)
    by_positions, _, by_rotations, _, by_sh = (values.double() for values in gradients)
    pose = T_world_camera.to(positions_m)
    offset_m = positions_m - pose[:3, 3]
    finite = torch.isfinite(offset_m).all(dim=-1, keepdim=True)
    offset_m = torch.where(finite, offset_m, 1.0)  # What is not drawn has no gradient, but NaN times 0 would be NaN.
    torque = torch.linalg.cross(offset_m, by_positions)
    w, v = rotations[:, :1].nan_to_num(), rotations[:, 1:].nan_to_num()
    by_w, by_v = by_rotations[:, :1], by_rotations[:, 1:]
    torque += 0.5 * (w * by_v - by_w * v + torch.linalg.cross(v, by_v))
    if active_sh_degree > 0:
        torque -= _torque_by_colours(offset_m, sh.nan_to_num(), by_sh, active_sh_degree)
    by_turn = -torque.sum(dim=0)
    if by_normal is not None:
        by_turn += torch.linalg.cross(normal.double(), by_normal.double()).sum(dim=(0, 1))
    # <by_pose, [turn]x R> = by_turn . turn for every small turn.
    by_pose = torch.zeros(4, 4, dtype=torch.float64, device=pose.device)
    by_pose[:3, :3] = 0.5 * torch.linalg.cross(by_turn[:, None].expand(3, 3), pose[:3, :3], dim=0)
    by_pose[:3, 3] = -by_positions.sum(dim=0)
    return by_pose
