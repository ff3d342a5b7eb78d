"""Networks of others as detectors and scorers: with tiny ones, in the place of the simulator and in a run."""

import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

from conftest import RUN_SPEC
from fastsegsim import results
from fastsegsim.adapters import ImageTextDetector, ImageTextScorer, TorchvisionDetector
from fastsegsim.peer import Detection, Observation
from test_peer import HELLO_DETECTOR, ask, message, observation  # noqa: F401 (a fixture)

ROOT = pathlib.Path(__file__).resolve().parents[2]
COLOURS = {"red": (1, 0, 0), "green": (0, 1, 0), "blue": (0, 0, 1)}


def colour_scorer():
    """An "image-text model": images are their mean colour, texts the colour that they name; others are grey."""
    calls = []

    def encode_texts(texts):
        calls.append(list(texts))
        return [next((colour for name, colour in COLOURS.items() if name in text), (1, 1, 1)) for text in texts]

    return ImageTextScorer(lambda images: [image.mean(axis=(0, 1)) for image in images], encode_texts, 20.0), calls


class Everywhere:
    """Boxes that are always the same."""

    boxes = [(0, 0, 20, 20), (20, 0, 40, 20), (20, 0, 23, 20), (0, 20, 40, 40), (-30, 0, -10, 20)]

    def detect(self, seen):
        return [Detection(7, 0.9, box) for box in self.boxes]


def seen_image():
    rgb = np.full((40, 40, 3), 128, np.uint8)
    rgb[:20, :20] = (250, 5, 5)
    rgb[:20, 20:] = (5, 5, 250)
    return rgb


def observation_of(rgb):
    return Observation(0.0, 0, np.eye(3), np.eye(4), np.eye(4), rgb, None)


def test_scores_are_cosines_and_texts_are_encoded_once():
    scorer, calls = colour_scorer()
    red = np.full((4, 6, 3), (200, 0, 0), np.uint8)
    np.testing.assert_allclose(scorer.score(red, ["red", "green", "grey"]), [1, 0, 1 / np.sqrt(3)], atol=1e-12)
    assert scorer.score(red, ["green", "red"]).tolist() == [0.0, 1.0]
    assert calls == [["red", "green", "grey"]]
    likely = scorer.probabilities([red, np.full((2, 2, 3), 9, np.uint8)], ["red", "grey"])
    np.testing.assert_allclose(likely.sum(axis=1), 1.0)
    assert likely[0, 0] > 0.99 and likely[1, 1] > 0.99
    assert scorer.cosines([], ["red"]).shape == (0, 1)


def test_embeddings_of_another_shape_are_refused():
    scorer = ImageTextScorer(lambda images: np.ones((3, 2)), lambda texts: np.ones((len(texts), 2)))
    with pytest.raises(ValueError, match=r"encode_images: expected an array \[1, d\], found one of the shape \(3, 2\)"):
        scorer.score(np.zeros((2, 2, 3), np.uint8), ["red"])


def test_boxes_are_named_with_the_goals(observation):  # noqa: F811
    detector = ImageTextDetector(["blue couch", "red chair"], Everywhere(), colour_scorer()[0])
    found = detector.detect(observation_of(seen_image()))
    # Not the narrow box, the grey one or the one beyond the image.
    assert [(d.class_index, d.box_px) for d in found] == [(1, (0, 0, 20, 20)), (0, (20, 0, 40, 20))]
    assert all(0.5 <= d.score <= 1.0 for d in found)
    assert detector.detect(observation_of(None)) == []

    class Served(ImageTextDetector):
        def __init__(self, goals):
            super().__init__(goals, Everywhere(), colour_scorer()[0])

    ready, answer = ask(Served, HELLO_DETECTOR, message("detect", **observation))
    assert ready["class_names"] == ["couch", "tv"] and answer["type"] == "detections"


