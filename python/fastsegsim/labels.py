"""Labelled views as `segsim label` writes them (COCO), and how well a detector finds what is in them.

    views = labels.load_views("views/val_views.json")
    found = [my_detector(view.file) for view in views]                    # A list of peer.Detection for each view.
    labels.average_precision(views, found).ap50

docs/label_views.md has the format. NumPy is all that this module needs.
"""

import dataclasses
import json
import os
import pathlib
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fastsegsim.peer import Detection

_MOST_DETECTIONS = 100  # Of an image and class: COCO's.
_RECALL_POINTS = np.linspace(0.0, 1.0, 101)
_IOU_THRESHOLDS = np.linspace(0.5, 0.95, 10)


@dataclasses.dataclass(frozen=True)
class View:
    """One picture with its n boxes."""

    file: pathlib.Path
    size: tuple[int, int]  #: Width, height, in pixels.
    boxes: NDArray[np.float32]  #: [n, 4]: x0, y0, x1, y1, in pixels; half-open.
    classes: NDArray[np.int64]  #: [n], into Views.class_names.
    ignore: NDArray[np.bool_]  #: [n]: neither object nor background.
    crowd: NDArray[np.bool_]  #: [n]: a region of many objects; ignored, too.
    image_id: int  #: In the file.

    def objects(self) -> NDArray[np.int64]:
        """Numbers of the boxes to train on."""
        return np.flatnonzero(~self.ignore & ~self.crowd & (self.boxes[:, 2:] > self.boxes[:, :2]).all(axis=1))


class Views(list[View]):
    """All views of a file."""

    class_names: list[str]
    category_ids: list[int]  # In the file, by class.


class Precision(NamedTuple):
    """Average precision by COCO's rules, in [0, 1]; -1 without objects."""

    ap: float  #: Mean over the IoUs 0.50, 0.55, ..., 0.95.
    ap50: float  #: At IoU 0.5.
    ap50_of: dict[str, float]  #: By class, of those that have objects.


def load_views(file: str | os.PathLike[str]) -> Views:
    """Views of a COCO file. Raises ValueError with file and cause for one that is none."""
    path = pathlib.Path(file)
    try:
        return _views(path.parent, json.loads(path.read_text(encoding="utf-8")))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"{path}: expected labels in COCO's format, found {type(error).__name__}: {error}") from error


def _views(folder: pathlib.Path, coco: dict[str, Any]) -> Views:
    views = Views()
    views.class_names = [category["name"] for category in coco["categories"]]
    views.category_ids = [category["id"] for category in coco["categories"]]
    class_of = {number: k for k, number in enumerate(views.category_ids)}
    of_image: dict[int, list[dict[str, Any]]] = {image["id"]: [] for image in coco["images"]}
    for annotation in coco["annotations"]:
        of_image[annotation["image_id"]].append(annotation)
    for image in coco["images"]:
        found = of_image[image["id"]]
        box = np.array([a["bbox"] for a in found], np.float64).reshape(-1, 4)
        corners = np.concatenate([box[:, :2], box[:, :2] + box[:, 2:]], axis=1).astype(np.float32)
        flags = {name: np.array([bool(a.get(name, 0)) for a in found], bool) for name in ("ignore", "iscrowd")}
        classes = np.array([class_of[a["category_id"]] for a in found], np.int64)
        views.append(View(folder / image["file_name"], (image["width"], image["height"]), corners, classes,
                          flags["ignore"], flags["iscrowd"], image["id"]))
    return views


def coco_results(views: Views, detections: Sequence[Iterable[Detection]]) -> list[dict[str, Any]]:
    """Detections of each view as COCO's results, for `segsim detector score --results`."""
    rows = []
    for view, found in zip(views, detections, strict=True):
        for d in found:
            x0, y0, x1, y1 = (float(value) for value in d.box_px)
            rows.append({"image_id": view.image_id, "category_id": views.category_ids[d.class_index],
                         "bbox": [x0, y0, x1 - x0, y1 - y0], "score": float(d.score)})
    return rows


