"""Trials as a LeRobot data set, read with pyarrow and, where it is installed, by LeRobot itself."""

import json
import pathlib
import shutil
import subprocess
import sys

import numpy as np
import pytest

import fastsegsim
from fastsegsim import results

parquet = pytest.importorskip("pyarrow.parquet")
CAMERA = "observation.images.front"


@pytest.fixture(scope="session")
def pictures(small_run, tmp_path_factory) -> pathlib.Path:
    """The whole run with its recorded images, without loss."""
    root = tmp_path_factory.mktemp("lerobot") / "pictures"
    results.export_lerobot(small_run, root, images="recorded", storage="png")
    return root


def read_rows(root):
    return parquet.read_table(root / "data/chunk-000/file-000.parquet")


def read_episodes(root):
    return parquet.read_table(root / "meta/episodes/chunk-000/file-000.parquet").to_pylist()


def read_json(file):
    return json.loads(file.read_text())


def png_pixels(data):
    """[H, W, 3] of a PNG file whose rows are not filtered."""
    import struct
    import zlib

    width, height = struct.unpack_from(">II", data, 16)
    size = struct.unpack_from(">I", data, 33)[0]
    rows = np.frombuffer(zlib.decompress(data[41:41 + size]), np.uint8).reshape(height, 1 + 3 * width)
    return rows[:, 1:].reshape(height, width, 3)


def test_frames_are_the_ticks_of_the_logs(small_run, pictures):
    run = results.load_run(small_run)
    trials, rows, episodes = run.trial_rows(), read_rows(pictures), read_episodes(pictures)
    assert len(episodes) == len(trials) == 8 and rows.num_rows == sum(t["ticks"] for t in trials)
    assert [e["segsim/trial_id"] for e in episodes] == [t["trial_id"] for t in trials]
    trial, episode = trials[3], episodes[3]
    mine = rows.slice(episode["dataset_from_index"], episode["length"])
    log = small_run / "replays" / trial["log"].removeprefix("logs/").replace(".json.gz", ".jsonl")
    ticks = [json.loads(line) for line in log.read_text().splitlines() if line.startswith('{"tick"')]
    assert episode["length"] == len(ticks) == trial["ticks"] and episode["tasks"] == [f"find a {trial['goal_class']}"]
    np.testing.assert_array_equal(mine["observation.state"].to_pylist(), np.float32([t["pose"] for t in ticks]))
    action = np.array(mine["action"].to_pylist())
    np.testing.assert_array_equal(action[:, :2], np.float32([t["command"] for t in ticks]))
    np.testing.assert_array_equal(action[:, 2], [t["mode"] == 4 for t in ticks])
    np.testing.assert_array_equal(mine["timestamp"], np.float32([t["time_ns"] * 1e-9 for t in ticks]))
    assert mine["frame_index"].to_pylist() == list(range(len(ticks)))
    assert mine["next.done"].to_pylist() == [False] * (len(ticks) - 1) + [True]
    assert mine["next.success"].to_pylist()[-1] == trial["success"]
    assert rows["index"].to_pylist() == list(range(rows.num_rows))
    # Both outcomes occur, and policies that stop say so.
    stops = sum(stop for _, _, stop in rows["action"].to_pylist())
    assert {t["success"] for t in trials} == {True, False} and 0 < stops < rows.num_rows / 2


def test_pictures_are_what_was_recorded_and_what_is_drawn_again(small_run, pictures, tmp_path):
    episode = read_episodes(pictures)[1]
    recorded = read_rows(pictures)[CAMERA].to_pylist()
    tick = episode["length"] // 2
    trial = results.load_run(small_run).trial_rows()[1]
    folder = small_run / "frames" / trial["log"].removeprefix("logs/").removesuffix(".json.gz")
    frame = fastsegsim.read_frame(folder / f"frame-{tick:06d}.exr", ["rgb", "depth", "semantic"])
    assert frame["rgb"].shape == (72, 96, 3) and frame["depth"].dtype == np.float32 and frame["semantic"].max() > 1
    stored = png_pixels(recorded[episode["dataset_from_index"] + tick]["bytes"])
    np.testing.assert_array_equal(stored, frame["rgb"])
    assert len(np.unique(stored)) > 20
    made = results.export_lerobot(small_run, tmp_path / "drawn", images="rendered", storage="png")
    assert made.images == "rendered" and made.frames == len(recorded)
    assert read_rows(made.root)[CAMERA].to_pylist() == recorded


