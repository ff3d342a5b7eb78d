"""The function that gsplat calls rasterization_2dgs, over our rasterizer."""

from typing import Any

import torch
from torch import Tensor

from fastsegsim import InputError
from fastsegsim.differentiable.camera_gradient import SH_C0
from fastsegsim.differentiable.depth_normals import depth_normals
from fastsegsim.differentiable.native_rasterizers import NEAR_M
from fastsegsim.differentiable.rasterize import (SurfelImages, camera_array, check_camera_matrices, check_tensor,
                                                 has_gradient, rasterize)

_RENDER_MODES = ("RGB", "D", "ED", "RGB+D", "RGB+ED")
_LEAST_ALPHA = 1e-10  # By which depth is divided.
#: Values of arguments that change what is drawn, or what comes back, and that are the only ones here.
_ONLY = {"far_plane": (1e10, "nothing is too far to be drawn"),
         "radius_clip": (0.0, "no surfel is too small to be drawn"),
         "eps2d": (0.3, "it does nothing to surfels, whose low pass is fixed"),
         "packed": (False, "images would be the same"),
         "tile_size": (16, "images would be the same"),
         "sparse_grad": (False, "gradients are dense"),
         "absgrad": (False, "there are no absolute gradients")}


class _Meta(dict[str, Any]):
    """Says what is there when something else is asked for."""

    def __missing__(self, key: str) -> Any:
        raise KeyError(f"meta: expected {', '.join(self)}, found {key} "
                       "(docs/python_training.md has the differences from gsplat)")


class _Inside(torch.autograd.Function):
    """A number brought into a range; its gradient passes as if it had been inside."""

    @staticmethod
    def forward(ctx: Any, value: Tensor, least: float, most: float) -> Tensor:
        return value.clamp(least, most)

    @staticmethod
    def backward(ctx: Any, by_output: Tensor) -> tuple[Tensor, None, None]:
        return by_output, None, None


def _log_scales(scales: Tensor) -> Tensor:
    return torch.log(_Inside.apply(scales[:, :2], torch.finfo(scales.dtype).tiny, torch.inf))


def _opacity_logits(opacities: Tensor) -> Tensor:
    # Opacities below 1/255 are not drawn. Above, it is 1 - opacity that must not lose its digits.
    most = 1.0 - torch.finfo(opacities.dtype).eps * 128
    return torch.logit(_Inside.apply(opacities, 1e-6, most))


def _world_from_camera(viewmats: Tensor) -> Tensor:
    """T_world_camera [C, 4, 4] of view matrices, which C++ then checks for being rigid."""
    matrices = viewmats.to("cpu", torch.float64)
    rotation = matrices[:, :3, :3].transpose(1, 2)
    return torch.cat([torch.cat([rotation, -rotation @ matrices[:, :3, 3:]], dim=2), matrices[:, 3:]], dim=1)


def _check(means: Tensor, quats: Tensor, scales: Tensor, opacities: Tensor, colors: Tensor, viewmats: Tensor,
           Ks: Tensor, sh_degree: int | None, backgrounds: Tensor | None) -> None:
    check_tensor("means", means, ("N", 3))
    count = len(means)
    check_tensor("quats", quats, (count, 4), means)
    check_tensor("scales", scales, (count, 2 if scales.shape[-1:] == (2,) else 3), means)
    check_tensor("opacities", opacities, (count,), means)
    check_tensor("viewmats", viewmats, ("C", 4, 4))
    check_tensor("Ks", Ks, (len(viewmats), 3, 3))
    if sh_degree is not None:
        check_tensor("colors", colors, (count, "K", 3), means)
        if not 0 <= sh_degree <= 3:
            raise NotImplementedError(f"sh_degree: expected 0 to 3 or None, found {sh_degree}")
        if (sh_degree + 1) ** 2 > colors.shape[1]:
            raise InputError(f"sh_degree: expected {(sh_degree + 1) ** 2} coefficients in colors, "
                             f"found {colors.shape[1]}")
    else:
        per_camera = isinstance(colors, Tensor) and colors.dim() == 3
        check_tensor("colors", colors, (len(viewmats), count, "D") if per_camera else (count, "D"), means)
        if colors.shape[-1] == 0:
            raise InputError("colors: expected at least one channel, found none")
    if backgrounds is not None:
        check_tensor("backgrounds", backgrounds, (len(viewmats), 3 if sh_degree is not None else colors.shape[-1]),
                     means)


