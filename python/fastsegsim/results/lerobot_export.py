"""Trials of a run as a LeRobot data set, format v3.0: what robot learning programs read."""

import contextlib
import fractions
import itertools
import os
import pathlib
import shutil
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from fastsegsim._native import InputError
from fastsegsim.results.arrow_tables import import_pyarrow, provenance
from fastsegsim.results.lerobot_files import (CHUNK_FILES, DATA_MB, DATA_PATH, EPISODES_PATH, VIDEO_MB, VIDEO_PATH,
                                              DataFiles, ImageStatistics, VideoFiles, png, vector_statistics,
                                              write_json, write_tasks)
from fastsegsim.results.stored_run import Run, load_run
from fastsegsim.results.summary import NOT_COUNTED
from fastsegsim.results.trial_recording import IMAGES, Renderers, TrialRecording, read_recording

CAMERA = "observation.images.front"
STATE = ("x_m", "y_m", "yaw_rad")
ACTION = ("forward_mps", "turn_radps", "stop")
STORAGES = ("video", "png")
_TRIAL_COLUMNS = ("trial_id", "scene", "episode", "arm", "goal_class", "outcome", "success")
_LARGEST_TIME_ERROR_S = 1e-4  # Of LeRobot's reader.


class LeRobotSet(NamedTuple):
    """What was written."""

    root: pathlib.Path
    episodes: int
    frames: int
    tasks: list[str]
    images: str  # "recorded", "rendered" or "none"; "mixed" if some trials had recorded ones.


def _features(storage: str, size: tuple[int, int], fps: float) -> dict[str, Any]:
    """As info.json has them; storage "" is without images."""
    def numbers(dtype: str, names: Iterable[str] | None = None) -> dict[str, Any]:
        names = list(names) if names else None
        return {"dtype": dtype, "shape": [len(names) if names else 1], "names": names}

    found = {"observation.state": numbers("float32", STATE), "action": numbers("float32", ACTION),
             "next.done": numbers("bool"), "next.success": numbers("bool")}
    if storage:
        width, height = size
        found[CAMERA] = {"dtype": "video" if storage == "video" else "image", "shape": [height, width, 3],
                         "names": ["height", "width", "channels"]}
    if storage == "video":
        found[CAMERA]["info"] = {"video.height": height, "video.width": width, "video.codec": "h264",
                                 "video.pix_fmt": "yuv420p", "video.is_depth_map": False, "video.fps": fps,
                                 "video.channels": 3, "has_audio": False}
    return found | {"timestamp": numbers("float32")} | {
        name: numbers("int64") for name in ("frame_index", "episode_index", "index", "task_index")}


def _name(recording: TrialRecording) -> str:
    return f"trial {recording.trial['trial_id']}"


def _rate(recording: TrialRecording) -> fractions.Fraction:
    """Frames a second."""
    return 1 / fractions.Fraction(recording.period_s).limit_denominator(1_000_000)


def _episode_columns(recording: TrialRecording, fps: fractions.Fraction) -> dict[str, np.ndarray]:
    """What is stored of each tick, without images and without the numbers that a data set gives."""
    count = len(recording.times_s)
    last = np.arange(count) == count - 1
    times_s = np.arange(count) / float(fps)
    if np.abs(recording.times_s - times_s).max() > _LARGEST_TIME_ERROR_S:
        raise InputError(f"{_name(recording)}: expected ticks every {1 / float(fps):g} s, found others")
    action = np.concatenate([recording.commands, recording.stops[:, None]], axis=1)
    return {"observation.state": recording.poses.astype(np.float32), "action": action.astype(np.float32),
            "next.done": last, "next.success": last & recording.trial["success"],
            "timestamp": times_s.astype(np.float32), "frame_index": np.arange(count)}


