"""Surfels to images, as a function of PyTorch's autograd."""

import contextlib
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from fastsegsim import InputError, _rasterizer
from fastsegsim.differentiable.camera_gradient import camera_gradient
from fastsegsim.differentiable.native_rasterizers import MOST_KEPT, Rasterizers


class SurfelImages(NamedTuple):
    """Images of height H and width W; of several poses with the views as first axis.

    Sums run over the surfels k of a pixel, front to back, with the weight w_k = alpha_k prod_{j<k} (1 - alpha_j); the
    background is black.
    """

    rgb: Tensor  #: [H, W, 3], sum of w_k max(0, colour_k).
    depth_m: Tensor  #: [H, W], sum of w_k z_k, z along the camera's axis where the ray meets the surfel.
    alpha: Tensor  #: [H, W], sum of w_k.
    normal: Tensor  #: [H, W, 3], sum of w_k n_k, world frame, towards the camera.
    median_m: Tensor  #: [H, W], z of the surfel that brings the light left below 1/2, 0 without one. No gradient.
    distortion: Tensor | None  #: [H, W], sum over i > j of w_i w_j (m_i - m_j)^2 (2DGS, eq. 13), if asked for.
    max_weight: Tensor  #: [surfels], largest w of the surfel in the image; 0: it is not seen. No gradient.


@dataclass
class _Call:
    """What autograd keeps of a call beside tensors."""

    rasterizers: Rasterizers
    size: tuple[int, int]
    active_sh_degree: int
    distortion: bool
    differentiable: bool  # Whether backward() may come.

    def empty_images(self, views: int, like: Tensor) -> list[Tensor]:
        width, height = self.size
        shapes = [(height, width, 3), (height, width), (height, width), (height, width, 3), (height, width)]
        shapes += [(height, width)] if self.distortion else []
        return [like.new_empty((views, *shape)) for shape in shapes]

    def draw(self, number: int, view: int, surfels: list[Tensor], images: list[Tensor], max_weight: Tensor) -> None:
        """Draws a view with the rasterizer of that number."""
        self.rasterizers.numbered(number).forward(surfels, self.active_sh_degree, self.rasterizers.cameras, view,
                                                  images + [None] * (6 - len(images)), max_weight)

    def differentiate(self, view: int, surfels: list[Tensor], by_images: list[Tensor | None], gradients: list[Tensor],
                      screen: Tensor | None) -> None:
        """The derivatives of a view that was drawn, with the rasterizer that still knows it or draws it again."""
        number = min(view, MOST_KEPT)
        with self.rasterizers.redrawing if number == MOST_KEPT else contextlib.nullcontext():
            if number == MOST_KEPT:
                images = [image[0] for image in self.empty_images(1, surfels[0])]
                self.draw(number, view, surfels, images, surfels[0].new_empty(len(surfels[0])))
            self.rasterizers.numbered(number).backward(surfels, self.active_sh_degree, by_images, gradients, screen)

    def present_device(self, like: Tensor) -> contextlib.AbstractContextManager[Any]:
        return torch.cuda.device(like.device) if like.is_cuda else contextlib.nullcontext()


