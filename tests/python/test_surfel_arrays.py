"""Surfels of scenes as arrays, and scenes of arrays."""

import numpy as np
import pytest

import fastsegsim
from surfel_files import SH_C0, write_surfels

NAMES = ("positions_m", "log_scales", "rotations", "opacity_logits", "sh")
POSE = fastsegsim.look_at((1, 3, 1.2), (6, 3, 1))
SIZE = (96, 64)
K = fastsegsim.pinhole(SIZE, 1.2)


def two_surfels():
    return {"positions_m": [(2.0, 0.1, 1.0), (3.0, -0.2, 1.1)], "log_scales": np.log([(0.2, 0.1), (0.3, 0.4)]),
            "rotations": [(2.0, 0.0, 2.0, 0.0), (0.5, 0.5, 0.5, 0.5)], "opacity_logits": [1.0, -0.5],
            "sh": np.arange(24, dtype=np.float64).reshape(2, 4, 3) / 24}


def test_parameters_are_those_of_the_file(tmp_path):
    colours = np.array([(0.2, 0.4, 0.6), (0.9, 0.5, 0.1)])
    file = write_surfels(tmp_path / "two.ply", [(1, 2, 3), (4, 5, 6)], [(0.6, 0, 0.8, 0), (1, 0, 0, 0)],
                         [(0.1, 0.2), (0.3, 0.4)], [0.25, 0.9], colours)
    found = fastsegsim.Scene.load(file).surfel_parameters()
    assert tuple(found) == NAMES and all(values.dtype == np.float32 for values in found.values())
    np.testing.assert_allclose(found["positions_m"], [(1, 2, 3), (4, 5, 6)])
    np.testing.assert_allclose(found["log_scales"], np.log([(0.1, 0.2), (0.3, 0.4)]), rtol=1e-5)
    np.testing.assert_allclose(found["rotations"], [(0.6, 0, 0.8, 0), (1, 0, 0, 0)], rtol=1e-6)
    np.testing.assert_allclose(found["opacity_logits"], np.log([1 / 3, 9]), rtol=1e-5)
    np.testing.assert_allclose(found["sh"], (colours[:, None] - 0.5) / SH_C0, rtol=1e-5)


def test_a_scene_of_its_own_parameters_is_the_same(room, tmp_path):
    again = fastsegsim.Scene.from_parameters(**room.surfel_parameters(), name="again")
    assert (again.name, again.surfels, again.has_labels, again.recording) == ("again", 4000, False, None)
    expected = fastsegsim.Renderer(room).render(POSE, K, SIZE, ("rgb", "depth"))
    found = fastsegsim.Renderer(again).render(POSE, K, SIZE, ("rgb", "depth"))
    assert np.abs(found["rgb"].astype(int) - expected["rgb"]).max() <= 1
    there = np.isfinite(expected["depth"])
    assert there.mean() > 0.3
    assert (np.abs(found["depth"][there] - expected["depth"][there]) < 1e-3).mean() > 0.999
    again.save(tmp_path / "again.ply")
    for name, values in fastsegsim.Scene.load(tmp_path / "again.ply").surfel_parameters().items():
        np.testing.assert_allclose(values, room.surfel_parameters()[name], rtol=1e-4, atol=1e-5, err_msg=name)


def test_labels_and_harmonics_are_saved(tmp_path):
    scene = fastsegsim.Scene.from_parameters(**two_surfels(), semantic=[3, 0], instance=np.array([103, 7], np.uint16))
    assert scene.has_labels and scene.classes == []
    scene.save(tmp_path / "labelled.ply")
    loaded = fastsegsim.Scene.load(tmp_path / "labelled.ply")
    found = loaded.surfel_parameters()
    np.testing.assert_allclose(found["sh"], two_surfels()["sh"], rtol=1e-5)
    np.testing.assert_allclose(found["rotations"][0], (np.sqrt(0.5), 0, np.sqrt(0.5), 0), rtol=1e-5)
    camera = fastsegsim.look_at((0, 0, 1), (1, 0, 1))
    drawn = [fastsegsim.Renderer(s).render(camera, K, SIZE, ("semantic", "instance")) for s in (scene, loaded)]
    assert set(np.unique(drawn[0]["instance"])) >= {0, 103}
    for name, image in drawn[0].items():
        np.testing.assert_array_equal(image, drawn[1][name])


def test_arrays_are_copies(room):
    found = room.surfel_parameters()
    found["positions_m"][:] = 0
    assert room.positions_m.max() > 1


@pytest.mark.parametrize(("changed", "message"), [
    ({"positions_m": [(1, 2)]}, r"positions_m: expected shape \[N, 3\], found \[1, 2\]"),
    ({"log_scales": np.zeros((3, 2))}, r"log_scales: expected shape \[2, 2\], found \[3, 2\]"),
    ({"sh": np.zeros((2, 3, 3))}, "sh: expected 1, 4, 9 or 16 coefficients of a colour, found 3"),
    ({"sh": np.zeros((2, 25, 3))}, "sh: expected 1, 4, 9 or 16 coefficients of a colour, found 25"),
    ({"positions_m": [(1, 2, np.nan), (1, 2, 3)]}, "positions_m: expected finite numbers, found nan"),
    ({"log_scales": [(0, 0), (0, 200)]}, r"log_scales\[1\]: expected logarithms of lengths .*, found 1.0+ m, inf m"),
    ({"rotations": [(1, 0, 0, 0), (0, 0, 0, 0)]}, r"rotations\[1\]: expected a quaternion that is not 0"),
    ({"opacity_logits": [-200, 0]}, r"opacity_logits\[0\]: expected an opacity above 0"),
    ({"semantic": [1, 2]}, "instance: expected labels of both kinds, or none, found one kind"),
    ({"semantic": [1], "instance": [1]}, r"semantic: expected shape \[2\], found \[1\]"),
])
def test_wrong_arrays_are_named(changed, message):
    with pytest.raises(fastsegsim.InputError, match=message):
        fastsegsim.Scene.from_parameters(**{**two_surfels(), **changed})


def test_only_ply_files_are_written(tmp_path):
    scene = fastsegsim.Scene.from_parameters(**two_surfels())
    with pytest.raises(fastsegsim.InputError, match=r"path: expected a name that ends in \.ply, found .*scene\.obj"):
        scene.save(tmp_path / "scene.obj")
    (tmp_path / "file").write_text("")
    with pytest.raises(fastsegsim.InputError, match="file: expected a folder that can be made"):
        scene.save(tmp_path / "file" / "scene.ply")
