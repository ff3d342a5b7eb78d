"""The files of a LeRobot data set, format v3.0: tables, statistics and videos. lerobot_export.py fills them."""

import fractions
import importlib
import json
import pathlib
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fastsegsim._native import InputError
from fastsegsim.results.arrow_tables import import_pyarrow

CHUNK_FILES, DATA_MB, VIDEO_MB = 1000, 100, 200  # Files of a folder, sizes of files: LeRobot's own defaults.
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES_PATH = "meta/episodes/chunk-000/file-000.parquet"
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}

Statistics = dict[str, list]


def file_place(number: int) -> dict[str, int]:
    return {"chunk_index": number // CHUNK_FILES, "file_index": number % CHUNK_FILES}


def vector_statistics(values: NDArray[Any]) -> Statistics:
    """Of values [T] or [T, n]: lists of length 1 or n."""
    columns = np.asarray(values, np.float64).reshape(len(values), -1)
    found = {"min": columns.min(axis=0), "max": columns.max(axis=0), "mean": columns.mean(axis=0),
             "std": columns.std(axis=0)}
    found |= {name: np.quantile(columns, q, axis=0) for name, q in _QUANTILES.items()}
    return {**{name: row.tolist() for name, row in found.items()}, "count": [len(columns)]}


class ImageStatistics:
    """Of all pixels of images, by channel, in [0, 1]: a histogram of bytes has all of it."""

    def __init__(self) -> None:
        self.histogram = np.zeros((3, 256), np.int64)
        self.images = 0

    def add(self, image: NDArray[np.uint8]) -> None:
        for channel in range(3):
            self.histogram[channel] += np.bincount(image[..., channel].ravel(), minlength=256)
        self.images += 1

    def merge(self, other: "ImageStatistics") -> None:
        self.histogram += other.histogram
        self.images += other.images

    def statistics(self) -> Statistics:
        """Lists of the shape [3, 1, 1]."""
        levels, pixels = np.arange(256) / 255.0, self.histogram.sum(axis=1)
        mean = self.histogram @ levels / pixels
        there = self.histogram > 0
        below = np.cumsum(self.histogram, axis=1) / pixels[:, None]
        found = {"min": levels[there.argmax(axis=1)], "max": levels[255 - there[:, ::-1].argmax(axis=1)], "mean": mean,
                 "std": np.sqrt(np.maximum(0.0, self.histogram @ levels**2 / pixels - mean**2))}
        found |= {name: levels[(below >= q).argmax(axis=1)] for name, q in _QUANTILES.items()}
        return {**{name: row.reshape(3, 1, 1).tolist() for name, row in found.items()}, "count": [self.images]}


def png(image: NDArray[np.uint8]) -> bytes:
    """[H, W, 3] as a PNG file."""
    height, width, _ = image.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), image.reshape(height, -1)], axis=1)  # 0: rows as they are.

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 4)) +
            chunk(b"IEND", b""))


class DataFiles:
    """Frames of episodes, one behind the other, in as many files as their size demands."""

    def __init__(self, root: pathlib.Path) -> None:
        self._root, self._number, self._bytes = root, -1, 0
        self._writer: Any = None

    def add(self, episode: Any) -> dict[str, int]:
        """episode: a table. Returns the place of the file that it is in."""
        if self._writer is None or self._bytes + episode.nbytes > DATA_MB * 2**20:
            self.close()
            self._number += 1
            file = self._root / DATA_PATH.format(**file_place(self._number))
            file.parent.mkdir(parents=True, exist_ok=True)
            self._writer = import_pyarrow("pyarrow.parquet").ParquetWriter(file, episode.schema)
            self._bytes = 0
        self._writer.write_table(episode)
        self._bytes += episode.nbytes
        return file_place(self._number)

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()
        self._writer = None


class VideoFiles:
    """Images of episodes, one behind the other, as H.264 in as many files as their size demands. Needs PyAV."""

    def __init__(self, root: pathlib.Path, key: str, fps: fractions.Fraction, size: tuple[int, int]) -> None:
        try:
            self._av = importlib.import_module("av")
        except ImportError as error:
            raise ImportError("videos need PyAV: pip install 'fastsegsim[lerobot]', or av; "
                              "storage='png' does without") from error
        if size[0] % 2 or size[1] % 2:
            raise InputError(f"camera: expected an even width and height for a video, found {size[0]} x {size[1]}; "
                             "storage='png' takes any")
        self._root, self._key, self._fps, self._size = root, key, fps, size
        self._number, self._frames = -1, 0
        self._container: Any = None
        self._file = root

    def begin_episode(self) -> None:
        """What follows is in one file."""
        if self._container is not None and self._file.stat().st_size < VIDEO_MB * 2**20:
            return
        self.close()
        self._number += 1
        self._frames = 0
        self._file = self._root / VIDEO_PATH.format(video_key=self._key, **file_place(self._number))
        self._file.parent.mkdir(parents=True, exist_ok=True)
        self._container = self._av.open(str(self._file), "w")
        self._stream = self._container.add_stream("libx264", rate=self._fps)
        self._stream.width, self._stream.height = self._size
        self._stream.pix_fmt = "yuv420p"
        # Every second image stands alone, as in LeRobot's own videos: readers jump to any of them.
        self._stream.options = {"crf": "20", "g": "2", "bf": "0", "preset": "fast"}

    def place(self, frames: int) -> dict[str, Any]:
        """Of an episode of so many images, which follow."""
        begin = self._frames
        found = {"from_timestamp": float(begin / self._fps), "to_timestamp": float((begin + frames) / self._fps)}
        return {f"videos/{self._key}/{name}": value for name, value in {**file_place(self._number), **found}.items()}

    def add(self, image: NDArray[np.uint8]) -> None:
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
        frame.pts, frame.time_base = self._frames, 1 / self._fps
        self._container.mux(self._stream.encode(frame))
        self._frames += 1

    def close(self) -> None:
        if self._container is not None:
            self._container.mux(self._stream.encode())
            self._container.close()
        self._container = None


def write_json(file: pathlib.Path, value: Any) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(value, indent=4, ensure_ascii=False) + "\n", encoding="utf-8")


def write_tasks(root: pathlib.Path, tasks: list[str]) -> None:
    """A data frame with the tasks as its index, which pandas knows by the metadata."""
    pa = import_pyarrow()
    columns = [{"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
               for name, kind, numpy in (("task_index", "int64", "int64"), ("task", "unicode", "object"))]
    described = {"index_columns": ["task"], "column_indexes": [], "columns": columns, "creator": {"library": "pyarrow"},
                 "pandas_version": "2.0.0"}
    schema = pa.schema([("task_index", pa.int64()), ("task", pa.string())],
                       metadata={"pandas": json.dumps(described).encode()})
    table = pa.Table.from_arrays([pa.array(range(len(tasks)), pa.int64()), pa.array(tasks, pa.string())], schema=schema)
    import_pyarrow("pyarrow.parquet").write_table(table, root / "meta" / "tasks.parquet")
