#!/usr/bin/env python3
"""Compares a GPU's images and gradients with the CPU's and with differences, and measures times.

  gpu_check.py [--record FILE] [--quick]

The package must be on the path of Python, built with CUDA, and PyTorch must see a GPU. Prints a line for each check;
exit code 1 if one fails, 2 where there is no GPU. --record writes the times as JSON; --quick leaves them out.
"""

import argparse
import json
import pathlib
import sys
import tempfile
import time

import numpy as np
import torch

import fastsegsim
from fastsegsim import differentiable
from fastsegsim.differentiable import rasterization_2dgs, rasterize
from surfel_files import write_room
from trainable_surfels import PARAMETERS, T_WORLD_CAMERA, random_surfels, read_surfels

SMOOTH = ("rgb", "depth_m", "alpha", "normal", "distortion")
GPU = torch.device("cuda", 0)


class Checks:
    """Says what held and what did not."""

    def __init__(self):
        self.failed = 0

    def that(self, what, holds, found=""):
        """One line for a check."""
        self.failed += not holds
        print(f"{'ok    ' if holds else 'FAILED'} {what}{f': {found}' if found != '' else ''}", flush=True)

    def close(self, what, found, expected, tolerance):
        """Differences must be below the tolerance times the largest value.

        One of a thousand may not be: in a pixel rounding decides whether a surfel has 1/255 of its light, or which one
        is the median.
        """
        found, expected = found.detach().double().cpu(), expected.detach().double().cpu()
        largest = float(expected.abs().max())
        differences = (found - expected).abs() / (largest or 1.0)
        beyond = int((differences > tolerance).sum())
        self.that(what, largest > 0 and beyond * 1000 <= differences.numel() and bool(torch.isfinite(found).all()),
                  f"differ by {float(differences.max()):.1e} of the largest value"
                  f"{f', {beyond} of {differences.numel()} too much' if beyond else ''}")


def leaves_on(surfels, device, dtype):
    return [values.detach().to(device, dtype).requires_grad_() for values in surfels]


def weights_of(images, seed=5):
    """Random derivatives by every smooth image, the same for every type and place."""
    generator = torch.Generator().manual_seed(seed)
    return {name: torch.randn(getattr(images, name).shape, generator=generator, dtype=torch.float64) for name in SMOOTH}


def total_of(images, weights):
    return sum((getattr(images, name) * weight.to(images.rgb)).sum() for name, weight in weights.items())


def check_gradients(checks):
    """Images and gradients of one call with two cameras, against the CPU in double precision."""
    size, camera = (96, 72), fastsegsim.pinhole((96, 72), 1.0)
    surfels = random_surfels(300, torch.float32, sh_degree=3)
    found = {}
    for name, device, dtype in (("cpu", "cpu", torch.float64), ("gpu", GPU, torch.float32)):
        leaves = leaves_on(surfels, device, dtype)
        screen = torch.zeros(2, 300, dtype=dtype, device=device, requires_grad=True)
        images = rasterize(*leaves, T_WORLD_CAMERA, camera, size, distortion=True, screen_gradient=screen)
        total_of(images, weights_of(images)).backward()
        found[name] = (images, {**dict(zip(PARAMETERS, leaves, strict=True)), "screen_gradient": screen})
    for name in (*SMOOTH, "median_m", "max_weight"):
        checks.close(f"image {name} is the CPU's", getattr(found["gpu"][0], name), getattr(found["cpu"][0], name), 2e-3)
    for name in found["gpu"][1]:
        checks.close(f"gradient by {name} is the CPU's", found["gpu"][1][name].grad, found["cpu"][1][name].grad, 2e-3)