def test_a_model_with_the_interface_of_clip_is_a_scorer():
    torch = pytest.importorskip("torch")
    pytest.importorskip("PIL")

    class Model(torch.nn.Module):
        def encode_image(self, images):
            assert images.shape[1:] == (3, 2, 2) and not torch.is_grad_enabled()
            return images.mean(dim=(2, 3))

        def encode_text(self, tokens):
            return torch.nn.functional.one_hot(tokens, 3).half()

    def preprocess(picture):
        return torch.from_numpy(np.array(picture.resize((2, 2)))).permute(2, 0, 1) / 255.0

    scorer = ImageTextScorer.of_clip(Model(), preprocess, lambda texts: torch.tensor([len(t) - 1 for t in texts]))
    blue = np.full((8, 8, 3), (0, 0, 77), np.uint8)
    np.testing.assert_allclose(scorer.score(blue, ["a", "ab", "abc"]), [0, 0, 1], atol=1e-6)


COUCH_FINDER = """
import numpy as np
from fastsegsim.adapters import ImageTextDetector, ImageTextScorer
from fastsegsim.peer import Detection


class Whole:
    def detect(self, seen):
        height, width, _ = seen.rgb.shape
        return [Detection(0, 1.0, (0, 0, width, height))]


class Finder(ImageTextDetector):
    def __init__(self, goals):
        super().__init__(goals, Whole(), ImageTextScorer(lambda images: np.ones((len(images), 2)),
                                                         lambda texts: [(1, "chair" not in t) for t in texts]), 0.2)
"""


