"""Python classes as policies and detectors of the simulator: `policy: python:my_module:MyPolicy` in a spec.

The class runs in a process of its own and is made once for each worker of a run. NumPy is all that this module needs.

    class MyPolicy:
        def reset(self, episode: Episode) -> None: ...                    # Before every episode; may be left out.
        def decide(self, seen: Observation, detections: list[Detection]) -> Decision: ...

    class MyDetector:
        def __init__(self, goals: list[str]): self.class_names = goals    # Or without goals, and names of its own.
        def detect(self, seen: Observation) -> list[Detection]: ...

docs/connect.md describes the messages behind it. An exception fails the trial, with its text in the results.
"""

import argparse
import dataclasses
import importlib
import importlib.util
import inspect
import json
import os
import struct
import sys
import traceback
import types
from typing import Any, BinaryIO, Callable, Optional

import numpy as np

SCHEMA = "segsim.peer/1"


@dataclasses.dataclass
class Episode:
    """What is searched for, and by which robot. Nothing of the truth."""

    goal: str
    goal_index: int  # Into class_names; -1: the detector has no such class.
    seed: int  # All randomness of the policy should derive from it.
    class_names: list[str]  # Of the detector.
    robot: dict[str, float]  # length_m, width_m, max_forward_mps, max_turn_radps, ...
    camera_height_m: float
    phrase: str = ""  # "a red chair": which objects of the class are meant; empty: any.


@dataclasses.dataclass
class Observation:
    """One image and where it was taken. The arrays are valid until the answer; copy what you keep."""

    time_s: float  # Simulated, since the episode began.
    capture_index: int
    K: np.ndarray  # [3, 3], pixels; pixel (i, j) has its centre at (i + 0.5, j + 0.5).
    T_odom_robot: np.ndarray  # [4, 4], metres: p_odom = T_odom_robot @ p_robot. The robot's own estimate.
    T_robot_camera: np.ndarray  # [4, 4]; the camera's x is right, y down, z forward.
    rgb: Optional[np.ndarray]  # uint8 [height, width, 3], sRGB.
    depth_m: Optional[np.ndarray]  # float32 [height, width], along the optical axis; NaN: not measured.


@dataclasses.dataclass
class Detection:
    class_index: int  # Into the detector's class_names.
    score: float  # In [0, 1].
    box_px: tuple[float, float, float, float]  # x0, y0, x1, y1.
    class_name: str = ""  # Told to policies; detectors need not.


@dataclasses.dataclass
class Decision:
    forward_mps: float = 0.0
    turn_radps: float = 0.0  # Positive turns left.
    stop: Optional[str] = None  # "goal_reached", or why the search ends.
    mode: Optional[str] = None  # "explore", "navigate", "recover", ... for logs and pictures.
    path_m: Optional[list[tuple[float, float]]] = None  # Plans in the odometry frame, for pictures.
    frontiers_m: Optional[list[tuple[float, float]]] = None
    target_m: Optional[tuple[float, float]] = None


class TorchvisionDetector:
    """A network with torchvision's interface for detection as a detector:

        class MyDetector(TorchvisionDetector):
            def __init__(self):
                weights = FasterRCNN_MobileNet_V3_Large_FPN_Weights.DEFAULT
                super().__init__(fasterrcnn_mobilenet_v3_large_fpn(weights=weights), weights.meta["categories"])
    """

    def __init__(self, model: Any, categories: list[str], score_threshold: float = 0.3, device: str = "cpu") -> None:
        """categories: by the network's labels; those that a scene calls otherwise are to be renamed. A network in training
        mode is set to evaluation."""
        self._model = model.to(device).eval()
        self._device = device
        self._score_threshold = score_threshold
        self.class_names = list(categories)

    def detect(self, seen: Observation) -> list[Detection]:
        """What the robot's image shows."""
        return [] if seen.rgb is None else self.find(seen.rgb)

    def find(self, rgb: np.ndarray) -> list[Detection]:
        """rgb: uint8 [height, width, 3], sRGB."""
        import torch

        image = torch.from_numpy(np.array(rgb)).to(self._device).permute(2, 0, 1).float() / 255.0
        with torch.inference_mode():
            found = self._model([image])[0]
        rows = zip(found["labels"].tolist(), found["scores"].tolist(), found["boxes"].tolist())
        return [Detection(label, score, tuple(box)) for label, score, box in rows if score >= self._score_threshold]