def check_differences(checks):
    """The slope of a loss along the parameters' gradients, by differences of what the GPU draws.

    Single precision wants large steps, over which surfels begin and end to reach pixels, by 1/255 of their light: a
    loss that changes little from pixel to pixel averages that, and 4 % are left (measured on the CPU, too).
    """
    size, camera = (64, 48), fastsegsim.pinhole((64, 48), 1.0)
    surfels = leaves_on(random_surfels(20), GPU, torch.float32)
    with torch.no_grad():  # Not seen from the side, where a small turn changes much.
        surfels[2].mul_(0.3).add_(torch.tensor([1.0, 0.0, 0.0, 0.0], device=GPU))
    ramp = torch.linspace(0.5, 1.5, 64, device=GPU) * torch.linspace(1.2, 0.8, 48, device=GPU)[:, None]

    def loss(parameters):
        images = rasterize(*parameters, np.eye(4), camera, size, distortion=True)
        parts = [getattr(images, name).double() for name in SMOOTH]
        weights = parts[0].new_tensor([0.5, 1.0, 1.5])
        return sum((ramp * (part if part.dim() == 2 else part @ weights)).sum() for part in parts)

    gradients = torch.autograd.grad(loss(surfels), surfels)
    for k, name in enumerate(PARAMETERS):
        direction = gradients[k] / gradients[k].norm()
        step = 1e-3
        with torch.no_grad():
            moved = [loss([*surfels[:k], surfels[k] + sign * step * direction, *surfels[k + 1:]]) for sign in (1, -1)]
        slope = float(moved[0] - moved[1]) / (2 * step)
        expected = float(gradients[k].norm())
        checks.that(f"gradient by {name} is that of differences", abs(slope - expected) <= 0.06 * expected,
                    f"{expected:.5g} and {slope:.5g}")


def check_streams(checks):
    """Work goes into the present stream: what comes before it there is waited for, and nothing else."""
    size, camera = (96, 72), fastsegsim.pinhole((96, 72), 1.0)
    surfels = leaves_on(random_surfels(300), GPU, torch.float32)
    expected = rasterize(*surfels, np.eye(4), camera, size)
    expected_by = torch.autograd.grad(expected.rgb.square().sum(), surfels)
    torch.cuda.synchronize()
    stream = torch.cuda.Stream(GPU)
    with torch.cuda.stream(stream):
        late = [torch.zeros_like(values).fill_(0.5) for values in surfels]
        torch.cuda._sleep(200_000_000)  # A tenth of a second.
        for values, source in zip(late, surfels, strict=True):
            values.copy_(source.detach())
            values.requires_grad_()
        images = rasterize(*late, np.eye(4), camera, size)
        by_late = torch.autograd.grad(images.rgb.square().sum(), late)
        sums = [float(values.double().sum()) for values in by_late]  # Waits for this stream alone.
    checks.that("images of a stream", torch.equal(images.rgb, expected.rgb))
    for name, found, by in zip(PARAMETERS, sums, expected_by, strict=True):
        total, size_of_terms = float(by.double().sum()), float(by.double().abs().sum())
        checks.that(f"gradient by {name} of a stream", abs(found - total) <= 1e-4 * size_of_terms,
                    f"{found:.6g} and {total:.6g}")


def check_repetition(checks):
    """Equal bits with deterministic=True; memory that is used again; several cameras as one after the other."""
    size, camera = (96, 72), fastsegsim.pinhole((96, 72), 1.0)
    surfels = leaves_on(random_surfels(300), GPU, torch.float32)

    def gradients(poses):
        images = rasterize(*surfels, poses, camera, size, deterministic=True)
        return images, torch.autograd.grad(images.rgb.square().sum(), surfels)

    (first, by_first), (second, by_second) = gradients(T_WORLD_CAMERA), gradients(T_WORLD_CAMERA)
    checks.that("equal images", torch.equal(first.rgb, second.rgb))
    checks.that("equal gradients", all(torch.equal(a, b) for a, b in zip(by_first, by_second, strict=True)))
    singles = [gradients(pose) for pose in T_WORLD_CAMERA]
    checks.that("several cameras: images", torch.equal(first.rgb, torch.stack([images.rgb for images, _ in singles])))
    for k, name in enumerate(PARAMETERS):
        checks.close(f"several cameras: gradient by {name}", by_first[k], singles[0][1][k] + singles[1][1][k], 1e-5)
    many, by_many = gradients(np.concatenate([T_WORLD_CAMERA] * 6))  # More than keep their memory.
    checks.that("many cameras: images", torch.equal(many.rgb, first.rgb.repeat(6, 1, 1, 1)))
    for k, name in enumerate(PARAMETERS):
        checks.close(f"many cameras: gradient by {name}", by_many[k], 6 * by_first[k], 1e-5)
    del many
    differentiable.release_memory()
    try:
        rasterize(*leaves_on(surfels, GPU, torch.float64), np.eye(4), camera, size)
        checks.that("float64 is refused", False)
    except fastsegsim.InputError as error:
        checks.that("float64 is refused", "float32 on a GPU" in str(error), error)
    if torch.cuda.device_count() > 1:
        other = torch.device("cuda", 1)
        moved = leaves_on(surfels, other, torch.float32)
        images = rasterize(*moved, T_WORLD_CAMERA, camera, size, deterministic=True)
        by_moved = torch.autograd.grad(images.rgb.square().sum(), moved)
        checks.that("equal on another GPU", images.rgb.device == other and
                    all(torch.equal(a.cpu(), b.cpu()) for a, b in zip(by_first, by_moved, strict=True)))


