"""Gradients of the rasterizer in PyTorch: against differences, against C++, and in training."""

import gc
import pathlib
import subprocess
import sys
import threading

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

import fastsegsim  # noqa: E402
from conftest import program_of  # noqa: E402
from fastsegsim import InputError, differentiable  # noqa: E402
from fastsegsim.differentiable import depth_normals, native_rasterizers, rasterize  # noqa: E402
from surfel_files import write_room  # noqa: E402
from trainable_surfels import PARAMETERS, T_WORLD_CAMERA, hat, random_surfels, read_surfels  # noqa: E402

SIZE = (12, 9)
K = fastsegsim.pinhole(SIZE, 1.0)
#: Images of SurfelImages through which gradients flow.
SMOOTH = ("rgb", "depth_m", "alpha", "normal", "distortion")


def total_of(images, names=SMOOTH):
    """A loss with random derivatives by every image."""
    generator = torch.Generator().manual_seed(5)
    weights = {name: torch.randn(getattr(images, name).shape, generator=generator, dtype=torch.float64)
               for name in SMOOTH}
    return sum((getattr(images, name) * weights[name].to(images.rgb.dtype)).sum() for name in names)


@pytest.mark.parametrize("name", PARAMETERS)
def test_gradients_are_those_of_differences(name):
    surfels = random_surfels(5)
    chosen = PARAMETERS.index(name)

    def images_of(values):
        images = rasterize(*surfels[:chosen], values, *surfels[chosen + 1:], T_WORLD_CAMERA, K, SIZE, distortion=True,
                           threads=1)
        return tuple(getattr(images, name) for name in SMOOTH)

    for k, surfel_parameter in enumerate(surfels):
        surfel_parameter.requires_grad_(k == chosen)
    assert torch.autograd.gradcheck(images_of, (surfels[chosen],), eps=1e-6, atol=1e-6, rtol=1e-5)
    total_of(rasterize(*surfels, T_WORLD_CAMERA, K, SIZE, distortion=True)).backward()
    assert surfels[chosen].grad.abs().max() > 0.01
    assert all(values.grad is None for k, values in enumerate(surfels) if k != chosen)