def _plain(tensors: tuple[Tensor, ...]) -> list[Tensor]:
    """As C++ reads them."""
    return [tensor.detach().contiguous() for tensor in tensors]


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, call: _Call, screen_gradient: Tensor | None, T_world_camera: Tensor | None,
                *parameters: Tensor) -> tuple[Tensor | None, ...]:
        del screen_gradient  # Only its gradient is of interest.
        surfels = _plain(parameters)
        views = len(call.rasterizers.cameras)
        images = call.empty_images(views, surfels[0])
        max_weight = surfels[0].new_empty((views, len(surfels[0])))
        for view in range(views):
            with call.present_device(surfels[0]):
                call.draw(min(view, MOST_KEPT) if call.differentiable else 0, view, surfels,
                          [image[view] for image in images], max_weight[view])
        if call.differentiable:
            ctx.call = call
            ctx.save_for_backward(T_world_camera, None if T_world_camera is None else images[3], *parameters)
        ctx.set_materialize_grads(False)
        ctx.mark_non_differentiable(images[4], max_weight)
        return (*images, *([] if call.distortion else [None]), max_weight)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *by_outputs: Tensor | None) -> tuple[Tensor | None, ...]:
        call: _Call = ctx.call
        poses, normal, *parameters = ctx.saved_tensors
        surfels = _plain(parameters)
        by_images = [by_outputs[i] for i in (0, 1, 2, 3, 5)]
        by_images = [None if by is None else by.contiguous() for by in by_images]
        views = len(call.rasterizers.cameras)
        total = [torch.zeros_like(tensor) if views == 0 else torch.empty_like(tensor) for tensor in surfels]
        of_view = [torch.empty_like(tensor) for tensor in surfels] if views > 1 else []
        screen = surfels[0].new_empty((views, len(surfels[0]))) if ctx.needs_input_grad[1] else None
        by_poses = torch.zeros_like(poses) if ctx.needs_input_grad[2] else None
        for view in range(views):
            gradients = of_view if view > 0 else total
            with call.present_device(surfels[0]):
                call.differentiate(view, surfels, [None if by is None else by[view] for by in by_images], gradients,
                                   None if screen is None else screen[view])
            if by_poses is not None:
                by_poses[view] = camera_gradient(surfels, gradients, call.active_sh_degree, poses[view], normal[view],
                                                 None if by_images[3] is None else by_images[3][view])
            if view > 0:
                for sum_of_views, gradient in zip(total, gradients, strict=True):
                    sum_of_views.add_(gradient)
        wanted = ctx.needs_input_grad[3:]
        return (None, screen, by_poses, *(by if want else None for by, want in zip(total, wanted, strict=True)))


def _shape_text(shape: tuple[Any, ...]) -> str:
    return "[" + ", ".join(map(str, shape)) + "]"


def check_tensor(name: str, tensor: Any, shape: tuple[int | str, ...], like: Tensor | None = None) -> None:
    """Raises InputError for another shape (words stand for any length), or for another type or place than `like`."""
    if not isinstance(tensor, Tensor):
        raise InputError(f"{name}: expected a torch.Tensor, found {type(tensor).__name__}")
    if tensor.dim() != len(shape) or any(isinstance(length, int) and length != found
                                         for length, found in zip(shape, tensor.shape, strict=True)):
        raise InputError(f"{name}: expected shape {_shape_text(shape)}, found {_shape_text(tuple(tensor.shape))}")
    if like is not None and (tensor.dtype != like.dtype or tensor.device != like.device):
        raise InputError(f"{name}: expected {like.dtype} on {like.device} as the positions have, "
                         f"found {tensor.dtype} on {tensor.device}")
    if tensor.dtype not in (torch.float32, torch.float64):
        raise InputError(f"{name}: expected float32 or float64, found {tensor.dtype}")


def has_gradient(values: Any) -> bool:
    """Whether a gradient by these values is wanted."""
    return isinstance(values, Tensor) and values.requires_grad and torch.is_grad_enabled()


def camera_array(values: Any) -> Any:
    """Poses or camera matrices for C++, which checks them."""
    return values.detach().to("cpu", torch.float64).contiguous().numpy() if isinstance(values, Tensor) else values


def check_camera_matrices(name: str, values: Any) -> None:
    """Raises NotImplementedError where a gradient by them is wanted."""
    if has_gradient(values):
        raise NotImplementedError(f"{name}: expected a tensor that requires no gradient, as there is none by cameras' "
                                  "focal lengths and principal points")


def _degree(active_sh_degree: int | None, sh: Tensor) -> int:
    stored = {1: 0, 4: 1, 9: 2, 16: 3}.get(sh.shape[1])
    if stored is None:
        raise InputError(f"sh: expected 1, 4, 9 or 16 coefficients of a colour, found {sh.shape[1]}")
    if active_sh_degree is None:
        return stored
    if not 0 <= active_sh_degree <= stored:
        raise InputError(f"active_sh_degree: expected 0 to {stored}, found {active_sh_degree}")
    return active_sh_degree