def check_gsplat_interface(checks):
    """The function with gsplat's arguments, against the CPU."""
    size = (96, 72)
    raw = random_surfels(300, torch.float32)
    scales = torch.cat([raw[1].exp(), torch.zeros(300, 1)], dim=1)
    colors = torch.rand(300, 5, generator=torch.Generator().manual_seed(1)) - 0.3
    inputs = (raw[0], raw[2], scales, raw[3].sigmoid(), colors)
    viewmats = torch.from_numpy(np.linalg.inv(T_WORLD_CAMERA)).float()
    cameras = torch.from_numpy(np.stack([fastsegsim.pinhole(size, 1.0)] * 2)).float()
    found = {}
    for name, device, dtype in (("cpu", "cpu", torch.float64), ("gpu", GPU, torch.float32)):
        leaves = leaves_on(inputs, device, dtype)
        drawn, *_ = rasterization_2dgs(*leaves, viewmats.to(device), cameras.to(device), *size, render_mode="RGB+ED")
        drawn.square().sum().backward()
        found[name] = (drawn, [values.grad for values in leaves])
    checks.close("rasterization_2dgs is the CPU's", found["gpu"][0], found["cpu"][0], 2e-3)
    for name, gpu, cpu in zip(("means", "quats", "scales", "opacities", "colors"), found["gpu"][1], found["cpu"][1],
                              strict=True):
        checks.close(f"rasterization_2dgs: gradient by {name} is the CPU's", gpu, cpu, 5e-3)


def check_training(checks):
    """Sixty steps bring surfels to an image."""
    size, camera = (48, 36), fastsegsim.pinhole((48, 36), 1.0)
    target_surfels = leaves_on(random_surfels(12, sh_degree=0, seed=1), GPU, torch.float32)
    with torch.no_grad():
        target = rasterize(*target_surfels, np.eye(4), camera, size)
    surfels = leaves_on(random_surfels(12, sh_degree=0, seed=2), GPU, torch.float32)
    optimiser = torch.optim.Adam(surfels, lr=0.05)
    losses = []
    for _ in range(60):
        optimiser.zero_grad()
        images = rasterize(*surfels, np.eye(4), camera, size)
        loss = (images.rgb - target.rgb).square().mean() + (images.alpha - target.alpha).square().mean()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    checks.that("training fits an image", losses[-1] < 0.2 * losses[0], f"loss {losses[0]:.4f}, then {losses[-1]:.4f}")


