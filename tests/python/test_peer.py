"""Classes that the simulator asks (fastsegsim/peer.py), asked here in its place."""
import io
import json
import struct

import numpy as np
import pytest

from fastsegsim import peer


def message(kind, **fields):
    text = json.dumps({"type": kind, **fields}).encode()
    return struct.pack("<I", len(text)) + text


def ask(make, *messages):
    """The answers of the class to all messages."""
    answers = io.BytesIO()
    peer.serve(make, io.BytesIO(b"".join(messages)), answers)
    data, found = answers.getvalue(), []
    while data:
        (count,) = struct.unpack("<I", data[:4])
        found.append(json.loads(data[4:4 + count]))
        data = data[4 + count:]
    return found


HELLO_POLICY = message("hello", schema="segsim.peer/1", role="policy")
HELLO_DETECTOR = message("hello", schema="segsim.peer/1", role="detector", goals=["couch", "tv"])
RESET = message("reset", goal={"class_name": "tv", "class_index": 1}, seed=2**64 - 1, class_names=["couch", "tv"],
                robot={"length_m": 0.5}, camera_height_m=1.2)


@pytest.fixture
def observation(tmp_path):
    """Fields of an observation of 4 x 2 pixels."""
    rgb = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    depth_m = np.linspace(0.5, 4.0, 8, dtype=np.float32).reshape(2, 4)
    depth_m[1, 2] = np.nan
    file = tmp_path / "images"
    file.write_bytes(rgb.tobytes() + bytes(40) + depth_m.tobytes() + bytes(32))
    turn = np.sqrt(0.5)
    return {"time_ns": 1_500_000_000, "capture_index": 7,
            "intrinsics": {"width_px": 4, "height_px": 2, "fx_px": 3.0, "fy_px": 3.5, "cx_px": 2.0, "cy_px": 1.0},
            "T_odom_robot": {"rotation_wxyz": [turn, 0, 0, turn], "translation_m": [1, 2, 0]},
            "T_robot_camera": {"rotation_wxyz": [1, 0, 0, 0], "translation_m": [0, 0, 1.2]},
            "images": {"file": str(file), "bytes": 128, "rgb": {"offset": 0, "shape": [2, 4, 3], "dtype": "uint8"},
                       "depth_m": {"offset": 64, "shape": [2, 4], "dtype": "float32"}}}


class Policy:
    def reset(self, episode):
        self.episode = episode

    def decide(self, seen, detections):
        assert (seen.time_s, seen.capture_index) == (1.5, 7)
        assert seen.rgb[1, 3, 2] == 23 and np.isnan(seen.depth_m[1, 2]) and seen.depth_m[0, 0] == 0.5
        assert np.allclose(seen.K, [[3, 0, 2], [0, 3.5, 1], [0, 0, 1]])
        # A quarter turn to the left: the robot's x is the odometry's y.
        assert np.allclose(seen.T_odom_robot @ [1, 0, 0, 1], [1, 3, 0, 1])
        assert seen.T_robot_camera[2, 3] == 1.2
        found = [d for d in detections if d.class_name == self.episode.goal]
        assert self.episode.seed == 2**64 - 1 and self.episode.robot["length_m"] == 0.5
        return peer.Decision(turn_radps=np.float32(0.25), target_m=tuple(np.array([1.0, 2.0])),
                             stop="goal_reached" if found else None)


def test_a_policy_sees_and_decides(observation):
    seen = {"class_index": 1, "score": 0.5, "box_px": [0, 0, 2, 2]}
    answers = ask(Policy, HELLO_POLICY, RESET, message("decide", detections=[], **observation),
                  message("decide", detections=[seen], **observation))
    assert answers[:2] == [{"type": "ready"}, {"type": "ok"}]
    assert answers[2] == {"type": "decision", "forward_mps": 0.0, "turn_radps": 0.25, "target_m": [1.0, 2.0]}
    assert answers[3]["stop"] == "goal_reached"


def test_a_policy_is_told_the_phrase():
    told = []

    class Listener(Policy):
        def reset(self, episode):
            told.append(episode.phrase)

    fields = json.loads(RESET[4:])
    fields["goal"]["phrase"] = "an old tv"
    ask(Listener, HELLO_POLICY, RESET, message(fields.pop("type"), **fields))
    assert told == ["", "an old tv"]


def test_a_detector_gets_the_goals(observation):
    class Detector:
        def __init__(self, goals):
            self.class_names = goals

        def detect(self, seen):
            return [peer.Detection(1, np.float64(0.5), np.array([1, 2, 3, 4]))]

    ready, found = ask(Detector, HELLO_DETECTOR, message("detect", **observation))
    assert ready == {"type": "ready", "class_names": ["couch", "tv"]}
    assert found == {"type": "detections", "detections": [{"class_index": 1, "score": 0.5, "box_px": [1, 2, 3, 4]}]}


def test_what_goes_wrong_is_told(observation, capsys):
    class Silent:
        def decide(self, seen, detections):
            return peer.Decision(forward_mps=float("nan"))

    answers = ask(Silent, HELLO_POLICY, RESET, message("decide", detections=[], **observation))
    assert answers[1] == {"type": "ok"}  # A policy need not have reset().
    assert answers[2]["type"] == "error" and "ValueError" in answers[2]["message"]
    (answer,) = ask(Silent, HELLO_DETECTOR)
    assert answer["message"] == "TypeError: Silent: expected a detector with a method detect(), found none"
    (answer,) = ask(Policy, message("hello", schema="segsim.peer/9", role="policy"))
    assert "segsim.peer/9" in answer["message"]
    assert "Traceback" in capsys.readouterr().err


def test_a_torchvision_network_is_a_detector(observation):
    torch = pytest.importorskip("torch")

    class Network(torch.nn.Module):
        def forward(self, images):
            assert images[0].shape == (3, 2, 4) and float(images[0].max()) == pytest.approx(23 / 255)
            return [{"boxes": torch.tensor([[0.0, 1, 2, 3], [1, 1, 2, 2]]), "labels": torch.tensor([2, 1]),
                     "scores": torch.tensor([0.75, 0.1])}]

    class Detector(peer.TorchvisionDetector):
        def __init__(self):
            super().__init__(Network(), ["__background__", "couch", "tv"])

    ready, found = ask(Detector, HELLO_DETECTOR, message("detect", **observation))
    assert ready["class_names"][2] == "tv"
    assert found["detections"] == [{"class_index": 2, "score": 0.75, "box_px": [0.0, 1.0, 2.0, 3.0]}]
