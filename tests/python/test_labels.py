"""Labelled views, and average precision as the program computes it."""

import json
import re

import numpy as np
import pytest

from fastsegsim.labels import average_precision, coco_results, load_views
from fastsegsim.peer import Detection


def write_labels(file, random, images=30):
    """Boxes at random, of which some are ignored or crowds."""
    coco = {"images": [], "annotations": [], "categories": [{"id": 3, "name": "couch"}, {"id": 1, "name": "chair"},
                                                            {"id": 8, "name": "never"}]}
    for k in range(images):
        coco["images"].append({"id": 100 + k, "file_name": f"images/{k}.png", "width": 64, "height": 48})
        for _ in range(random.integers(5)):
            x, y, w, h = (int(v) for v in random.integers(4, 24, 4))
            coco["annotations"].append({"id": len(coco["annotations"]) + 1, "image_id": 100 + k,
                                        "category_id": int(random.choice([3, 1])), "bbox": [x, y, w, h], "area": w * h,
                                        "iscrowd": int(random.random() < 0.1), "ignore": int(random.random() < 0.2)})
    file.write_text(json.dumps(coco))
    return file


def guesses(views, random):
    """Shifted true boxes and wrong ones."""
    found = []
    for view in views:
        mine = []
        for box, of_class in zip(view.boxes, view.classes):
            for _ in range(random.integers(1, 3)):
                shifted = box + random.normal(0, 0.6, 4)
                of_class = of_class if random.random() < 0.9 else 1 - of_class
                mine.append(Detection(int(of_class), round(float(random.uniform(0.3, 1.0)), 2), tuple(shifted)))
        if random.random() < 0.5:
            mine.append(Detection(0, float(random.random()), (1.0, 1.0, 20.0, 15.0)))
        found.append(mine)
    return found


def test_views_are_what_the_file_says(tmp_path):
    coco = {"images": [{"id": 7, "file_name": "images/a.png", "width": 64, "height": 48},
                       {"id": 8, "file_name": "images/b.png", "width": 64, "height": 48}],
            "categories": [{"id": 2, "name": "tv"}, {"id": 1, "name": "chair"}],
            "annotations": [{"id": 1, "image_id": 8, "category_id": 1, "bbox": [1, 2, 10, 20], "ignore": 1},
                            {"id": 2, "image_id": 8, "category_id": 2, "bbox": [0.5, 0, 4, 4], "area": 9}]}
    file = tmp_path / "train.json"
    file.write_text(json.dumps(coco))
    views = load_views(file)
    assert views.class_names == ["tv", "chair"] and [len(view.boxes) for view in views] == [0, 2]
    view = views[1]
    assert view.file == tmp_path / "images/b.png" and view.size == (64, 48)
    assert view.boxes.tolist() == [[1, 2, 11, 22], [0.5, 0, 4.5, 4]] and view.boxes.dtype == np.float32
    assert view.classes.tolist() == [1, 0] and view.objects().tolist() == [1]
    coco["annotations"][0]["category_id"] = 5
    file.write_text(json.dumps(coco))
    for text in (file.read_text(), "[]", "{", '{"images": 3}'):
        file.write_text(text)
        with pytest.raises(ValueError, match="train.json: expected labels in COCO's format"):
            load_views(file)


def test_average_precision_is_the_programs(tmp_path, segsim):
    random = np.random.default_rng(4)
    file = write_labels(tmp_path / "truth.json", random)
    views = load_views(file)
    found = guesses(views, random)
    (tmp_path / "found.json").write_text(json.dumps(coco_results(views, found)))
    printed = segsim("detector", "score", "--truth", file, "--results", tmp_path / "found.json")
    numbers = [float(value) for value in re.findall(r"(-?\d+\.\d+)\s*$", printed, re.MULTILINE)]
    mine = average_precision(views, found)
    assert 0.1 < mine.ap < mine.ap50 < 0.95
    assert mine.ap == pytest.approx(numbers[0], abs=1e-9) and mine.ap50 == pytest.approx(numbers[1], abs=1e-9), printed


def test_average_precision_by_hand(tmp_path):
    views = load_views(write_labels(tmp_path / "truth.json", np.random.default_rng(1)))
    perfect = [[Detection(int(c), 0.9, tuple(box)) for box, c in zip(view.boxes, view.classes)] for view in views]
    assert average_precision(views, perfect)[:2] == (1.0, 1.0)
    assert list(average_precision(views, perfect).ap50_of) == ["couch", "chair"]
    assert average_precision(views, [[] for _ in views])[:2] == (0.0, 0.0)
    none = type(views)(views[:0])
    none.class_names = views.class_names
    assert average_precision(none, []) == (-1.0, -1.0, {})
    with pytest.raises(ValueError):
        average_precision(views, perfect[1:])