def check_renderer(checks, folder):
    """The GPU's renderer against the CPU's."""
    scene = fastsegsim.Scene.load(write_room(folder / "room.ply", surfels=3000))
    size, camera = (96, 64), fastsegsim.pinhole((96, 64), 1.2)
    poses = np.stack([fastsegsim.look_at((1, 3, 1.2), (6, 3, 1)), fastsegsim.look_at((7, 5, 2), (2, 1, 0.5))])
    channels = ("rgb", "depth", "normal", "semantic")
    gpu, cpu = (fastsegsim.Renderer(scene, backend=name) for name in ("cuda", "cpu"))
    checks.that("the renderer is the GPU's", gpu.backend == "cuda")
    of_gpu, of_cpu = gpu.render(poses, camera, size, channels), cpu.render(poses, camera, size, channels)
    views = [gpu.render(pose, camera, size, channels) for pose in poses]
    same = all(np.array_equal(of_gpu[name][i], view[name], equal_nan=name == "depth")
               for i, view in enumerate(views) for name in channels)
    checks.that("a batch has the images of its views", same)
    gpu.render(poses, camera, size, channels)
    checks.that("a batch has a time", gpu.stats["render_ms"] > 0)
    rgb = np.abs(of_gpu["rgb"].astype(int) - of_cpu["rgb"])
    checks.that("rgb is the CPU's", rgb.max() <= 1, f"differs by {rgb.max()} of 255")
    both = np.isfinite(of_gpu["depth"]) & np.isfinite(of_cpu["depth"])
    # At a surface's edge, and where the median surfel changes, rounding decides.
    away = np.abs(of_gpu["depth"][both] - of_cpu["depth"][both]) > 1e-3
    checks.that("depth is the CPU's", both.mean() > 0.5 and away.mean() < 1e-3, f"{away.sum()} of {both.sum()} pixels")
    labels = (of_gpu["semantic"] != of_cpu["semantic"]).mean()
    checks.that("labels are the CPU's", labels < 2e-3, f"{labels:.2e} of all pixels differ")


def empty_images(count, size):
    """Room for images on the GPU."""
    width, height = size
    return {"rgb": torch.empty(count, height, width, 3, dtype=torch.uint8, device=GPU),
            "depth": torch.empty(count, height, width, device=GPU),
            "semantic": torch.empty(count, height, width, dtype=torch.uint16, device=GPU)}


def check_arrays_of_the_gpu(checks, folder):
    """Images that stay on the GPU are those that come to NumPy, in the order of a stream."""
    scene = fastsegsim.Scene.load(write_room(folder / "room.ply", surfels=3000))
    size, camera = (96, 64), fastsegsim.pinhole((96, 64), 1.2)
    poses = np.stack([fastsegsim.look_at((4, 3, 1.2), (4 + np.cos(a), 3 + np.sin(a), 1.1))
                      for a in np.linspace(0, 2 * np.pi, 300)])
    renderer = fastsegsim.Renderer(scene, backend="cuda")
    expected = renderer.render(poses, camera, size, ("rgb", "depth", "semantic"))
    images, stream = empty_images(300, size), torch.cuda.Stream(GPU)
    with torch.cuda.stream(stream):
        torch.cuda._sleep(200_000_000)
        for image in images.values():
            image.fill_(7)  # Comes before the renderer's copies, late as it is.
        renderer.render_to(poses, camera, size, images, stream.cuda_stream)
        copies = {name: image.clone() for name, image in images.items()}
    # The next batch must not come before the copies.
    renderer.render_to(poses[::-1].copy(), camera, size, empty_images(300, size), stream.cuda_stream)
    torch.cuda.synchronize()
    for name, image in copies.items():
        same = np.array_equal(image.cpu().numpy(), expected[name], equal_nan=name == "depth")
        checks.that(f"{name} on the GPU", same)
    cameras = np.stack([camera, fastsegsim.pinhole(size, 0.9)])
    two = empty_images(2, size)
    renderer.render_to(poses[:2], cameras, size, two, torch.cuda.current_stream(GPU).cuda_stream)
    checks.that("two cameras on the GPU", np.array_equal(
        two["rgb"].cpu().numpy(), renderer.render(poses[:2], cameras, size, "rgb")["rgb"]))
    one = {"rgb": two["rgb"][0]}
    renderer.render_to(poses[1], camera, size, one, torch.cuda.current_stream(GPU).cuda_stream)
    checks.that("one camera on the GPU", np.array_equal(one["rgb"].cpu().numpy(), expected["rgb"][1]))
    for what, wrong in (("shape", {"rgb": two["rgb"]}), ("type", {"rgb": one["rgb"].float()}),
                        ("place", {"rgb": one["rgb"].cpu()}), ("name", {"colour": one["rgb"]}), ("number", {})):
        try:
            renderer.render_to(poses[1], camera, size, wrong)
            checks.that(f"an array of another {what} is refused", False)
        except fastsegsim.InputError as error:
            checks.that(f"an array of another {what} is refused", True, error)