def _images_of_channels(colors: Tensor, parameters: tuple[Tensor, ...], cameras: tuple[Any, ...],
                        options: dict[str, Any]) -> tuple[Tensor, SurfelImages]:
    """Images of as many channels as colors [N, D] have, three in each pass; the rest is that of the first pass."""
    with torch.no_grad():
        # Our rasterizer clamps colours at 0, through which no gradient flows: above it they pass as they are.
        lowest = float(colors.min()) if colors.numel() else 1.0
    shift = 0.5 - lowest if lowest <= 0.0 else 0.0
    passes, first = [], None
    for channel in range(0, colors.shape[-1], 3):
        three = colors[:, channel:channel + 3]
        missing = 3 - three.shape[-1]
        sh = (torch.nn.functional.pad(three, (0, missing)) + (shift - 0.5)) / SH_C0
        images = rasterize(*parameters, sh[:, None], *cameras, **options)
        passes.append(images.rgb[..., :3 - missing] - shift * images.alpha[..., None])
        if first is None:
            first = images
            options = {**options, "distortion": False, "screen_gradient": None}
    assert first is not None
    return torch.cat(passes, dim=-1), first


def _draw(parameters: tuple[Tensor, ...], colors: Tensor, sh_degree: int | None, pose: Any, Ks: Any,
          size: tuple[int, int], options: dict[str, Any]) -> tuple[Tensor, SurfelImages]:
    if sh_degree is not None:
        coefficients = colors[:, :(sh_degree + 1) ** 2]
        images = rasterize(*parameters, coefficients, pose, Ks, size, **options)
        return images.rgb, images
    if colors.dim() == 2:
        return _images_of_channels(colors, parameters, (pose, Ks, size), options)
    screen = options.get("screen_gradient")
    drawn = [_images_of_channels(colors[c], parameters, (pose[c:c + 1], Ks[c:c + 1], size),
                                 {**options, "screen_gradient": None if screen is None else screen[c:c + 1]})
             for c in range(len(colors))]
    images = SurfelImages(*(None if parts[0] is None else torch.cat(parts)
                            for parts in zip(*(images for _, images in drawn), strict=True)))
    return torch.cat([channels for channels, _ in drawn]), images


