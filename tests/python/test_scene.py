import gc
import pathlib

import numpy as np
import pytest

import fastsegsim
from exr_file import read_exr
from surfel_files import write_room


def test_a_file_of_surfels_has_no_names(room, room_file):
    assert (room.name, room.path, room.surfels) == ("room", room_file, 4000)
    assert room.has_labels and not room.has_features
    assert room.classes == [] and room.instances == []


def test_a_bundle_has_classes_and_instances(bundle):
    scene = fastsegsim.Scene.load(str(bundle))
    assert scene.name == "room"
    assert isinstance(scene.path, pathlib.Path)
    assert [(c.id, c.name, c.thing) for c in scene.classes] == [(1, "floor", False), (3, "couch", True)]
    couch = scene.instances[0]
    assert (couch.id, couch.class_id, couch.name) == (103, 3, "couch_1")
    assert (couch.box_min_m, couch.box_max_m) == ((2.0, 0.0, 0.0), (3.0, 6.0, 2.8))


def test_a_bundle_knows_the_cameras_of_its_recording(bundle, segsim, tmp_path):
    scene = fastsegsim.Scene.load(bundle)
    recording = scene.recording
    assert (recording.size, recording.frames) == ((64, 48), ["first", "second"])
    np.testing.assert_array_equal(recording.K, [[50, 0, 32], [0, 51, 24], [0, 0, 1]])
    assert recording.T_world_camera.shape == (2, 4, 4)
    depth = fastsegsim.Renderer(scene, backend="cpu").render(recording.T_world_camera, recording.K, recording.size,
                                                             "depth")["depth"]
    for view in range(2):
        segsim("render", bundle, "--view", view, "--single-part", "--out", tmp_path / "view.exr")
        np.testing.assert_allclose(depth[view], read_exr(tmp_path / "view.exr")["Z"], rtol=1e-5)


def test_a_file_of_surfels_knows_no_recording(room):
    assert room.recording is None


def test_surfels_are_counted_by_their_ids(bundle):
    scene = fastsegsim.Scene.load(bundle)
    in_metre = np.bincount(np.floor(scene.positions_m[:, 0]).astype(int), minlength=8)
    assert [c.surfels for c in scene.classes] == [in_metre[0], in_metre[2]]
    assert scene.instances[0].surfels == in_metre[2]


def test_positions_are_a_view_that_keeps_the_scene(room_file):
    scene = fastsegsim.Scene.load(room_file)
    positions = scene.positions_m
    assert positions.dtype == np.float32 and positions.shape == (4000, 3)
    assert np.shares_memory(positions, scene.positions_m)
    assert not positions.flags.writeable
    before = positions.copy()
    del scene
    gc.collect()
    np.testing.assert_array_equal(positions, before)
    # Those of the file, which were drawn uniformly from a room of 8 x 6 x 2.8 m.
    assert np.all(positions >= 0) and np.all(positions.max(axis=0) <= np.float32([8, 6, 2.8]))


def test_a_scene_without_labels_says_so(tmp_path):
    assert not fastsegsim.Scene.load(write_room(tmp_path / "bare.ply", labelled=False)).has_labels


def test_what_is_no_scene_is_refused_with_the_programs_words(tmp_path, bundle):
    assert issubclass(fastsegsim.InputError, ValueError)
    with pytest.raises(fastsegsim.InputError, match="expected a scene bundle with scene.yaml, found none"):
        fastsegsim.Scene.load(tmp_path)
    with pytest.raises(fastsegsim.InputError, match="missing.ply"):
        fastsegsim.Scene.load(tmp_path / "missing.ply")
    with open(bundle / "surfels.ply", "ab") as file:
        file.write(b"\0")
    with pytest.raises(fastsegsim.InputError, match="surfels.ply: expected SHA-256"):
        fastsegsim.Scene.load(bundle)
    with pytest.raises(TypeError):
        fastsegsim.Scene.load(7)