def rasterize(positions_m: Tensor, log_scales: Tensor, rotations: Tensor, opacity_logits: Tensor, sh: Tensor,
              T_world_camera: Any, K: Any, size: tuple[int, int], *, active_sh_degree: int | None = None,
              distortion: bool = False, screen_gradient: Tensor | None = None, threads: int = 0,
              deterministic: bool = False) -> SurfelImages:
    """Draw surfels, given as the numbers that the 2DGS code trains, so that losses can be differentiated by them.

    positions_m: centres [N, 3] in the world frame, metres.
    log_scales: [N, 2], logarithms of the standard deviations along the surfel's x and y, in metres.
    rotations: quaternions [N, 4], w x y z, of any length but 0; the surfel's normal is its z.
    opacity_logits: [N]; the opacity is 1 / (1 + exp(-logit)).
    sh: spherical harmonics [N, (degree + 1)^2, 3] of degrees 0 to 3; the colour is 0.5 plus their sum.
    T_world_camera, K, size: as of Renderer.render: poses [4, 4] or [V, 4, 4], camera matrices, (width, height). A
        tensor of poses may require gradients: they are along motions that keep it a pose, by whatever the poses are
        made of (torch.linalg.matrix_exp of a twist, say), but not by the twelve numbers freely.
    active_sh_degree: the first degrees alone give the colour; None for all.
    distortion: whether to make that image.
    screen_gradient: zeros [N], or [V, N] of several poses, that require gradients. Their gradient is not one of these
        zeros, but how long the loss's gradient by each surfel's centre on the screen is, in units of half an image: by
        which surfels are split in training.
    threads: on the CPU, 0 for all processors. Nothing but speed depends on it.
    deterministic: on a GPU, gradients are equal to the bit from call to call, and slower; on the CPU they always are.
        So they are where torch.use_deterministic_algorithms(True) was called.

    All tensors are float32, or on the CPU float64. On a GPU the work goes into its current stream. Gradients are exact
    but where alpha is clamped at 0.99, and cannot be differentiated again. Surfels whose numbers are not finite are not
    drawn. Raises InputError, naming the argument.
    """
    check_tensor("positions_m", positions_m, ("N", 3))
    count = len(positions_m)
    named = {"log_scales": (log_scales, (count, 2)), "rotations": (rotations, (count, 4)),
             "opacity_logits": (opacity_logits, (count,)), "sh": (sh, (count, "K", 3))}
    for name, (tensor, shape) in named.items():
        check_tensor(name, tensor, shape, positions_m)
    degree = _degree(active_sh_degree, sh)
    if not 0 <= threads <= 1024:
        raise InputError(f"threads: expected 0 to 1024, found {threads}")
    check_camera_matrices("K", K)
    cameras = _rasterizer.Cameras(camera_array(T_world_camera), camera_array(K), size)
    parameters = (positions_m, log_scales, rotations, opacity_logits, sh)
    if screen_gradient is not None:
        shape = (len(cameras), count) if cameras.batch else (count,)
        check_tensor("screen_gradient", screen_gradient, shape, positions_m)
        if not screen_gradient.requires_grad:
            raise InputError("screen_gradient: expected a tensor that requires gradients, found one that does not")
        screen_gradient = screen_gradient if cameras.batch else screen_gradient[None]
    pose = None
    if has_gradient(T_world_camera):
        pose = T_world_camera if cameras.batch else T_world_camera[None]
    differentiable = any(map(has_gradient, (T_world_camera, screen_gradient, *parameters)))
    deterministic = deterministic or torch.are_deterministic_algorithms_enabled()
    call = _Call(Rasterizers(cameras, positions_m, threads, deterministic), size, degree, distortion, differentiable)
    images = _Rasterize.apply(call, screen_gradient, pose, *parameters)
    return SurfelImages(*(image if cameras.batch or image is None else image[0] for image in images))