def milliseconds(work, rounds=20):
    """The median of several calls, each until the GPU is done."""
    for _ in range(3):
        work()
    times = []
    for _ in range(rounds):
        torch.cuda.synchronize()
        start = time.perf_counter()
        work()
        torch.cuda.synchronize()
        times.append(1e3 * (time.perf_counter() - start))
    return float(np.median(times))


def measure(folder):
    """Times of a room of 200,000 surfels."""
    times = {}
    file = write_room(folder / "large.ply", surfels=200_000, seed=2)
    surfels = [values.to(GPU).requires_grad_() for values in read_surfels(file)]
    pose, size = fastsegsim.look_at((1, 3, 1.2), (6, 3, 1)), (640, 480)
    camera = fastsegsim.pinhole(size, 1.2)

    def forward():
        with torch.no_grad():
            rasterize(*surfels, pose, camera, size)

    def both():
        rasterize(*surfels, pose, camera, size).rgb.square().mean().backward()

    times["forward 640x480, 200,000 surfels"] = milliseconds(forward)
    times["forward and backward 640x480, 200,000 surfels"] = milliseconds(both)
    scene = fastsegsim.Scene.load(file)
    poses = np.stack([fastsegsim.look_at((4, 3, 1.2), (4 + np.cos(a), 3 + np.sin(a), 1.1))
                      for a in np.linspace(0, 2 * np.pi, 64, endpoint=False)])
    small = fastsegsim.pinhole((256, 256), 1.2)
    renderer = fastsegsim.Renderer(scene, backend="cuda")
    for channels in (("rgb",), ("rgb", "depth", "semantic")):
        times[f"render 64 x 256x256, {', '.join(channels)}, to NumPy"] = milliseconds(
            lambda channels=channels: renderer.render(poses, small, (256, 256), channels))
    images = empty_images(64, (256, 256))
    stream = torch.cuda.current_stream(GPU).cuda_stream
    for channels in (("rgb",), ("rgb", "depth", "semantic")):
        chosen = {name: images[name] for name in channels}
        times[f"render 64 x 256x256, {', '.join(channels)}, on the GPU"] = milliseconds(
            lambda chosen=chosen: renderer.render_to(poses, small, (256, 256), chosen, stream))
    for name, milliseconds_taken in times.items():
        print(f"{milliseconds_taken:9.3f} ms  {name}")
    return times


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--record", type=pathlib.Path)
    parser.add_argument("--quick", action="store_true")
    arguments = parser.parse_args()
    if not differentiable.HAS_CUDA or not torch.cuda.is_available():
        print("gpu_check: no GPU, or a package that was built without CUDA")
        return 2
    print(f"{torch.cuda.get_device_name(GPU)}, PyTorch {torch.__version__}, fastsegsim {fastsegsim.__version__}")
    checks = Checks()
    for check in (check_gradients, check_differences, check_streams, check_repetition, check_gsplat_interface,
                  check_training):
        check(checks)
    with tempfile.TemporaryDirectory() as folder:
        check_renderer(checks, pathlib.Path(folder))
        check_arrays_of_the_gpu(checks, pathlib.Path(folder))
        times = {} if arguments.quick else measure(pathlib.Path(folder))
    if arguments.record:
        arguments.record.write_text(json.dumps({"gpu": torch.cuda.get_device_name(GPU), "torch": torch.__version__,
                                                "failed_checks": checks.failed, "milliseconds": times}, indent=2))
    print(f"{checks.failed} checks failed")
    return int(checks.failed > 0)


if __name__ == "__main__":
    sys.exit(main())
