import gc
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import fastsegsim
from exr_file import read_exr
from surfel_files import FACES_X, write_one_disc, write_room, write_surfels

SIZE = (120, 90)
K = fastsegsim.pinhole(SIZE, 1.2)
POSE = fastsegsim.mast_camera((1.0, 3.0, 0.3), 1.2)
LAYOUT = {"rgb": ("uint8", (3,)), "depth": ("float32", ()), "normal": ("float32", (3,)), "alpha": ("float32", ()),
          "semantic": ("uint16", ()), "instance": ("uint16", ()), "confidence": ("float32", ()),
          "instance_confidence": ("float32", ()), "depth_normal": ("float32", (3,))}


@pytest.fixture(scope="module")
def renderer(room):
    return fastsegsim.Renderer(room, backend="cpu", threads=1)


def srgb_from_linear_halves(exr):
    """The bytes whose linear values the file holds; all 256 differ as halves."""
    byte = np.arange(256) / 255.0
    linear = np.where(byte <= 0.04045, byte / 12.92, ((byte + 0.055) / 1.055) ** 2.4)
    stored = np.stack([exr[channel] for channel in "RGB"], axis=-1).astype(np.float64)
    return np.abs(stored[..., None] - linear).argmin(axis=-1)


def test_images_are_those_of_the_program(segsim, room, room_file, tmp_path):
    segsim("render", room_file, "--out", tmp_path / "view.exr", "--single-part", "--backend", "cpu", "--width", 200,
           "--height", 150, "--hfov-deg", 90, "--pose", 1, 3, 1.2, 0, 0)
    exr = read_exr(tmp_path / "view.exr")
    # Without a turn the pose has no rounding, so that both draw from the same numbers.
    pose = [[0, 0, 1, 1], [-1, 0, 0, 3], [0, -1, 0, 1.2], [0, 0, 0, 1]]
    camera = fastsegsim.pinhole((200, 150), np.pi / 2)
    images = fastsegsim.Renderer(room, backend="cpu").render(pose, camera, (200, 150), list(LAYOUT))
    assert np.isfinite(images["depth"]).mean() > 0.5 and len(np.unique(images["semantic"])) > 4
    np.testing.assert_array_equal(images["depth"], exr["Z"])
    np.testing.assert_array_equal(images["semantic"], exr["semantic"])
    np.testing.assert_array_equal(images["instance"], exr["instance"])
    np.testing.assert_array_equal(images["rgb"], srgb_from_linear_halves(exr))
    np.testing.assert_array_equal(images["alpha"].astype(np.float16), exr["A"])
    np.testing.assert_array_equal(images["confidence"].astype(np.float16), exr["confidence"])
    np.testing.assert_array_equal(images["instance_confidence"].astype(np.float16), exr["instance_confidence"])
    normal = np.stack([exr[f"N.{axis}"] for axis in "xyz"], axis=-1)
    np.testing.assert_array_equal(images["normal"].astype(np.float16), normal)


def test_a_turned_pose_is_the_programs(segsim, renderer, room_file, tmp_path):
    segsim("render", room_file, "--out", tmp_path / "view.exr", "--single-part", "--width", 120, "--height", 90,
           "--hfov-deg", 60, "--pose", 1.5, 2, 1.4, 35, 12)
    exr = read_exr(tmp_path / "view.exr")
    pose = fastsegsim.mast_camera((1.5, 2.0, np.radians(35)), 1.4, np.radians(12))
    images = renderer.render(pose, fastsegsim.pinhole((120, 90), np.radians(60)), (120, 90), ("depth", "semantic"))
    # A matrix in place of the quaternion rounds the pose by 1e-16, which may carry a pixel over a threshold.
    assert np.isclose(images["depth"], exr["Z"], rtol=1e-5, equal_nan=True).mean() > 0.999
    assert (images["semantic"] == exr["semantic"]).mean() > 0.999