def rasterization_2dgs(means: Tensor, quats: Tensor, scales: Tensor, opacities: Tensor, colors: Tensor,
                       viewmats: Tensor, Ks: Tensor, width: int, height: int, near_plane: float = NEAR_M,
                       far_plane: float = 1e10, radius_clip: float = 0.0, eps2d: float = 0.3,
                       sh_degree: int | None = None, packed: bool = False, tile_size: int = 16,
                       backgrounds: Tensor | None = None, render_mode: str = "RGB", sparse_grad: bool = False,
                       absgrad: bool = False, distloss: bool = False, depth_mode: str = "expected", *, threads: int = 0,
                       deterministic: bool = False,
                       ) -> tuple[Tensor, Tensor, Tensor, Tensor | None, Tensor | None, Tensor, dict[str, Any]]:
    """Draw surfels that are given as gsplat's function of this name takes them.

    means [N, 3], quats [N, 4] (w x y z), scales [N, 3] or [N, 2] (metres; a third one is not used), opacities [N].
    colors: [N, D] or [C, N, D], or with sh_degree harmonics [N, K, 3]. More than three channels take as many passes.
    viewmats: T_camera_world [C, 4, 4], with gradients as poses of rasterize() have them; Ks: [C, 3, 3].
    backgrounds: [C, D], seen through what is not opaque.
    render_mode: "RGB", "D" (sum of weights times depth), "ED" (mean depth), "RGB+D" or "RGB+ED", depth as last channel.
    distloss: whether to make the image of distortion.
    depth_mode: which depth the normals of depth are of, "expected" or, where no gradient is wanted, "median".
    threads, deterministic: as of rasterize().

    Returns colours [C, H, W, X], alphas [C, H, W, 1], normals [C, H, W, 3], normals of depth [C, H, W, 3] (None without
    depth and colour), distortion [C, H, W, 1] (None without distloss), median depth [C, H, W, 1] (no gradient), and a
    dict: width, height, n_cameras, tile_size, max_weight [C, N] (0: the surfel is not seen), and screen_gradient
    [C, N], whose gradient after backward() is by what surfels are split (None where no gradient is wanted).

    Values of the other arguments that we do not have raise NotImplementedError; what is wrong raises InputError.
    docs/python_training.md lists the differences from gsplat.
    """
    given = {"far_plane": far_plane, "radius_clip": radius_clip, "eps2d": eps2d, "packed": packed,
             "tile_size": tile_size, "sparse_grad": sparse_grad, "absgrad": absgrad}
    for name, (only, why) in _ONLY.items():
        if given[name] != only:
            raise NotImplementedError(f"{name}: expected {only} ({why}), found {given[name]}")
    if abs(near_plane - NEAR_M) > 1e-6:
        raise NotImplementedError(f"near_plane: expected {NEAR_M:.2f}, which is fixed, found {near_plane}")
    for name, value, choices in (("render_mode", render_mode, _RENDER_MODES),
                                 ("depth_mode", depth_mode, ("expected", "median"))):
        if value not in choices:
            raise InputError(f"{name}: expected {' | '.join(choices)}, found {value}")
    _check(means, quats, scales, opacities, colors, viewmats, Ks, sh_degree, backgrounds)
    check_camera_matrices("Ks", Ks)
    differentiable = any(map(has_gradient, (means, quats, scales, opacities, colors, viewmats)))
    if depth_mode == "median" and differentiable:
        raise NotImplementedError("depth_mode: expected expected where gradients are wanted, as the median depth has "
                                  "none, found median")

    screen = means.new_zeros((len(viewmats), len(means)), requires_grad=True) if differentiable else None
    parameters = (means, _log_scales(scales), quats, _opacity_logits(opacities))
    options = {"distortion": distloss, "screen_gradient": screen, "threads": threads, "deterministic": deterministic}
    pose, cameras = _world_from_camera(viewmats), camera_array(Ks)
    channels, images = _draw(parameters, colors, sh_degree, pose, cameras, (width, height), options)

    alphas, depth_m = images.alpha[..., None], images.depth_m[..., None]
    expected_m = depth_m / alphas.clamp(min=_LEAST_ALPHA)
    if backgrounds is not None:
        channels = channels + (1.0 - alphas) * backgrounds[:, None, None, :]
    shown = [channels] if render_mode.startswith("RGB") else []
    if render_mode != "RGB":
        shown.append(expected_m if render_mode.endswith("ED") else depth_m)
    surface_normals = None
    if len(shown) == 2:
        surface_m = expected_m[..., 0] if depth_mode == "expected" else images.median_m
        surface_normals = depth_normals(surface_m, pose, cameras)
    meta = _Meta(width=width, height=height, n_cameras=len(viewmats), tile_size=tile_size,
                 max_weight=images.max_weight, screen_gradient=screen)
    distortion = None if images.distortion is None else images.distortion[..., None]
    return (torch.cat(shown, dim=-1), alphas, images.normal, surface_normals, distortion, images.median_m[..., None],
            meta)
