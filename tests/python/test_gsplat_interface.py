"""The function with gsplat's arguments: what it gives is what the rasterizer and the renderer give."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

import fastsegsim  # noqa: E402
from fastsegsim import InputError  # noqa: E402
from fastsegsim.differentiable import NEAR_M, depth_normals, rasterization_2dgs, rasterize  # noqa: E402
from surfel_files import SH_C0, write_room  # noqa: E402
from trainable_surfels import T_WORLD_CAMERA, hat, random_surfels, read_surfels  # noqa: E402

SIZE = (12, 9)
VIEWMATS = torch.from_numpy(np.linalg.inv(T_WORLD_CAMERA))
KS = torch.from_numpy(np.stack([fastsegsim.pinhole(SIZE, 1.0), fastsegsim.pinhole(SIZE, 0.8)]))


def activated(surfels):
    """Arguments means, quats, scales, opacities for raw parameters."""
    positions_m, log_scales, rotations, opacity_logits = surfels[:4]
    scales = torch.cat([log_scales.exp(), torch.zeros_like(log_scales[:, :1])], dim=1)
    return positions_m, rotations, scales, opacity_logits.sigmoid()


def leaves(count=5, channels=3, dtype=torch.float64):
    """means, quats, scales, opacities, colors, each a leaf."""
    means, quats, scales, opacities = activated(random_surfels(count, dtype))
    colors = torch.rand(count, channels, generator=torch.Generator().manual_seed(4), dtype=dtype)
    return [values.detach().requires_grad_() for values in (means, quats, scales, opacities, colors)]


def test_images_are_those_of_the_rasterizer():
    surfels = [values.detach() for values in random_surfels(25, sh_degree=2)]
    images = rasterize(*surfels, T_WORLD_CAMERA, KS, SIZE, active_sh_degree=1, distortion=True)
    backgrounds = torch.tensor([[0.1, 0.2, 0.3], [0.9, 0.8, 0.7]], dtype=torch.float64)
    colors, alphas, normals, surface_normals, distortion, median, meta = rasterization_2dgs(
        *activated(surfels), surfels[4], VIEWMATS, KS, *SIZE, sh_degree=1, backgrounds=backgrounds,
        render_mode="RGB+ED", distloss=True)
    close = {"rtol": 1e-9, "atol": 1e-9}
    torch.testing.assert_close(alphas[..., 0], images.alpha, **close)
    seen_through = images.rgb + (1 - images.alpha[..., None]) * backgrounds[:, None, None]
    torch.testing.assert_close(colors[..., :3], seen_through, **close)
    expected_m = images.depth_m / images.alpha.clamp(min=1e-10)
    torch.testing.assert_close(colors[..., 3], expected_m, **close)
    torch.testing.assert_close(normals, images.normal, **close)
    torch.testing.assert_close(surface_normals, depth_normals(expected_m, T_WORLD_CAMERA, KS), rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(distortion[..., 0], images.distortion, **close)
    torch.testing.assert_close(median[..., 0], images.median_m, **close)
    torch.testing.assert_close(meta["max_weight"], images.max_weight, **close)
    assert (meta["width"], meta["height"], meta["n_cameras"]) == (*SIZE, 2)
    assert meta["screen_gradient"] is None


@pytest.mark.parametrize(("render_mode", "channels"), [("RGB", 3), ("D", 1), ("ED", 1), ("RGB+D", 4), ("RGB+ED", 4)])
def test_render_modes(render_mode, channels):
    inputs = leaves()
    colors, alphas, normals, surface_normals, distortion, median, _ = rasterization_2dgs(
        *inputs, VIEWMATS, KS, *SIZE, render_mode=render_mode)
    assert colors.shape == (2, SIZE[1], SIZE[0], channels)
    assert alphas.shape == median.shape == (2, SIZE[1], SIZE[0], 1) and normals.shape == (2, SIZE[1], SIZE[0], 3)
    assert (surface_normals is None) == ("+" not in render_mode)
    assert distortion is None
    if "D" in render_mode:
        raw = [inputs[0], inputs[2][:, :2].log(), inputs[1], inputs[3].logit(), inputs[4][:, None]]
        images = rasterize(*raw, T_WORLD_CAMERA, KS, SIZE)
        depth_m = images.depth_m / images.alpha.clamp(min=1e-10) if "ED" in render_mode else images.depth_m
        torch.testing.assert_close(colors[..., -1], depth_m)


@pytest.mark.parametrize("name", ["means", "quats", "scales", "opacities", "colors"])
def test_gradients_are_those_of_differences(name):
    inputs = leaves(4, channels=4)
    k = ["means", "quats", "scales", "opacities", "colors"].index(name)
    background = torch.rand(2, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    small, cameras = (8, 6), KS * torch.tensor([[8 / 12], [6 / 9], [1.0]])

    def images_of(values):
        given = (*inputs[:k], values, *inputs[k + 1:])
        colors, alphas, normals, *_ = rasterization_2dgs(*given, VIEWMATS, cameras, *small, render_mode="RGB+D",
                                                         backgrounds=background, threads=1)
        return colors, alphas, normals

    assert torch.autograd.gradcheck(images_of, (inputs[k],), eps=1e-6, atol=1e-6, rtol=1e-5)


def test_view_matrices_have_gradients():
    inputs = [values.detach() for values in leaves(4)]
    small, cameras = (8, 6), KS * torch.tensor([[8 / 12], [6 / 9], [1.0]])

    def images_of(twists):
        moved = torch.linalg.matrix_exp(hat(twists)) @ VIEWMATS
        colors, alphas, normals, *_ = rasterization_2dgs(*inputs, moved, cameras, *small, render_mode="RGB+D",
                                                        threads=1)
        return torch.stack([(image * torch.linspace(-1, 1, image.numel()).view_as(image)).sum()
                            for image in (colors, alphas, normals)])

    assert torch.autograd.gradcheck(images_of, (torch.zeros(2, 6, dtype=torch.float64, requires_grad=True),),
                                    eps=1e-6, atol=1e-6, rtol=1e-5)


def test_normals_of_depth_have_gradients():
    means, quats, scales, opacities, colors = leaves(3)
    with torch.no_grad():
        scales.fill_(0.8)
        opacities.fill_(0.9)
        quats[:] = torch.tensor([1.0, 0.1, 0.05, 0.0])  # Towards the camera: depth is smooth.
    small, cameras = (8, 6), KS[:1] * torch.tensor([[8 / 12], [6 / 9], [1.0]])
    assert torch.autograd.gradcheck(
        lambda values: rasterization_2dgs(values, quats, scales, opacities, colors, VIEWMATS[:1], cameras, *small,
                                          render_mode="RGB+ED", threads=1)[3],
        (means,), eps=1e-6, atol=1e-5, rtol=1e-4)


def test_channels_are_as_many_as_colours_and_may_be_negative():
    *geometry, colors = leaves(20, channels=7)
    with torch.no_grad():
        colors.sub_(0.6)
        colors[3] = 0.0
    drawn, alphas, *_, meta = rasterization_2dgs(*geometry, colors, VIEWMATS, KS, *SIZE)
    assert drawn.shape[-1] == 7 and float(drawn.detach().min()) < -0.01
    # Images are linear in colours: of ones they are alpha, and the gradient is the image of who is seen.
    ones, *_ = rasterization_2dgs(*geometry, torch.ones_like(colors), VIEWMATS, KS, *SIZE)
    torch.testing.assert_close(ones, alphas.expand_as(ones))
    doubled, *_ = rasterization_2dgs(*geometry, 2 * colors, VIEWMATS, KS, *SIZE)
    torch.testing.assert_close(doubled, 2 * drawn)
    [by_colors] = torch.autograd.grad(drawn.sum(), colors)
    [by_ones] = torch.autograd.grad(ones.sum(), geometry[3])
    seen = meta["max_weight"].amax(dim=0) > 0
    assert bool(seen[3]) and (by_colors[seen] > 0).all()
    torch.testing.assert_close(by_colors, by_colors[:, :1].expand_as(by_colors))
    assert float(by_colors[:, 0].sum()) == pytest.approx(float(alphas.detach().sum()))
    assert (by_ones[seen] > 0).any()
    per_camera = torch.stack([colors.detach(), 2 * colors.detach()])
    both, *_ = rasterization_2dgs(*geometry, per_camera, VIEWMATS, KS, *SIZE)
    torch.testing.assert_close(both, drawn * torch.tensor([1.0, 2.0])[:, None, None, None])


def test_extreme_opacities_and_scales_have_finite_gradients():
    means, quats, scales, opacities, colors = leaves(6, dtype=torch.float32)
    with torch.no_grad():
        opacities[:] = torch.tensor([0.0, 1.0, 0.5, 1.0, 1e-9, 0.999])
        scales[2] = 0.0
    drawn, *_ = rasterization_2dgs(means, quats, scales, opacities, colors, VIEWMATS.float(), KS.float(), *SIZE)
    drawn.sum().backward()
    for values in (means, quats, scales, opacities, colors):
        assert torch.isfinite(values.grad).all()
    assert (opacities.grad[[0, 4]] == 0).all()  # Not drawn.
    assert (scales.grad[:, 2] == 0).all()


def test_the_image_is_that_of_the_renderer(tmp_path):
    file = write_room(tmp_path / "room.ply", surfels=3000)
    size, camera = (96, 64), fastsegsim.pinhole((96, 64), 1.2)
    pose = fastsegsim.look_at((1, 3, 1.2), (6, 3, 1))
    drawn = fastsegsim.Renderer(fastsegsim.Scene.load(file)).render(pose, camera, size, "rgb")
    surfels = read_surfels(file)
    viewmats = torch.from_numpy(np.linalg.inv(pose)).float()[None]
    cameras = torch.from_numpy(camera).float()[None]
    of_harmonics, *_ = rasterization_2dgs(*activated(surfels), surfels[4], viewmats, cameras, *size, sh_degree=0)
    np.testing.assert_allclose(255 * of_harmonics[0].clamp(max=1), drawn["rgb"], atol=0.75)
    of_colours, *_ = rasterization_2dgs(*activated(surfels), 0.5 + SH_C0 * surfels[4][:, 0], viewmats, cameras, *size)
    torch.testing.assert_close(of_colours, of_harmonics, rtol=1e-5, atol=1e-5)


def test_screen_gradients_come_with_backward():
    inputs = leaves(20)
    *_, meta = out = rasterization_2dgs(*inputs, VIEWMATS, KS, *SIZE)
    out[0].square().sum().backward()
    screen, seen = meta["screen_gradient"].grad, meta["max_weight"] > 0
    assert screen.shape == (2, 20)
    assert (screen[~seen] == 0).all() and (screen[seen] > 0).any()
    with pytest.raises(KeyError, match=r"meta: expected width, .*, found means2d"):
        meta["means2d"]


@pytest.mark.parametrize(("arguments", "error", "message"), [
    ({"near_plane": 0.2}, NotImplementedError, "near_plane: expected 0.05, which is fixed, found 0.2"),
    ({"far_plane": 100.0}, NotImplementedError, "far_plane: expected 10000000000.0 .*, found 100.0"),
    ({"radius_clip": 3.0}, NotImplementedError, "radius_clip: expected 0.0"),
    ({"eps2d": 0.1}, NotImplementedError, "eps2d: expected 0.3"),
    ({"packed": True}, NotImplementedError, "packed: expected False"),
    ({"tile_size": 8}, NotImplementedError, "tile_size: expected 16"),
    ({"sparse_grad": True}, NotImplementedError, "sparse_grad: expected False"),
    ({"absgrad": True}, NotImplementedError, "absgrad: expected False"),
    ({"depth_mode": "median"}, NotImplementedError, "depth_mode: expected expected where gradients are wanted"),
    ({"sh_degree": 4}, NotImplementedError, "sh_degree: expected 0 to 3 or None, found 4"),
    ({"sh_degree": 2}, InputError, "sh_degree: expected 9 coefficients in colors, found 4"),
    ({"render_mode": "depth"}, InputError, r"render_mode: expected RGB \| D .*, found depth"),
    ({"depth_mode": "mode"}, InputError, r"depth_mode: expected expected \| median, found mode"),
    ({"backgrounds": torch.zeros(1, 3, dtype=torch.float64)}, InputError,
     r"backgrounds: expected shape \[2, 3\], found \[1, 3\]"),
    ({"viewmats": 2 * VIEWMATS}, InputError, "expected .* in the last row"),
    ({"Ks": KS[:1]}, InputError, r"Ks: expected shape \[2, 3, 3\], found \[1, 3, 3\]"),
    ({"Ks": KS.clone().requires_grad_()}, NotImplementedError, "Ks: expected a tensor that requires no gradient"),
    ({"means": torch.zeros(1, 5, 3)}, InputError, r"means: expected shape \[N, 3\], found \[1, 5, 3\]"),
    ({"opacities": torch.zeros(5, 1, dtype=torch.float64)}, InputError, r"opacities: expected shape \[5\]"),
    ({"colors": torch.zeros(5, 0, dtype=torch.float64)}, InputError, "colors: expected at least one channel"),
])
def test_what_is_not_there_is_said(arguments, error, message):
    given = dict(zip(("means", "quats", "scales", "opacities", "colors"), leaves(), strict=True))
    if "sh_degree" in arguments:
        given["colors"] = torch.zeros(5, 4, 3, dtype=torch.float64)
    given |= {"viewmats": VIEWMATS, "Ks": KS, "width": SIZE[0], "height": SIZE[1], **arguments}
    with pytest.raises(error, match=message):
        rasterization_2dgs(**given)


def test_median_depth_gives_normals_where_no_gradient_is_wanted():
    given = [values.detach() for values in leaves(20)]
    *_, median, _ = out = rasterization_2dgs(*given, VIEWMATS, KS, *SIZE, render_mode="RGB+D", depth_mode="median",
                                             near_plane=NEAR_M)
    torch.testing.assert_close(out[3], depth_normals(median[..., 0], T_WORLD_CAMERA, KS), rtol=1e-6, atol=1e-6)