def test_a_disc_is_where_the_documented_camera_sees_it(tmp_path):
    disc = np.array([3.0, 1.0, 1.5])
    scene = fastsegsim.Scene.load(write_one_disc(tmp_path / "disc.ply", disc, FACES_X))
    # Optical axes in columns: right is the world's -y, down its -z, forward its +x.
    pose = np.eye(4)
    pose[:3, :3] = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    pose[:3, 3] = [0.0, 0.5, 1.0]
    camera = np.array([[150.0, 0, 70], [0, 140, 50], [0, 0, 1]])
    images = fastsegsim.Renderer(scene).render(pose, camera, (160, 120), list(LAYOUT))
    p_camera = np.linalg.inv(pose) @ [*disc, 1.0]
    x, y, _ = camera @ (p_camera[:3] / p_camera[2])
    alpha = images["alpha"].astype(np.float64)
    assert alpha.sum() > 300
    assert abs((alpha * (np.arange(160) + 0.5)).sum() / alpha.sum() - x) < 0.01
    assert abs((alpha * (np.arange(120) + 0.5)[:, None]).sum() / alpha.sum() - y) < 0.01
    row, column = int(y), int(x)
    assert images["depth"][row, column] == pytest.approx(3.0, abs=1e-5)
    assert tuple(images["rgb"][row, column] > 100) == (True, False, False)
    assert (images["semantic"][row, column], images["instance"][row, column]) == (3, 7)
    np.testing.assert_allclose(images["normal"][row, column], [-1, 0, 0], atol=1e-5)
    assert np.isnan(images["depth"][0, 0]) and images["semantic"][0, 0] == 0


def test_helpers_make_the_documented_matrices():
    pose = fastsegsim.look_at((1.0, 2.0, 3.0), (4.0, 2.0, 3.0))
    np.testing.assert_allclose(pose, [[0, 0, 1, 1], [-1, 0, 0, 2], [0, -1, 0, 3], [0, 0, 0, 1]], atol=1e-12)
    turned = fastsegsim.mast_camera((1.0, 2.0, np.pi / 2), 1.5, pitch_down_rad=0.3)
    np.testing.assert_allclose(turned[:3, 2], [0, np.cos(0.3), -np.sin(0.3)], atol=1e-12)  # Forward.
    np.testing.assert_allclose(turned[:3, 0], [1, 0, 0], atol=1e-12)  # Right.
    np.testing.assert_allclose(turned[:3, 3], [1, 2, 1.5])
    np.testing.assert_allclose(fastsegsim.pinhole((200, 100), np.pi / 2), [[100, 0, 100], [0, 100, 50], [0, 0, 1]])


def test_arrays_have_the_documented_shapes_and_types(renderer):
    images = renderer.render(POSE, K, SIZE, list(LAYOUT))
    assert list(images) == list(LAYOUT)
    for name, (kind, of_pixel) in LAYOUT.items():
        assert (images[name].dtype, images[name].shape) == (np.dtype(kind), (90, 120, *of_pixel)), name
        assert images[name].flags.c_contiguous and images[name].flags.writeable
    assert list(renderer.render(POSE, K, SIZE)) == ["rgb", "depth"]
    assert list(renderer.render(POSE, K, SIZE, "alpha")) == ["alpha"]


def test_a_batch_is_the_views_one_by_one(renderer):
    poses = np.stack([fastsegsim.mast_camera((1.0, 3.0, yaw), 1.2) for yaw in (0.0, 0.7, 2.0)])
    batch = renderer.render(poses, K, SIZE, list(LAYOUT))
    for name, (kind, of_pixel) in LAYOUT.items():
        assert (batch[name].dtype, batch[name].shape) == (np.dtype(kind), (3, 90, 120, *of_pixel)), name
    for view, pose in enumerate(poses):
        for name, image in renderer.render(pose, K, SIZE, list(LAYOUT)).items():
            np.testing.assert_array_equal(batch[name][view], image)
    none = renderer.render(np.empty((0, 4, 4)), K, SIZE)
    assert (none["rgb"].shape, none["depth"].shape) == ((0, 90, 120, 3), (0, 90, 120))


