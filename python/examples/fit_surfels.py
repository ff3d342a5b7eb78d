#!/usr/bin/env python3
"""Fits new surfels to the images of a scene, by gradients of PyTorch.

  fit_surfels.py SCENE [--surfels 4000] [--steps 300] [--size 160 120] [--device cpu] [--output fitted.ply]

SCENE is the folder of a bundle, whose cameras take the images. The new surfels begin anywhere in the scene, grey and
faint; depth of the scene's images helps them to their places. Writes a file that `segsim render` and Scene.load read.
"""

import argparse
import sys

import numpy as np
import torch

import fastsegsim
from fastsegsim.differentiable import rasterize


def photographs(scene: fastsegsim.Scene, size: tuple[int, int]):
    """Poses, camera matrix, colours and depths (NaN without a surface) of up to sixteen of its cameras."""
    recording = scene.recording
    if recording is None:
        raise fastsegsim.InputError(f"{scene.path}: expected a bundle that knows its cameras, found one that does not")
    poses = recording.T_world_camera
    poses = poses[np.linspace(0, len(poses) - 1, min(16, len(poses))).round().astype(int)]
    K = recording.K * np.array([[size[0] / recording.size[0]], [size[1] / recording.size[1]], [1.0]])
    images = fastsegsim.Renderer(scene, backend="cpu").render(poses, K, size, ("rgb", "depth"))
    return poses, K, torch.from_numpy(images["rgb"]).float() / 255, torch.from_numpy(images["depth"])


def anywhere(scene: fastsegsim.Scene, count: int, device: str) -> dict[str, torch.Tensor]:
    """Grey surfels of a third of the distance between them."""
    random = torch.Generator().manual_seed(1)
    least, most = (torch.from_numpy(np.quantile(scene.positions_m, q, axis=0)).float() for q in (0.01, 0.99))
    spacing_m = float((most - least).clamp(min=0.01).prod()) ** (1 / 3) / count ** (1 / 3)
    surfels = {"positions_m": least + (most - least) * torch.rand(count, 3, generator=random),
               "log_scales": torch.full((count, 2), float(np.log(spacing_m / 3))),
               "rotations": torch.randn(count, 4, generator=random),
               "opacity_logits": torch.full((count,), -1.0),
               "sh": torch.zeros(count, 1, 3)}
    return {name: values.to(device).requires_grad_() for name, values in surfels.items()}


def fit(surfels: dict[str, torch.Tensor], views, size: tuple[int, int], steps: int) -> tuple[float, float]:
    """Trains the surfels; returns the mean loss of the first and of the last twentieth of the steps."""
    poses, K, colours, depths = views
    rates = {"positions_m": 0.01, "log_scales": 0.02, "rotations": 0.02, "opacity_logits": 0.05, "sh": 0.05}
    optimiser = torch.optim.Adam([{"params": [surfels[name]], "lr": rate} for name, rate in rates.items()])
    losses = []
    for step in range(steps):
        view = step % len(poses)
        colour, depth_m = (images[view].to(surfels["sh"].device) for images in (colours, depths))
        optimiser.zero_grad()
        images = rasterize(**surfels, T_world_camera=poses[view], K=K, size=size)
        loss = (images.rgb - colour).abs().mean()
        # Zeros take the place of NaN before anything is computed: a gradient of 0 times NaN would be NaN.
        wrong_m = images.depth_m - images.alpha * depth_m.nan_to_num()
        loss = loss + 0.1 * (wrong_m * torch.isfinite(depth_m)).abs().mean()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    part = max(1, steps // 20)
    return float(np.mean(losses[:part])), float(np.mean(losses[-part:]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--surfels", type=int, default=4000)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--size", type=int, nargs=2, default=(160, 120))
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--output", default="fitted.ply")
    arguments = parser.parse_args()

    scene, size = fastsegsim.Scene.load(arguments.scene), tuple(arguments.size)
    surfels = anywhere(scene, arguments.surfels, arguments.device)
    first, last = fit(surfels, photographs(scene, size), size, arguments.steps)
    fitted = fastsegsim.Scene.from_parameters(**{name: values.detach().cpu() for name, values in surfels.items()})
    fitted.save(arguments.output)
    print(f"{arguments.output}: {fitted.surfels} surfels, loss {first:.4f} at first, {last:.4f} at last")


if __name__ == "__main__":
    try:
        main()
    except fastsegsim.InputError as error:
        sys.exit(f"fit_surfels.py: {error}")