@pytest.mark.parametrize("installed", [True, False])
def test_an_adapter_serves_a_run(tiny, segsim, tmp_path, monkeypatch, installed):
    monkeypatch.setenv("PATH", f"{pathlib.Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.chdir(ROOT)  # Where the program finds peer.py.
    if not installed:  # What lies beside the program serves then.
        monkeypatch.delenv("PYTHONPATH", raising=False)
    (tmp_path / "finder.py").write_text(COUCH_FINDER)
    spec = RUN_SPEC.format(bundle=tiny.bundle)
    for before, after in [("after, detector: oracle, policy: oracle-path",
                           "after, detector: 'python:finder:Finder', policy: frontier"),
                          ("episodes: 4", "episodes: 2"), ("time_limit_s: 12", "time_limit_s: 2")]:
        spec = spec.replace(before, after)
    (tmp_path / "spec.yaml").write_text(spec)
    segsim("run", tmp_path / "spec.yaml", "--work", tmp_path / "work")
    trials = results.load_run(tmp_path / "work").trial_rows()
    mine = [t for t in trials if t["arm"] == "after"]
    assert len(mine) == 2 and {t["error"] for t in mine} == {""}
    assert all(t["true_detections"] + t["false_detections"] > 0 for t in mine if t["goal_class"] == "couch")


TINY_NETWORK = """
import torch


class ColourFinder(torch.nn.Module):
    '''Learns the colour of each label, and boxes all pixels that are near it.'''

    def __init__(self, num_classes):
        super().__init__()
        self.colours = torch.nn.Parameter(torch.full((num_classes, 3), 0.5))

    def forward(self, images, targets=None):
        if self.training:
            losses = []
            for image, target in zip(images, targets):
                for box, label in zip(target["boxes"].round().int().tolist(), target["labels"].tolist()):
                    inside = image[:, box[1]:box[3], box[0]:box[2]].mean(dim=(1, 2))
                    losses.append(((inside - self.colours[label])**2).sum())
            return {"colour": torch.stack(losses).mean()}
        found = []
        for image in images:
            boxes, scores, labels = [], [], []
            for label in range(1, len(self.colours)):
                near = ((image - self.colours[label][:, None, None]).abs().amax(dim=0) < 0.1).nonzero()
                if len(near):
                    (y0, x0), (y1, x1) = near.amin(dim=0).tolist(), near.amax(dim=0).tolist()
                    boxes.append([x0, y0, x1 + 1, y1 + 1])
                    scores.append(0.9)
                    labels.append(label)
            found.append({"boxes": torch.tensor(boxes).reshape(-1, 4), "scores": torch.tensor(scores),
                          "labels": torch.tensor(labels)})
        return found
"""


def write_views(folder, count):
    """Pictures with a red and a green square each, labelled as `segsim label` does."""
    image_module = pytest.importorskip("PIL.Image")
    random = np.random.default_rng(count)
    coco = {"images": [], "annotations": [], "categories": [{"id": 5, "name": "couch"}, {"id": 9, "name": "chair"}]}
    (folder / "images").mkdir(exist_ok=True)
    for k in range(count):
        rgb = np.full((48, 64, 3), 90, np.uint8)
        coco["images"].append({"id": k + 1, "file_name": f"images/{count}-{k}.png", "width": 64, "height": 48})
        for category, colour, left in ((5, (230, 20, 20), 0), (9, (20, 200, 20), 32)):
            x, y, side = left + int(random.integers(16)), int(random.integers(30)), int(random.integers(8, 16))
            rgb[y:y + side, x:x + side] = colour
            coco["annotations"].append({"id": len(coco["annotations"]) + 1, "image_id": k + 1, "category_id": category,
                                        "bbox": [x, y, side, side], "area": side * side, "iscrowd": 0})
        image_module.fromarray(rgb).save(folder / f"images/{count}-{k}.png")
    file = folder / f"views-{count}.json"
    file.write_text(json.dumps(coco))
    return file


def test_the_example_tunes_a_detector(tmp_path):
    torch = pytest.importorskip("torch")
    train, validation = write_views(tmp_path, 12), write_views(tmp_path, 5)
    (tmp_path / "tiny_network.py").write_text(TINY_NETWORK)
    program = ROOT / "python/examples/tune_detector.py"
    command = [sys.executable, program, train, validation, "--network", "tiny_network:ColourFinder", "--rate", "0.1"]
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    printed = subprocess.run([*command, "--steps", "100"], cwd=tmp_path, check=True, capture_output=True, text=True,
                             env={**os.environ, "PYTHONPATH": paths}).stdout
    assert "before: AP50 0.000 (couch 0.000, chair 0.000)" in printed
    assert "after: AP50 1.000 (couch 1.000, chair 1.000)" in printed and "gain: +1.000" in printed
    colours = torch.load(tmp_path / "tuned.pt", weights_only=True)["colours"]
    np.testing.assert_allclose(colours[1], np.array([230, 20, 20]) / 255, atol=0.05)


def test_a_network_of_torchvision_takes_the_labels(tmp_path):
    pytest.importorskip("torchvision")
    train, validation = write_views(tmp_path, 4), write_views(tmp_path, 2)
    program = ROOT / "python/examples/tune_detector.py"
    printed = subprocess.run([sys.executable, program, train, validation, "--steps", "1"], cwd=tmp_path, check=True,
                             capture_output=True, text=True).stdout
    assert "before: AP50 0." in printed and "step 0: loss " in printed and "gain: " in printed


def test_a_torchvision_detector_finds_in_any_picture():
    torch = pytest.importorskip("torch")

    class Network(torch.nn.Module):
        def forward(self, images):
            box, label = torch.tensor([[0.0, 1, 2, 3]]), torch.tensor([1])
            return [{"boxes": box, "labels": label, "scores": images[0].max()[None]}]

    detector = TorchvisionDetector(Network(), ["__background__", "couch"])
    picture = np.full((3, 4, 3), 51, np.uint8)
    assert detector.find(picture) == []  # 0.2 is below the threshold.
    picture[0, 0, 0] = 255
    expected = [Detection(1, 1.0, (0.0, 1.0, 2.0, 3.0))]
    assert detector.find(picture) == detector.detect(observation_of(picture)) == expected