def test_each_view_may_have_a_camera_of_its_own(renderer):
    wide = fastsegsim.pinhole(SIZE, 1.8)
    batch = renderer.render([POSE, POSE], [K, wide], SIZE)
    np.testing.assert_array_equal(batch["rgb"][0], renderer.render(POSE, K, SIZE)["rgb"])
    np.testing.assert_array_equal(batch["rgb"][1], renderer.render(POSE, wide, SIZE)["rgb"])
    assert not np.array_equal(batch["rgb"][0], batch["rgb"][1])


def test_any_array_and_nested_list_is_taken(renderer):
    expected = renderer.render(POSE, K, SIZE)["rgb"]
    fortran = np.asfortranarray(POSE)
    for pose, camera in ((POSE.tolist(), K.tolist()), (fortran, np.asfortranarray(K)), (POSE[::1], K)):
        np.testing.assert_array_equal(renderer.render(pose, camera, list(SIZE))["rgb"], expected)
    single = renderer.render(POSE.astype(np.float32), K.astype(np.float32), np.array(SIZE))["rgb"]
    assert (single == expected).mean() > 0.99


def test_images_own_the_renderers_memory(room):
    renderer = fastsegsim.Renderer(room, threads=1)
    depth = renderer.render(POSE, K, SIZE)["depth"]
    assert depth.base is not None and not depth.flags.owndata
    before = depth.copy()
    crop = depth[10:20]
    other = renderer.render(fastsegsim.mast_camera((5.0, 3.0, 2.0), 1.2), K, SIZE)["depth"]
    assert not np.shares_memory(depth, other)
    np.testing.assert_array_equal(depth, before)
    del renderer, depth, other
    gc.collect()
    np.testing.assert_array_equal(crop, before[10:20])


def test_alpha_is_whole_beside_labels(renderer):
    # A frame of labels alone stops early, and its alpha would be only what was seen until then.
    alone = renderer.render(POSE, K, SIZE, "alpha")["alpha"]
    beside = renderer.render(POSE, K, SIZE, ("semantic", "alpha"))["alpha"]
    np.testing.assert_array_equal(alone, beside)


def test_threads_do_not_change_the_image(room, renderer):
    two = fastsegsim.Renderer(room, threads=2).render(POSE, K, SIZE, list(LAYOUT))
    for name, image in renderer.render(POSE, K, SIZE, list(LAYOUT)).items():
        np.testing.assert_array_equal(image, two[name])


def test_options_reach_the_renderer(room, renderer):
    first = fastsegsim.Renderer(room, top_k=1).render(POSE, K, SIZE, ("semantic", "confidence"))
    assert np.all(first["confidence"][first["semantic"] > 0] == 1.0)
    four = renderer.render(POSE, K, SIZE, "confidence")["confidence"]
    assert np.any((four > 0) & (four < 1))
    other_rules = fastsegsim.Renderer(room, compat="gsplat").render(POSE, K, SIZE)["rgb"]
    assert not np.array_equal(other_rules, renderer.render(POSE, K, SIZE)["rgb"])


def test_features_of_a_trained_scene(tmp_path):
    features = np.arange(48, dtype=np.float32)[None]
    scene = fastsegsim.Scene.load(write_surfels(tmp_path / "one.ply", [(2, 0, 1)], [FACES_X], [(0.5, 0.5)], [0.95],
                                                [(1, 1, 1)], [1], [1], features))
    assert scene.has_features
    images = fastsegsim.Renderer(scene).render(fastsegsim.look_at((0, 0, 1), (2, 0, 1)), K, SIZE,
                                               ("semantic_feature", "instance_feature"))
    assert images["semantic_feature"].shape == (90, 120, 16) and images["instance_feature"].shape == (90, 120, 32)
    np.testing.assert_allclose(images["semantic_feature"][45, 60], features[0, :16], rtol=1e-5)
    np.testing.assert_allclose(images["instance_feature"][45, 60], features[0, 16:], rtol=1e-5)