def _arrow_episode(columns: dict[str, np.ndarray], pictures: list[bytes] | None) -> Any:
    pa = import_pyarrow()
    arrays = {}
    for name, values in columns.items():
        flat = pa.array(values.reshape(-1))
        arrays[name] = pa.FixedSizeListArray.from_arrays(flat, values.shape[1]) if values.ndim == 2 else flat
    if pictures is not None:
        kind = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
        arrays[CAMERA] = pa.array([{"bytes": data, "path": None} for data in pictures], kind)
    return pa.table(arrays)


class _Export:
    """Writes episode after episode."""

    def __init__(self, root: pathlib.Path, first: TrialRecording, images: str, storage: str) -> None:
        self._root, self._images, self._storage = root, images, storage if images != "none" else ""
        self._fps = _rate(first)
        self._size = first.size
        self._data = DataFiles(root)
        self._videos = VideoFiles(root, CAMERA, self._fps, first.size) if self._storage == "video" else None
        self._renderers = Renderers()
        self._columns: dict[str, list[np.ndarray]] = {}  # Of all episodes, for statistics.
        self._pictures = ImageStatistics()
        self._episodes: list[dict[str, Any]] = []
        self.tasks: list[str] = []
        self.frames = 0
        self.sources: set[str] = set()

    def add(self, recording: TrialRecording) -> None:
        if _rate(recording) != self._fps:
            raise InputError(f"{_name(recording)}: expected a control period of {1 / float(self._fps):g} s like those "
                             f"before it, found {recording.period_s:g} s")
        if self._storage and recording.size != self._size:
            raise InputError(f"{_name(recording)}: expected images of {self._size[0]} x {self._size[1]} pixels like "
                             f"those before it, found {recording.size[0]} x {recording.size[1]}")
        number, count = len(self._episodes), len(recording.times_s)
        columns = _episode_columns(recording, self._fps)
        if recording.task not in self.tasks:
            self.tasks.append(recording.task)
        columns["episode_index"] = np.full(count, number)
        columns["index"] = np.arange(self.frames, self.frames + count)
        columns["task_index"] = np.full(count, self.tasks.index(recording.task))
        place: dict[str, Any] = {}
        statistics, pictures = {name: vector_statistics(values) for name, values in columns.items()}, None
        if self._storage:
            place, statistics[CAMERA], pictures = self._add_images(recording)
        data = self._data.add(_arrow_episode(columns, pictures))
        for name, values in columns.items():
            self._columns.setdefault(name, []).append(values)
        self._episodes.append({
            "episode_index": number, "tasks": [recording.task], "length": count,
            **{f"data/{name}": value for name, value in data.items()}, "dataset_from_index": self.frames,
            "dataset_to_index": self.frames + count, **place, "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            **{f"segsim/{name}": recording.trial[name] for name in _TRIAL_COLUMNS},
            **{f"stats/{key}/{name}": value for key, found in statistics.items() for name, value in found.items()}})
        self.frames += count

    def _add_images(self, recording: TrialRecording) -> tuple[dict[str, Any], dict[str, list], list[bytes] | None]:
        source = self._images
        if source == "auto":
            source = "recorded" if recording.has_frames() else "rendered"
        self.sources.add(source)
        pictures, found, place = [], ImageStatistics(), {}
        if self._videos:
            self._videos.begin_episode()
            place = self._videos.place(len(recording.times_s))
        for image in recording.images(source, self._renderers):
            found.add(image)
            if self._videos:
                self._videos.add(image)
            else:
                pictures.append(png(image))
        self._pictures.merge(found)
        return place, found.statistics(), None if self._videos else pictures

    def finish(self, run: Run) -> None:
        self.close()
        statistics = {name: vector_statistics(np.concatenate(values)) for name, values in self._columns.items()}
        if self._storage:
            statistics[CAMERA] = self._pictures.statistics()
        fps = float(self._fps)
        rate = int(fps) if fps.is_integer() else fps
        write_json(self._root / "meta" / "info.json", {
            "codebase_version": "v3.0", "robot_type": "segsim", "total_episodes": len(self._episodes),
            "total_frames": self.frames, "total_tasks": len(self.tasks), "chunks_size": CHUNK_FILES,
            "data_files_size_in_mb": DATA_MB, "video_files_size_in_mb": VIDEO_MB, "fps": rate,
            "splits": {"train": f"0:{len(self._episodes)}"}, "data_path": DATA_PATH,
            "video_path": VIDEO_PATH if self._videos else None, "features": _features(self._storage, self._size, rate)})
        write_json(self._root / "meta" / "stats.json", statistics)
        write_json(self._root / "meta" / "segsim.json", provenance(run))
        write_tasks(self._root, self.tasks)
        file = self._root / EPISODES_PATH
        file.parent.mkdir(parents=True, exist_ok=True)
        import_pyarrow("pyarrow.parquet").write_table(import_pyarrow().Table.from_pylist(self._episodes), file)

    def close(self) -> None:
        try:
            self._data.close()
        finally:
            if self._videos:
                self._videos.close()