@pytest.mark.parametrize("degree", range(4))
def test_colours_have_gradients_of_every_degree(degree):
    surfels = random_surfels(3, sh_degree=3)
    assert torch.autograd.gradcheck(
        lambda positions_m, sh: rasterize(positions_m, *surfels[1:4], sh, np.eye(4), K, SIZE,
                                          active_sh_degree=degree, threads=1).rgb,
        (surfels[0], surfels[4]), eps=1e-6, atol=1e-6, rtol=1e-5)
    rasterize(*surfels, np.eye(4), K, SIZE, active_sh_degree=degree).rgb.sum().backward()
    used = surfels[4].grad.abs().amax(dim=(0, 2)) > 0
    assert used.tolist() == [k < (degree + 1) ** 2 for k in range(16)]


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_poses_have_gradients(degree):
    surfels = [values.detach() for values in random_surfels(4, sh_degree=3)]
    with torch.no_grad():
        surfels[0][3] = torch.nan  # Not drawn, and no reason for NaN.

    def images_of(twists):
        moved = torch.from_numpy(T_WORLD_CAMERA) @ torch.linalg.matrix_exp(hat(twists))
        images = rasterize(*surfels, moved, K, SIZE, active_sh_degree=degree, distortion=True, threads=1)
        # Of each image by itself, and of all together.
        parts = [total_of(images, names=(name,)) for name in SMOOTH]
        return torch.stack([*parts, sum(parts)])

    twists = torch.zeros(2, 6, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(images_of, (twists,), eps=1e-6, atol=1e-6, rtol=1e-5)
    images_of(twists)[-1].backward()
    assert (twists.grad.abs() > 1e-3).all()
    # A motion of a single pose, in single precision.
    pose = torch.from_numpy(T_WORLD_CAMERA[0]).float().requires_grad_()
    single = [values.float() for values in surfels]
    rasterize(*single, pose, K, SIZE, active_sh_degree=degree).depth_m.sum().backward()
    assert pose.grad.dtype == torch.float32 and (pose.grad[3] == 0).all() and pose.grad[2, 3].abs() > 1e-3


@pytest.mark.parametrize("kind", ["float", "double"])
def test_images_and_gradients_are_those_of_cpp(kind):
    program = program_of("SEGSIM_SURFEL_GRADIENTS")
    real = torch.float32 if kind == "float" else torch.float64
    size, pose = (40, 30), T_WORLD_CAMERA[1]
    camera = fastsegsim.pinhole(size, 1.0)
    surfels = random_surfels(60, real, sh_degree=2)
    screen = torch.zeros(60, dtype=real, requires_grad=True)
    images = rasterize(*surfels, pose, camera, size, active_sh_degree=1, distortion=True, screen_gradient=screen)
    named = {name: getattr(images, name) for name in (*SMOOTH, "median_m", "max_weight")}
    by_images = {name: torch.randn(named[name].shape, dtype=real, generator=torch.Generator().manual_seed(9))
                 for name in SMOOTH}
    sum((named[name] * by_images[name]).sum() for name in SMOOTH).backward()

    head = np.array([60, 2, 1, *size], np.int64).tobytes() + np.concatenate([pose.ravel(), camera.ravel()]).tobytes()
    arrays = [values.detach().numpy() for values in (*surfels, *by_images.values())]
    from_cpp = subprocess.run([program, kind], input=head + b"".join(values.tobytes() for values in arrays),
                              capture_output=True, check=True).stdout
    ours = [named[name].detach().numpy() for name in (*SMOOTH, "median_m", "max_weight")]
    ours += [values.grad.numpy() for values in (*surfels, screen)]
    assert sum(values.nbytes for values in ours) == len(from_cpp)
    assert all(np.abs(values).max() > 1e-5 for values in ours)
    assert b"".join(values.tobytes() for values in ours) == from_cpp


def test_images_are_those_of_the_renderer(tmp_path):
    file = write_room(tmp_path / "room.ply", surfels=3000)
    size, camera = (96, 64), fastsegsim.pinhole((96, 64), 1.2)
    poses = np.stack([fastsegsim.look_at((1, 3, 1.2), (6, 3, 1)), fastsegsim.look_at((7, 5, 2), (2, 1, 0.5))])
    drawn = fastsegsim.Renderer(fastsegsim.Scene.load(file)).render(poses, camera, size,
                                                                    ("rgb", "depth", "alpha", "normal"))
    images = rasterize(*read_surfels(file), poses, camera, size)
    np.testing.assert_allclose(images.alpha, drawn["alpha"], atol=5e-4)  # It packs surfels into fewer bits.
    np.testing.assert_allclose(255 * images.rgb.clamp(max=1), drawn["rgb"], atol=0.51)
    surface = drawn["alpha"] > 0.501
    assert surface.mean() > 0.5
    np.testing.assert_allclose(images.median_m.numpy()[surface], drawn["depth"][surface], rtol=1e-4)
    unit = torch.nn.functional.normalize(images.normal, dim=-1).numpy()
    np.testing.assert_allclose(unit[surface], drawn["normal"][surface], atol=2e-3)


def test_several_cameras_are_one_after_the_other():
    surfels = random_surfels(30, torch.float32)
    cameras = np.stack([K, fastsegsim.pinhole(SIZE, 0.7)])
    total_of(rasterize(*surfels, T_WORLD_CAMERA, cameras, SIZE, distortion=True)).backward()
    together = [values.grad.clone() for values in surfels]
    both = rasterize(*surfels, T_WORLD_CAMERA, cameras, SIZE, distortion=True)
    single = [rasterize(*surfels, T_WORLD_CAMERA[k], cameras[k], SIZE, distortion=True) for k in range(2)]
    for joined, first, second in zip(both, *single, strict=True):
        assert torch.equal(joined, torch.stack([first, second]))
        assert joined.requires_grad == (joined is not both.median_m and joined is not both.max_weight)
    stacked = differentiable.SurfelImages(*(torch.stack(parts) for parts in zip(*single, strict=True)))
    for values in surfels:
        values.grad = None
    total_of(stacked).backward()
    for values, expected in zip(surfels, together, strict=True):
        torch.testing.assert_close(values.grad, expected, rtol=1e-6, atol=1e-6)


def test_views_that_keep_nothing_are_drawn_again():
    surfels = random_surfels(20, torch.float32)
    poses = np.stack([fastsegsim.look_at((0.1 * k, -0.05 * k, -0.4), (0.0, 0.1, 2.0)) for k in range(12)])
    screen = torch.zeros(12, 20, requires_grad=True)
    images = rasterize(*surfels, poses, K, SIZE, distortion=True, screen_gradient=screen)
    weights = torch.randn(images.rgb.shape, generator=torch.Generator().manual_seed(2))
    total = (images.rgb * weights).sum() + images.distortion.sum()
    by_screen, *together = torch.autograd.grad(total, [screen, *surfels], retain_graph=True)
    sums = [torch.zeros_like(values) for values in surfels]
    for k in range(12):
        one = torch.zeros(20, requires_grad=True)
        single = rasterize(*surfels, poses[k], K, SIZE, distortion=True, screen_gradient=one)
        gradients = torch.autograd.grad((single.rgb * weights[k]).sum() + single.distortion.sum(), [one, *surfels])
        assert torch.equal(gradients[0], by_screen[k])
        sums = [by + gradient for by, gradient in zip(sums, gradients[1:], strict=True)]
    for by_all, by_each in zip(together, sums, strict=True):
        assert torch.equal(by_all, by_each)
    again = torch.autograd.grad(total, surfels)
    assert all(torch.equal(first, second) for first, second in zip(together, again, strict=True))


def test_no_camera_and_no_surfel():
    surfels = random_surfels(4)
    images = rasterize(*surfels, T_WORLD_CAMERA[:0], K, SIZE)
    assert images.rgb.shape == (0, SIZE[1], SIZE[0], 3)
    images.rgb.sum().backward()
    assert all((values.grad == 0).all() for values in surfels)
    empty = [values.detach()[:0].requires_grad_() for values in surfels]
    images = rasterize(*empty, np.eye(4), K, SIZE)
    assert (images.alpha == 0).all()
    images.rgb.sum().backward()
    assert empty[4].grad.shape == (0, 4, 3)


def test_views_of_tensors_and_images_that_no_loss_uses():
    surfels = random_surfels(20)
    rasterize(*surfels, np.eye(4), K, SIZE).depth_m.sum().backward()
    expected = [values.grad.clone() for values in surfels]
    # Every other row of a tensor: not contiguous.
    wide = [torch.stack([values.detach(), values.detach()], dim=1).flatten(0, 1).requires_grad_() for values in surfels]
    rasterize(*(values[::2] for values in wide), np.eye(4), K, SIZE).depth_m.sum().backward()
    for values, gradient in zip(wide, expected, strict=True):
        assert torch.equal(values.grad[::2], gradient)
        assert (values.grad[1::2] == 0).all()
    assert (expected[4] == 0).all()  # Depth has no colour.


def test_screen_gradients_tell_which_surfels_to_split():
    surfels = random_surfels(20)
    screen = torch.zeros(2, 20, dtype=torch.float64, requires_grad=True)
    images = rasterize(*surfels, T_WORLD_CAMERA, K, SIZE, screen_gradient=screen)
    images.rgb.sum().backward()
    seen = images.max_weight > 0
    assert seen.any() and (screen.grad[seen] > 0).any()
    assert (screen.grad[~seen] == 0).all()
    # The length in half images: moving a surfel that faces the camera moves its centre by f / z pixels a metre.
    flat = [values.detach().requires_grad_() for values in random_surfels(1, sh_degree=0)]
    with torch.no_grad():
        flat[0][:] = torch.tensor([[0.05, 0.02, 2.0]])
        flat[2][:] = torch.tensor([[1.0, 0.0, 0.0, 0.0]])
    screen = torch.zeros(1, dtype=torch.float64, requires_grad=True)
    weights = torch.linspace(0, 1, SIZE[0] * SIZE[1], dtype=torch.float64).reshape(SIZE[1], SIZE[0])
    (rasterize(*flat, np.eye(4), K, SIZE, screen_gradient=screen).alpha * weights).sum().backward()
    by_pixel = flat[0].grad[0, :2] * 2.0 / K[0, 0] * torch.tensor(SIZE) / 2
    assert float(screen.grad) == pytest.approx(float(by_pixel.norm()), rel=1e-6)


def test_screen_gradients_without_others():
    surfels = [values.detach() for values in random_surfels(20)]
    screen = torch.zeros(20, dtype=torch.float64, requires_grad=True)
    rasterize(*surfels, np.eye(4), K, SIZE, screen_gradient=screen).rgb.sum().backward()
    assert screen.grad.max() > 0.01


def test_depth_normals_of_a_wall():
    """A plane in the world, seen from two places, has its normal everywhere but at the border."""
    size, camera = (20, 14), fastsegsim.pinhole((20, 14), 1.0)
    normal, distance_m = np.array([0.6, 0.0, -0.8]), -2.0  # normal . p = distance: ahead of both cameras.
    x, y = np.meshgrid(np.arange(20) + 0.5, np.arange(14) + 0.5)
    rays = np.stack([(x - 10) / camera[0, 0], (y - 7) / camera[0, 0], np.ones_like(x)], axis=-1)
    depth_m = []
    for pose in T_WORLD_CAMERA:
        turned = rays @ pose[:3, :3].T
        depth_m.append((distance_m - normal @ pose[:3, 3]) / (turned @ normal))
    depth = torch.tensor(np.array(depth_m), requires_grad=True)
    found = depth_normals(depth, T_WORLD_CAMERA, camera)
    assert (found[:, [0, -1]] == 0).all() and (found[:, :, [0, -1]] == 0).all()
    np.testing.assert_allclose(found[:, 1:-1, 1:-1].detach(), np.broadcast_to(normal, (2, 12, 18, 3)), atol=1e-12)
    small = depth.detach()[:, :5, :5].clone().requires_grad_()
    assert torch.autograd.gradcheck(lambda image: depth_normals(image, T_WORLD_CAMERA, camera), (small,))
    one = depth_normals(depth.detach()[1], T_WORLD_CAMERA[1], camera)
    assert torch.equal(one, found.detach()[1])


def test_training_fits_surfels_to_an_image():
    size, camera = (48, 36), fastsegsim.pinhole((48, 36), 1.0)
    with torch.no_grad():
        target = rasterize(*random_surfels(12, torch.float32, sh_degree=0, seed=1), np.eye(4), camera, size)
    surfels = random_surfels(12, torch.float32, sh_degree=0, seed=2)
    optimiser = torch.optim.Adam(surfels, lr=0.05)
    losses = []
    for _ in range(60):
        optimiser.zero_grad()
        images = rasterize(*surfels, np.eye(4), camera, size)
        loss = (images.rgb - target.rgb).square().mean() + (images.alpha - target.alpha).square().mean()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.2 * losses[0]


def test_graphs_live_as_long_as_autograd_says():
    surfels = random_surfels(10)
    first = rasterize(*surfels, np.eye(4), K, SIZE).rgb.sum()
    second = rasterize(*surfels, T_WORLD_CAMERA[1], K, SIZE).rgb.sum()
    # In the other order than they were drawn, and one of them twice.
    [by_second] = torch.autograd.grad(second, surfels[4])
    [by_first] = torch.autograd.grad(first, surfels[4], retain_graph=True)
    [again] = torch.autograd.grad(first, surfels[4])
    assert torch.equal(by_first, again) and not torch.equal(by_first, by_second)
    with pytest.raises(RuntimeError, match="second time"):
        torch.autograd.grad(first, surfels[4])
    twice, = torch.autograd.grad(rasterize(*surfels, np.eye(4), K, SIZE).rgb.square().sum(), surfels[4],
                                 create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        twice.sum().backward()
    drawn = rasterize(*surfels, np.eye(4), K, SIZE).rgb.sum()
    with torch.no_grad():
        surfels[0].add_(1.0)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        drawn.backward()


def test_memory_is_used_again():
    differentiable.release_memory()
    surfels = random_surfels(10)
    images = rasterize(*surfels, np.concatenate([T_WORLD_CAMERA] * 6), K, SIZE)
    assert not native_rasterizers._idle
    images.rgb.sum().backward()
    del images
    gc.collect()
    [idle] = native_rasterizers._idle.values()
    assert len(idle) == native_rasterizers.MOST_KEPT + 1
    kept = set(map(id, idle))
    with torch.no_grad():
        rasterize(*surfels, T_WORLD_CAMERA, K, SIZE)  # One for both views, as no gradient will be asked for.
    assert set(map(id, idle)) == kept
    differentiable.release_memory()
    assert not native_rasterizers._idle


def test_a_program_may_end_with_graphs_and_memory():
    ended = subprocess.run([sys.executable, "-c", """
import numpy, torch, fastsegsim
from fastsegsim.differentiable import rasterize
from trainable_surfels import random_surfels
surfels = random_surfels(4)
def total():
    return rasterize(*surfels, numpy.eye(4), fastsegsim.pinhole((12, 9), 1.0), (12, 9)).rgb.sum()
total().backward()
kept = total()
print(kept.requires_grad)
"""], capture_output=True, text=True, check=True, cwd=pathlib.Path(__file__).parent)
    assert (ended.stdout, ended.stderr) == ("True\n", "")


def test_threads_draw_side_by_side():
    surfels = [values.detach() for values in random_surfels(200, torch.float32)]
    expected = {}
    found = {}

    def gradient(view):
        leaves = [values.clone().requires_grad_() for values in surfels]
        for _ in range(5):
            for values in leaves:
                values.grad = None
            rasterize(*leaves, T_WORLD_CAMERA[view % 2], K, SIZE, threads=1 + view).rgb.square().sum().backward()
        return torch.cat([values.grad.flatten() for values in leaves])

    for view in range(2):
        expected[view] = gradient(view)
    threads = [threading.Thread(target=lambda k=k: found.setdefault(k, gradient(k))) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for view, values in found.items():
        assert torch.equal(values, expected[view % 2])


def test_what_cannot_be_drawn_is_not():
    surfels = random_surfels(4)
    with torch.no_grad():
        surfels[0][0] = torch.nan
        surfels[1][1] = torch.inf
        surfels[2][2] = 0.0
    images = rasterize(*surfels, np.eye(4), K, SIZE, distortion=True)
    total_of(images).backward()
    assert (images.max_weight[:3] == 0).all() and images.max_weight[3] > 0
    assert all(torch.isfinite(values.grad).all() for values in surfels)
    assert all((values.grad[:3] == 0).all() for values in surfels)


@pytest.mark.parametrize(("changed", "message"), [
    ({"positions_m": lambda p: p.tolist()}, "positions_m: expected a torch.Tensor, found list"),
    ({"positions_m": lambda p: p[:, :2]}, r"positions_m: expected shape \[N, 3\], found \[4, 2\]"),
    ({"positions_m": lambda p: p.half()}, "positions_m: expected float32 or float64, found torch.float16"),
    ({"log_scales": lambda s: s[:3]}, r"log_scales: expected shape \[4, 2\], found \[3, 2\]"),
    ({"rotations": lambda r: r.float()}, "rotations: expected torch.float64 on cpu as the positions have, "
                                         "found torch.float32 on cpu"),
    ({"rotations": lambda r: r.to("meta")}, "rotations: expected torch.float64 on cpu .*, found torch.float64 on meta"),
    ({"opacity_logits": lambda o: o[:, None]}, r"opacity_logits: expected shape \[4\], found \[4, 1\]"),
    ({"sh": lambda sh: sh[:, :2]}, "sh: expected 1, 4, 9 or 16 coefficients of a colour, found 2"),
    ({"T_world_camera": lambda _: 2 * np.eye(4)}, "T_world_camera: expected"),
    ({"K": lambda _: np.zeros((3, 3))}, "K: expected rows"),
    ({"T_world_camera": lambda _: torch.zeros(4, 4, requires_grad=True)}, "T_world_camera: expected"),
    ({"size": lambda _: (0, 5)}, "size: expected width and height"),
    ({"active_sh_degree": lambda _: 2}, "active_sh_degree: expected 0 to 1, found 2"),
    ({"threads": lambda _: -1}, "threads: expected 0 to 1024, found -1"),
    ({"screen_gradient": lambda _: torch.zeros(3, dtype=torch.float64)},
     r"screen_gradient: expected shape \[4\], found \[3\]"),
    ({"screen_gradient": lambda _: torch.zeros(4, dtype=torch.float64)},
     "screen_gradient: expected a tensor that requires gradients, found one that does not"),
])
def test_wrong_arguments_are_named(changed, message):
    arguments = dict(zip(PARAMETERS, random_surfels(4), strict=True))
    arguments |= {"T_world_camera": np.eye(4), "K": K, "size": SIZE, "active_sh_degree": None, "threads": 0,
                  "screen_gradient": None}
    arguments |= {name: change(arguments[name]) for name, change in changed.items()}
    with pytest.raises(InputError, match=message):
        rasterize(**arguments)


def test_a_scene_is_trained_on_and_drawn_again(tmp_path):
    file = write_room(tmp_path / "room.ply", surfels=2000)
    scene = fastsegsim.Scene.load(file)
    for values, of_file in zip(scene.surfel_parameters().values(), read_surfels(file), strict=True):
        np.testing.assert_allclose(values, of_file, rtol=1e-4, atol=1e-5)
    parameters = {name: torch.from_numpy(values) for name, values in scene.surfel_parameters().items()}
    parameters["sh"].requires_grad_()
    size, camera, pose = (64, 48), fastsegsim.pinhole((64, 48), 1.2), fastsegsim.look_at((1, 3, 1.2), (6, 3, 1))
    optimiser = torch.optim.Adam([parameters["sh"]], lr=0.2)
    for _ in range(20):  # Paint what is in view red.
        optimiser.zero_grad()
        images = rasterize(**parameters, T_world_camera=pose, K=camera, size=size)
        (images.rgb - torch.tensor([1.0, 0.0, 0.0])).square().mean().backward()
        optimiser.step()
    with torch.no_grad():
        expected = rasterize(**parameters, T_world_camera=pose, K=camera, size=size).rgb
    painted = fastsegsim.Scene.from_parameters(**{name: values.detach() for name, values in parameters.items()})
    before, after = (fastsegsim.Renderer(s).render(pose, camera, size, "rgb")["rgb"] for s in (scene, painted))
    np.testing.assert_allclose(255 * expected.clamp(max=1), after, atol=2)
    assert after[..., 0].mean() > 1.3 * before[..., 0].mean() and after[..., 1].mean() < 0.3 * before[..., 1].mean()


def test_the_example_fits_surfels(bundle, tmp_path):
    program = pathlib.Path(__file__).resolve().parents[2] / "python" / "examples" / "fit_surfels.py"
    arguments = ("--surfels", "300", "--steps", "40", "--size", "64", "48", "--output", tmp_path / "fitted.ply")
    printed = subprocess.run([sys.executable, program, bundle, *arguments], check=True, capture_output=True,
                             text=True).stdout
    words = printed.replace(",", "").split()
    assert float(words[words.index("last") - 2]) < 0.9 * float(words[words.index("first") - 2])
    assert fastsegsim.Scene.load(tmp_path / "fitted.ply").surfels == 300