def changed(matrix, place, value):
    copy = np.array(matrix, np.float64)
    copy[place] = value
    return copy


@pytest.mark.parametrize("words, pose, camera, size, channels", [
    (r"T_world_camera: expected shape \[4, 4\] or \[N, 4, 4\], found \[3, 4\]", POSE[:3], K, SIZE, "rgb"),
    (r"K: expected shape \[3, 3\] or \[N, 3, 3\], found \[4, 4\]", POSE, POSE, SIZE, "rgb"),
    (r"K: expected one matrix, as there is one pose, found \[2, 3, 3\]", POSE, [K, K], SIZE, "rgb"),
    (r"K: expected one matrix, or 3 as there are poses, found \[2, 3, 3\]", [POSE] * 3, [K, K], SIZE, "rgb"),
    (r"T_world_camera\[1\]: expected a rotation .* found columns", [POSE, 2 * POSE - np.diag([0, 0, 0, 1])], K, SIZE,
     "rgb"),
    (r"T_world_camera: expected a rotation .* found a reflection", POSE @ np.diag([1, 1, -1, 1]), K, SIZE, "rgb"),
    (r"T_world_camera: expected \(0, 0, 0, 1\)", changed(POSE, (3, 0), 1), K, SIZE, "rgb"),
    (r"T_world_camera: expected finite numbers, found nan", changed(POSE, (0, 3), np.nan), K, SIZE, "rgb"),
    (r"K: expected finite numbers, found inf", POSE, changed(K, (0, 2), np.inf), SIZE, "rgb"),
    (r"K: expected rows \(fx, 0, cx\)", POSE, changed(K, (0, 1), 2), SIZE, "rgb"),
    (r"K: expected focal lengths above 0", POSE, changed(K, (1, 1), -100), SIZE, "rgb"),
    (r"size: expected width and height of 1 to 65535 pixels, found 0 x 90", POSE, K, (0, 90), "rgb"),
    (r"size: .*found 65536 x 90", POSE, K, (65536, 90), "rgb"),
    (r"channels: expected rgb \| depth \| .*, found \"color\"", POSE, K, SIZE, ("rgb", "color")),
    (r"channels: expected none of features", POSE, K, SIZE, "semantic_feature"),
])
def test_what_is_wrong_is_said(renderer, words, pose, camera, size, channels):
    with pytest.raises(fastsegsim.InputError, match=words):
        renderer.render(pose, camera, size, channels)


@pytest.mark.parametrize("words, options", [
    (r"backend: expected auto \| cpu \| cuda, found \"gpu\"", {"backend": "gpu"}),
    (r"compat: expected exact \| inria \| gsplat, found \"\"", {"compat": ""}),
    (r"top_k: expected 0 to 24, found 25", {"top_k": 25}),
    (r"threads: expected 0 to 1024, found -1", {"threads": -1}),
])
def test_wrong_options_are_refused(room, words, options):
    with pytest.raises(fastsegsim.InputError, match=words):
        fastsegsim.Renderer(room, **options)


def test_helpers_refuse_what_has_no_meaning():
    with pytest.raises(fastsegsim.InputError, match="target_m: expected another point than eye_m"):
        fastsegsim.look_at((1, 2, 3), (1, 2, 3))
    for angle in (0.0, np.pi, np.nan):
        with pytest.raises(fastsegsim.InputError, match="horizontal_fov_rad: expected an angle between 0 and pi"):
            fastsegsim.pinhole(SIZE, angle)
    with pytest.raises(TypeError):
        fastsegsim.look_at((1, 2), (1, 2, 3))


def test_auto_says_what_draws(room):
    renderer = fastsegsim.Renderer(room)
    assert renderer.backend in ("cpu", "cuda")
    assert (renderer.backend == "cpu") == (renderer.fallback_reason != "")
    assert fastsegsim.Renderer(room, backend="cpu").fallback_reason == ""
    if renderer.backend == "cpu":
        with pytest.raises(fastsegsim.InputError, match="GPU"):
            fastsegsim.Renderer(room, backend="cuda")