def _overlaps(found: NDArray[np.float64], truth: NDArray[np.float64], crowd: NDArray[np.bool_]) -> NDArray[np.float64]:
    """[detections, boxes]: intersection over union; over the detection's own area if the box is a crowd."""
    low, high = np.maximum(found[:, None, :2], truth[None, :, :2]), np.minimum(found[:, None, 2:], truth[None, :, 2:])
    shared = np.prod(np.maximum(0.0, high - low), axis=2)
    area, other = (np.prod(boxes[:, 2:] - boxes[:, :2], axis=1) for boxes in (found, truth))
    union = np.where(crowd, area[:, None], area[:, None] + other - shared)
    return np.where(shared > 0, shared / np.maximum(union, 1e-12), 0.0)


def _match(overlaps: NDArray[np.float64], ignored: NDArray[np.bool_], crowd: NDArray[np.bool_],
           least: float) -> list[bool | None]:
    """Whether each detection, best score first, finds an object; None: it counts neither way."""
    taken = np.zeros(len(ignored), bool)
    verdicts: list[bool | None] = []
    for row in overlaps:
        choice = -1
        for real in (True, False):  # Objects come before what is ignored.
            free = (ignored != real) & (~taken | crowd) & (row >= min(least, 1 - 1e-10))
            if free.any():
                best = np.flatnonzero(free)
                choice = int(best[len(best) - 1 - row[best][::-1].argmax()])  # Of equals COCO takes the last.
                break
        if choice >= 0:
            taken[choice] = True
        verdicts.append(False if choice < 0 else None if ignored[choice] else True)
    return verdicts


def _class_precision(views: Views, detections: Sequence[Sequence[Detection]],
                     of_class: int) -> NDArray[np.float64] | None:
    """Average precision at each IoU threshold; None without objects."""
    objects = 0
    scores: list[float] = []
    verdicts: list[list[bool | None]] = [[] for _ in _IOU_THRESHOLDS]
    for view, found in zip(views, detections, strict=True):
        chosen = view.classes == of_class
        ignored = (view.ignore | view.crowd)[chosen]
        objects += int((~ignored).sum())
        mine = sorted((d for d in found if d.class_index == of_class), key=lambda d: -d.score)[:_MOST_DETECTIONS]
        if not mine:
            continue
        boxes = np.array([d.box_px for d in mine], np.float64)
        overlaps = _overlaps(boxes, view.boxes[chosen].astype(np.float64), view.crowd[chosen])
        scores += [float(d.score) for d in mine]
        for k, least in enumerate(_IOU_THRESHOLDS):
            verdicts[k] += _match(overlaps, ignored, view.crowd[chosen], least)
    if objects == 0:
        return None
    order = np.argsort(-np.array(scores), kind="stable")
    return np.array([_area([judged[k] for k in order], objects) for judged in verdicts])


def _area(judged: list[bool | None], objects: int) -> float:
    """Under the curve of precision over recall, which falls nowhere from the right."""
    right = np.array([verdict for verdict in judged if verdict is not None], bool)
    if len(right) == 0:
        return 0.0
    found = np.cumsum(right)
    precision = np.maximum.accumulate((found / np.arange(1, len(right) + 1))[::-1])[::-1]
    at = np.searchsorted(found / objects, _RECALL_POINTS)
    return float(np.where(at < len(right), precision[np.minimum(at, len(right) - 1)], 0.0).mean())


def average_precision(views: Views, detections: Sequence[Iterable[Detection]]) -> Precision:
    """How well detections, a list for each view, find the objects: COCO's rules, all sizes, 100 detections of a class.

    Detections must have a score each, down to low ones: a threshold hides part of the curve.
    """
    lists = [list(found) for found in detections]
    by_class = {}
    for k, name in enumerate(views.class_names):
        found = _class_precision(views, lists, k)
        if found is not None:
            by_class[name] = found
    if not by_class:
        return Precision(-1.0, -1.0, {})
    return Precision(float(np.mean([row.mean() for row in by_class.values()])),
                     float(np.mean([row[0] for row in by_class.values()])),
                     {name: float(row[0]) for name, row in by_class.items()})