def test_statistics_are_those_of_the_values(pictures):
    rows, stats = read_rows(pictures), read_json(pictures / "meta/stats.json")
    action = np.array(rows["action"].to_pylist())
    np.testing.assert_allclose(stats["action"]["mean"], action.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(stats["action"]["std"], action.std(axis=0), rtol=1e-6)
    np.testing.assert_allclose(stats["action"]["q90"], np.quantile(action, 0.9, axis=0), rtol=1e-6)
    images = np.stack([png_pixels(row["bytes"]) for row in rows[CAMERA].to_pylist()]) / 255.0
    found = {name: np.array(value) for name, value in stats[CAMERA].items()}
    assert found["mean"].shape == found["q01"].shape == (3, 1, 1) and found["count"].tolist() == [len(images)]
    np.testing.assert_allclose(found["mean"].ravel(), images.mean(axis=(0, 1, 2)), rtol=1e-9)
    np.testing.assert_allclose(found["std"].ravel(), images.std(axis=(0, 1, 2)), rtol=1e-9)
    np.testing.assert_allclose(found["min"].ravel(), images.min(axis=(0, 1, 2)))
    np.testing.assert_allclose(found["max"].ravel(), images.max(axis=(0, 1, 2)))
    np.testing.assert_allclose(found["q50"].ravel(), np.median(images, axis=(0, 1, 2)), atol=1 / 255)
    episode = read_episodes(pictures)[2]
    mine = images[episode["dataset_from_index"]:episode["dataset_to_index"]]
    mean = np.array(episode[f"stats/{CAMERA}/mean"])
    np.testing.assert_allclose(mean.ravel(), mine.mean(axis=(0, 1, 2)), rtol=1e-9)


def test_what_describes_the_set(small_run, pictures):
    info = read_json(pictures / "meta/info.json")
    assert (info["codebase_version"], info["fps"], info["total_episodes"], info["total_tasks"]) == ("v3.0", 4, 8, 2)
    assert info["features"][CAMERA] == {"dtype": "image", "shape": [72, 96, 3],
                                        "names": ["height", "width", "channels"]}
    assert info["features"]["action"] == {"dtype": "float32", "shape": [3],
                                          "names": ["forward_mps", "turn_radps", "stop"]}
    assert info["features"]["next.done"]["shape"] == [1] and info["splits"] == {"train": "0:8"}
    tasks = parquet.read_table(pictures / "meta/tasks.parquet")
    assert sorted(tasks["task"].to_pylist()) == ["find a chair", "find a couch"]
    said = read_json(pictures / "meta/segsim.json")
    assert said["spec_sha256"] == results.load_run(small_run).row["spec_sha256"]
    assert said["scenes"]["tiny"]["scene_sha256"]


def test_state_and_action_alone_need_neither_images_nor_replays(small_run, pictures, tmp_path):
    work = tmp_path / "work"
    shutil.copytree(small_run, work, ignore=shutil.ignore_patterns("frames", "replays"))
    made = results.export_lerobot(work, tmp_path / "numbers", images="none", arms=["after"], successes_only=True)
    info = read_json(made.root / "meta/info.json")
    assert CAMERA not in info["features"] and info["video_path"] is None and made.images == "none"
    episodes = read_episodes(made.root)
    assert {e["segsim/arm"] for e in episodes} == {"after"} and all(e["segsim/success"] for e in episodes)
    # The other log is rounded to a tenth of a millimetre.
    exact = {e["segsim/trial_id"]: e for e in read_episodes(pictures)}
    for episode in episodes:
        theirs = exact[episode["segsim/trial_id"]]
        for name in ("stats/observation.state/mean", "stats/action/max"):
            np.testing.assert_allclose(episode[name], theirs[name], atol=1e-4)
    with pytest.raises(fastsegsim.InputError, match=r"frames: \{of: all, every_s: 0.25\}.* in the spec keeps them"):
        results.export_lerobot(work, tmp_path / "none", images="recorded", storage="png")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["numbers", "work"]  # Nothing half is left.
    assert results.export_lerobot(work, tmp_path / "auto", storage="png", arms=["after"]).images == "rendered"


def test_videos_show_the_images(small_run, pictures, tmp_path):
    av = pytest.importorskip("av")
    made = results.export_lerobot(small_run, tmp_path / "videos")
    assert made.images == "recorded" and CAMERA not in read_rows(made.root).column_names
    with av.open(str(made.root / f"videos/{CAMERA}/chunk-000/file-000.mp4")) as video:
        assert video.streams.video[0].codec_context.name == "h264"
        frames = [(frame.time, frame.to_ndarray(format="rgb24")) for frame in video.decode(video=0)]
    recorded = read_rows(pictures)[CAMERA].to_pylist()
    assert len(frames) == len(recorded)
    for episode in read_episodes(made.root):
        begin = episode["dataset_from_index"]
        assert frames[begin][0] == pytest.approx(episode[f"videos/{CAMERA}/from_timestamp"], abs=1e-6)
        assert episode[f"videos/{CAMERA}/to_timestamp"] - frames[begin][0] == pytest.approx(episode["length"] / 4)
        shown = frames[begin][1].astype(float)
        assert np.abs(shown - png_pixels(recorded[begin]["bytes"])).mean() < 6.0


def test_what_cannot_be_exported_is_refused(small_run, tmp_path):
    (tmp_path / "there").mkdir()
    for arguments, message in [({"images": "all"}, "images: expected one of auto, recorded, rendered, none, found all"),
                               ({"storage": "gif"}, "storage: expected one of video, png, found gif"),
                               ({"arms": ["oracle"]}, "arm: expected one of before, after, found oracle"),
                               ({"arms": []}, "expected trials to export, found none")]:
        with pytest.raises(fastsegsim.InputError, match=message):
            results.export_lerobot(small_run, tmp_path / "new", **arguments)
    with pytest.raises(fastsegsim.InputError, match="expected a folder that is not there yet"):
        results.export_lerobot(small_run, tmp_path / "there", images="none")
    work = tmp_path / "work"
    shutil.copytree(small_run, work, ignore=shutil.ignore_patterns("frames"))
    log = work / results.load_run(work).trial_rows()[0]["log"]
    for damaged in (b"no gzip", log.read_bytes()[:-20]):
        log.write_bytes(damaged)
        with pytest.raises(fastsegsim.InputError, match="expected the log of a trial"):
            results.export_lerobot(work, tmp_path / "new", images="none")
    assert not (tmp_path / "new").exists()


def test_a_frame_that_is_none_is_refused(tmp_path, small_run):
    frame = next((small_run / "frames").rglob("*.exr"))
    with pytest.raises(fastsegsim.InputError, match='expected an image "semantic_feature", found none'):
        fastsegsim.read_frame(frame, ["semantic_feature"])
    with pytest.raises(fastsegsim.InputError, match='channels: expected .*, found "colour"'):
        fastsegsim.read_frame(frame, ["colour"])
    broken = tmp_path / "broken.exr"
    broken.write_bytes(frame.read_bytes()[:500])
    with pytest.raises(fastsegsim.InputError, match="broken.exr"):
        fastsegsim.read_frame(broken)


def test_the_command_exports(small_run, tmp_path):
    def run(*arguments):
        return subprocess.run([sys.executable, "-m", "fastsegsim.results", *map(str, arguments)], capture_output=True,
                              text=True, check=False)

    done = run("lerobot", small_run, tmp_path / "set", "--images", "none", "--arms", "before")
    assert done.returncode == 0 and ": 4 episodes, " in done.stdout and "2 tasks, images none" in done.stdout
    again = run("lerobot", small_run, tmp_path / "set")
    assert again.returncode == 2 and again.stderr.count("\n") == 1
    assert "expected a folder that is not there" in again.stderr
    (tmp_path / "file").write_text("")
    for command in (["lerobot", "--images", "none"], ["parquet"]):
        nowhere = run(*command, small_run, tmp_path / "file" / "set")
        assert nowhere.returncode == 2 and nowhere.stderr.count("\n") == 1 and "file" in nowhere.stderr
    tables = run("parquet", small_run, tmp_path / "tables")
    assert tables.returncode == 0 and len(tables.stdout.splitlines()) == 6
    assert parquet.read_table(tmp_path / "tables/trials.parquet").num_rows == 8


@pytest.mark.parametrize("storage, decoder", [("video", "torchcodec"), ("video", "pyav"), ("png", None),
                                              ("none", None)])
def test_lerobot_reads_it(small_run, pictures, tmp_path, monkeypatch, storage, decoder):
    pytest.importorskip("lerobot")
    if decoder == "torchcodec":
        pytest.importorskip("torchcodec")
    torch = pytest.importorskip("torch")
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_DATASETS_CACHE", str(tmp_path / "cache"))
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    images, kept = ("none", "png") if storage == "none" else ("auto", storage)
    results.export_lerobot(small_run, tmp_path / "set", images=images, storage=kept)
    data = LeRobotDataset("segsim/small", root=tmp_path / "set", video_backend=decoder)
    rows, episodes = read_rows(pictures), read_episodes(pictures)
    assert len(data) == rows.num_rows and data.num_episodes == 8 and data.fps == 4
    first = episodes[5]["dataset_from_index"]
    item = data[first + 3]
    assert item["task"] == episodes[5]["tasks"][0] and item["frame_index"] == 3 and item["episode_index"] == 5
    np.testing.assert_array_equal(item["action"], np.float32(rows["action"][first + 3].as_py()))
    if storage != "none":
        there = png_pixels(rows[CAMERA][first + 3].as_py()["bytes"])
        assert np.abs(item[CAMERA].permute(1, 2, 0).numpy() * 255 - there).mean() < (0.01 if storage == "png" else 6)
    batch = next(iter(torch.utils.data.DataLoader(data, batch_size=4, shuffle=True)))
    assert batch["observation.state"].shape == (4, 3) and len(batch["task"]) == 4
    one = LeRobotDataset("segsim/small", root=tmp_path / "set", episodes=[2],
                         delta_timestamps={"action": [0.0, 0.25, 0.5]})
    assert len(one) == episodes[2]["length"]
    last = one[len(one) - 1]
    assert last["action"].shape == (3, 3) and last["action_is_pad"].tolist() == [False, True, True]