def test_only_a_gpu_draws_into_arrays_of_its_memory(room):
    renderer = fastsegsim.Renderer(room, backend="cpu")
    with pytest.raises(fastsegsim.InputError, match="render_to: expected a renderer whose backend is cuda, found one"):
        renderer.render_to(POSE, K, SIZE, {"rgb": np.zeros((SIZE[1], SIZE[0], 3), np.uint8)})


def test_work_is_counted(renderer):
    renderer.render(POSE, K, SIZE)
    assert 0 < renderer.stats["surfels_projected"] <= 4000
    assert renderer.stats["render_ms"] > 0


@pytest.fixture(scope="module")
def large_renderer(tmp_path_factory):
    file = write_room(tmp_path_factory.mktemp("large") / "large.ply", surfels=60_000)
    return fastsegsim.Renderer(fastsegsim.Scene.load(file), backend="cpu", threads=1)


def test_other_threads_run_while_an_image_is_drawn(large_renderer):
    size = (1600, 1200)
    camera = fastsegsim.pinhole(size, 1.2)
    times = []

    def draw():
        began = time.perf_counter()
        large_renderer.render(POSE, camera, size, list(LAYOUT))
        times.append((began, time.perf_counter()))

    thread = threading.Thread(target=draw)
    thread.start()
    moments = []
    while thread.is_alive():
        moments.append(time.perf_counter())
        time.sleep(0.001)
    began, ended = times[0]
    # With the lock held this thread would stand still while the image is drawn: there would be one gap that is as long.
    inside = [began, *(moment for moment in moments if began < moment < ended), ended]
    assert np.diff(inside).max() < 0.5 * (ended - began)


def test_threads_may_share_a_renderer(renderer):
    poses = [fastsegsim.mast_camera((1.0, 3.0, yaw), 1.2) for yaw in np.linspace(0, 6, 8)]
    expected = [renderer.render(pose, K, SIZE)["rgb"] for pose in poses]
    drawn = [None] * len(poses)

    def draw(k):
        for _ in range(5):
            drawn[k] = renderer.render(poses[k], K, SIZE)["rgb"]

    threads = [threading.Thread(target=draw, args=(k,)) for k in range(len(poses))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for image, wanted in zip(drawn, expected):
        np.testing.assert_array_equal(image, wanted)


def test_ctrl_c_ends_a_batch(room_file):
    code = f"""
import numpy as np, fastsegsim
renderer = fastsegsim.Renderer(fastsegsim.Scene.load({str(room_file)!r}), backend="cpu", threads=1)
poses = np.broadcast_to(fastsegsim.mast_camera((1, 3, 0), 1.2), (50_000, 4, 4))
print("ready", flush=True)
try:
    renderer.render(poses, fastsegsim.pinhole((64, 48), 1.2), (64, 48), "alpha")
except KeyboardInterrupt:
    print("interrupted", renderer.render(poses[0], fastsegsim.pinhole((64, 48), 1.2), (64, 48))["rgb"].shape)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)
        assert process.poll() is None, "the batch was drawn before Ctrl-C"
        process.send_signal(signal.SIGINT)
        try:
            printed, _ = process.communicate(timeout=60)
        finally:
            process.kill()
    assert printed == "interrupted (48, 64, 3)\n"


def test_calling_costs_little(tmp_path):
    scene = fastsegsim.Scene.load(write_one_disc(tmp_path / "disc.ply", (3.0, 0.0, 1.0), FACES_X))
    renderer = fastsegsim.Renderer(scene, backend="cpu", threads=1)
    pose, size = fastsegsim.mast_camera((0, 0, 0), 1.0), (32, 24)
    camera = fastsegsim.pinhole(size, 1.2)
    beyond_ms = []
    for _ in range(500):
        began = time.perf_counter()
        renderer.render(pose, camera, size, list(LAYOUT))
        beyond_ms.append(1e3 * (time.perf_counter() - began) - renderer.stats["render_ms"])
    assert np.median(beyond_ms) < 0.1
