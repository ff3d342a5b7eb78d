"""What a run keeps of a trial tick by tick: poses and commands of its logs, and the images of its camera."""

import dataclasses
import gzip
import json
import pathlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fastsegsim._native import InputError, Renderer, Scene, mast_camera, read_frame

if TYPE_CHECKING:
    from fastsegsim.results.stored_run import Run

_STOP_MODE = 4  # core::PolicyMode::kStop
_BATCH = 16  # Images that are drawn in one call.
IMAGES = ("auto", "recorded", "rendered", "none")


@dataclasses.dataclass(frozen=True)
class TrialRecording:
    """One trial of T ticks."""

    trial: dict[str, Any]  #: Its row of Run.trial_rows().
    task: str  #: "find a chair"; of a phrase "find a red chair".
    period_s: float  #: Of control.
    times_s: NDArray[np.float64]  #: [T], simulated, since the trial began.
    poses: NDArray[np.float64]  #: [T, 3], true: x [m], y [m], yaw [rad], world frame.
    commands: NDArray[np.float64]  #: [T, 2]: forward [m/s], turn [rad/s], left is positive.
    stops: NDArray[np.bool_]  #: [T]: the policy says that its search is over.
    size: tuple[int, int]  #: Of the camera's images: width, height, in pixels.
    K: NDArray[np.float64]  #: [3, 3]
    T_world_camera: NDArray[np.float64]  #: [T, 4, 4], where the camera is at each tick.
    bundle: pathlib.Path  #: Of the scene.
    frames: list[pathlib.Path]  #: Where each tick's recorded image would be.

    def has_frames(self) -> bool:
        """Whether the image of every tick was recorded."""
        return all(file.exists() for file in self.frames)

    def images(self, source: str, renderers: "Renderers") -> Iterator[NDArray[np.uint8]]:
        """Colour images [H, W, 3] of all ticks, "recorded" or "rendered" again, which gives the same."""
        if source == "recorded":
            for file in self.frames:
                if not file.exists():
                    raise InputError(f"{file}: expected the image of every tick, found none; `frames: {{of: all, "
                                     f"every_s: {self.period_s:g}}}` in the spec keeps them, and images='rendered' "
                                     "draws them again")
                yield read_frame(file, ["rgb"])["rgb"]
            return
        renderer = renderers.of(self.bundle)
        for begin in range(0, len(self.times_s), _BATCH):
            yield from renderer.render(self.T_world_camera[begin:begin + _BATCH], self.K, self.size, ("rgb",))["rgb"]


class Renderers:
    """One for the scene that was drawn last: trials come scene by scene."""

    def __init__(self) -> None:
        self._bundle: pathlib.Path | None = None
        self._renderer: Renderer | None = None

    def of(self, bundle: pathlib.Path) -> Renderer:
        if self._renderer is None or bundle != self._bundle:
            self._renderer, self._bundle = Renderer(Scene.load(bundle)), bundle
        return self._renderer


def _read_log(file: pathlib.Path) -> dict[str, Any]:
    try:
        log = json.loads(gzip.decompress(file.read_bytes()))
    except (OSError, EOFError, ValueError) as error:
        raise InputError(f"{file}: expected the log of a trial, found {error}") from error
    if not isinstance(log, dict) or log.get("schema") != "segsim.trial_log/1":
        raise InputError(f"{file}: expected a log of schema segsim.trial_log/1, found another file")
    return log


def _exact_ticks(file: pathlib.Path) -> list[list[float]] | None:
    """Rows of time [us], pose, command and mode, of the log for replays: it does not round."""
    if not file.exists():
        return None
    rows = []
    with file.open(encoding="utf-8") as lines:
        for line in lines:
            if line.startswith('{"tick"'):
                tick = json.loads(line)
                rows.append([tick["time_ns"] / 1000, *tick["pose"], *tick["command"], tick["mode"]])
    return rows


def read_recording(run: "Run", trial: dict[str, Any]) -> TrialRecording:
    """One trial of a run. Raises InputError if the run has no log of it."""
    if not trial["log"]:
        raise InputError(f"trial {trial['trial_id']}: expected a log, found none")
    log_file = run.folder / trial["log"]
    log = _read_log(log_file)
    stem = log_file.relative_to(run.folder / "logs").as_posix().removesuffix(".json.gz")
    try:
        ticks = _exact_ticks(run.folder / "replays" / f"{stem}.jsonl") or [row[:7] for row in log["ticks"]]
        rows = np.array(ticks, np.float64)
        width, height, fx, fy, cx, cy = log["camera"]
        at = log["camera_height_m"], log["camera_pitch_down_rad"]
        goal = log.get("phrase") or f"a {log['class']}"
        cameras = np.stack([mast_camera(row[1:4], *at) for row in rows])
        frames = [run.folder / "frames" / stem / f"frame-{k:06d}.exr" for k in range(len(rows))]
        return TrialRecording(trial, f"find {goal}", float(log["control_period_s"]), rows[:, 0] * 1e-6, rows[:, 1:4],
                              rows[:, 4:6], rows[:, 6] == _STOP_MODE, (int(width), int(height)),
                              np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), cameras, run.folder / log["bundle"],
                              frames)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise InputError(f"{log_file}: expected the log of a trial, found {type(error).__name__}: {error}") from error