def _chosen(run: Run, arms: Iterable[str] | None, successes_only: bool) -> Iterator[dict[str, Any]]:
    names = [arm["name"] for arm in run.arms]
    wanted = set(names if arms is None else arms)
    for name in sorted(wanted - set(names)):
        raise InputError(f"arm: expected one of {', '.join(names)}, found {name}")
    for trial in run.trial_rows():
        if trial["arm"] in wanted and trial["outcome"] not in NOT_COUNTED and (trial["success"] or not successes_only):
            yield trial


def export_lerobot(run: Run | str | os.PathLike[str], folder: str | os.PathLike[str], images: str = "auto",
                   storage: str = "video", arms: Iterable[str] | None = None,
                   successes_only: bool = False) -> LeRobotSet:
    """Write trials as a LeRobot data set v3.0: a trial is an episode, a tick of control is a frame.

    run: a run, or the work folder of `segsim run`.
    folder: for the data set; it must not exist, and appears when the set is complete.
    images: "recorded", those that `frames` of the spec kept; "rendered", drawn again from the scene at the recorded
        poses, which gives the same pixels; "auto", recorded ones where a trial has all of them, else rendered ones; or
        "none".
    storage: "video" (H.264; needs PyAV) or "png" (inside the Parquet files, without loss).
    arms: only their trials. successes_only: only trials that succeeded.

    observation.state is x_m, y_m, yaw_rad of the robot in the world frame, the truth; action is forward_mps, turn_radps
    and stop (1 where the policy ends its search). Trials that count in no rate are left out. Needs pyarrow.
    """
    for name, value, words in (("images", images, IMAGES), ("storage", storage, STORAGES)):
        if value not in words:
            raise InputError(f"{name}: expected one of {', '.join(words)}, found {value}")
    run = run if isinstance(run, Run) else load_run(run)
    import_pyarrow()
    root = pathlib.Path(folder)
    if root.exists():
        raise InputError(f"{root}: expected a folder that is not there yet, found one")
    trials = list(_chosen(run, arms, successes_only))
    if not trials:
        raise InputError(f"{run.folder}: expected trials to export, found none")
    recordings = (read_recording(run, trial) for trial in trials)
    first = next(recordings)
    unfinished = root.with_name(f".{root.name}.{os.getpid()}")
    export = _Export(unfinished, first, images, storage)
    try:
        unfinished.mkdir(parents=True)
        for recording in itertools.chain([first], recordings):
            export.add(recording)
        export.finish(run)
        unfinished.rename(root)
    except BaseException:
        with contextlib.suppress(Exception):  # What could not be written cannot be closed, either.
            export.close()
        shutil.rmtree(unfinished, ignore_errors=True)
        raise
    sources = export.sources or {"none"}
    return LeRobotSet(root, len(trials), export.frames, export.tasks, sources.pop() if len(sources) == 1 else "mixed")