def _transform(message: dict[str, Any]) -> np.ndarray:
    w, x, y, z = message["rotation_wxyz"]
    T = np.eye(4)
    T[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                 [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                 [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    T[:3, 3] = message["translation_m"]
    return T


class _SharedImages:
    """The simulator's memory, mapped once and again when it grows."""

    def __init__(self) -> None:
        self._key: tuple[str, int] = ("", 0)
        self._bytes = np.zeros(0, np.uint8)

    def read(self, images: dict[str, Any], name: str) -> Optional[np.ndarray]:
        if name not in images:
            return None
        key = (images["file"], images["bytes"])
        if key != self._key:
            self._bytes, self._key = np.memmap(images["file"], np.uint8, "r", shape=(images["bytes"],)), key
        image = images[name]
        dtype = np.dtype(image["dtype"])
        count = int(np.prod(image["shape"])) * dtype.itemsize
        begin = image["offset"]
        return self._bytes[begin:begin + count].view(dtype).reshape(image["shape"])


def _observation(message: dict[str, Any], shared: _SharedImages) -> Observation:
    K = message["intrinsics"]
    return Observation(message["time_ns"] * 1e-9, message["capture_index"],
                       np.array([[K["fx_px"], 0, K["cx_px"]], [0, K["fy_px"], K["cy_px"]], [0, 0, 1.0]]),
                       _transform(message["T_odom_robot"]), _transform(message["T_robot_camera"]),
                       shared.read(message["images"], "rgb"), shared.read(message["images"], "depth_m"))


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays as JSON has them."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is no number, text or list")


class _Server:
    def __init__(self, make: Callable[..., Any]) -> None:
        self._make = make
        self._shared = _SharedImages()
        self._stage: Any = None
        self._class_names: list[str] = []

    def answer(self, message: dict[str, Any]) -> dict[str, Any]:
        kind = message["type"]
        if kind == "hello":
            return self._begin(message)
        if kind == "reset":
            self._class_names = message["class_names"]
            episode = Episode(message["goal"]["class_name"], message["goal"]["class_index"], message["seed"],
                              self._class_names, message["robot"], message["camera_height_m"],
                              message["goal"].get("phrase", ""))
            if hasattr(self._stage, "reset"):
                self._stage.reset(episode)
            return {"type": "ok"}
        seen = _observation(message, self._shared)
        if kind == "detect":
            found = self._stage.detect(seen)
            return {"type": "detections", "detections": [
                {"class_index": d.class_index, "score": d.score, "box_px": list(d.box_px)} for d in found]}
        detections = [Detection(d["class_index"], d["score"], tuple(d["box_px"]), self._class_names[d["class_index"]])
                      for d in message["detections"]]
        decision = self._stage.decide(seen, detections)
        told = {key: value for key, value in dataclasses.asdict(decision).items() if value is not None}
        return {"type": "decision", **told}

    def _begin(self, message: dict[str, Any]) -> dict[str, Any]:
        if message["schema"] != SCHEMA:
            raise ValueError(f"expected the protocol {SCHEMA}, found {message['schema']}")
        role = message["role"]
        method = "decide" if role == "policy" else "detect"
        if not hasattr(self._make, method):
            raise TypeError(f"{self._make.__name__}: expected a {role} with a method {method}(), found none")
        takes_goals = role == "detector" and "goals" in inspect.signature(self._make).parameters
        self._stage = self._make(goals=message["goals"]) if takes_goals else self._make()
        if role == "policy":
            return {"type": "ready"}
        return {"type": "ready", "class_names": list(self._stage.class_names)}


def serve(make: Callable[..., Any], requests: BinaryIO, answers: BinaryIO) -> None:
    """Answers as an object of the class until the other side closes."""
    server = _Server(make)
    while len(header := requests.read(4)) == 4:
        message = json.loads(requests.read(struct.unpack("<I", header)[0]))
        try:
            text = json.dumps(server.answer(message), default=_plain, allow_nan=False)
        except Exception as error:  # Whatever it is, the trial's row tells it.
            traceback.print_exc()
            text = json.dumps({"type": "error", "message": f"{type(error).__name__}: {error}"})
        data = text.encode()
        answers.write(struct.pack("<I", len(data)) + data)
        answers.flush()


def main() -> None:
    parser = argparse.ArgumentParser(description="Serves a class as a policy or a detector on standard streams.")
    parser.add_argument("--path", default="", help="folder in which the module is looked for first")
    parser.add_argument("name", metavar="MODULE:CLASS")
    arguments = parser.parse_args()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # What the class prints goes to standard error, and cannot be taken for an answer.
    sys.path[0] = arguments.path  # Instead of this file's folder.
    # Types are imported from fastsegsim.peer, which is this file: also where the package is not installed, or another
    # version of it is.
    if importlib.util.find_spec("fastsegsim") is None:
        package = types.ModuleType("fastsegsim")
        package.__path__ = [os.path.dirname(os.path.abspath(__file__))]  # For fastsegsim.adapters, which lies beside.
        sys.modules["fastsegsim"] = package
    sys.modules["fastsegsim.peer"] = sys.modules["__main__"]
    module, _, name = arguments.name.partition(":")
    try:
        make = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        sys.exit(f"{arguments.name}: {error}")
    serve(make, sys.stdin.buffer, answers)


if __name__ == "__main__":
    main()
