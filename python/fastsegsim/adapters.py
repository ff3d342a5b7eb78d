"""Networks of others as detectors and scorers of the simulator, for classes that a spec names (fastsegsim/peer.py).

    detector: python:my_module:MyDetector        # In a spec; my_module.py lies beside it.

TorchvisionDetector is any network with torchvision's interface. ImageTextScorer is any pair of encoders of images and
texts into one space (CLIP, SigLIP), for policies that ask how well a view fits a phrase; ImageTextDetector names the
boxes of another detector with it, so that the goals of a spec may be any words. NumPy is all that is imported here.
"""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fastsegsim.peer import Detection, Observation, TorchvisionDetector

__all__ = ["BoxSource", "ImageTextDetector", "ImageTextScorer", "TorchvisionDetector"]


class BoxSource(Protocol):
    """What finds boxes, of whatever class: any detector."""

    def detect(self, seen: Observation) -> list[Detection]:
        """Boxes of one image."""


class ImageTextScorer:
    """How well images fit texts: cosines of their embeddings.

        model, _, preprocess = open_clip.create_model_and_transforms("ViT-B-32", pretrained="laion2b_s34b_b79k")
        scorer = ImageTextScorer.of_clip(model, preprocess, open_clip.get_tokenizer("ViT-B-32"))
        scorer.score(seen.rgb, ["a chair", "an office"])
    """

    def __init__(self, encode_images: Callable[[list[NDArray[np.uint8]]], ArrayLike],
                 encode_texts: Callable[[list[str]], ArrayLike], scale: float = 100.0) -> None:
        """encode_images: n images [H, W, 3] (uint8, sRGB) to [n, d]; encode_texts: n texts to [n, d].
        scale: what cosines are multiplied with before a softmax; 100 is what CLIP was trained to."""
        self._encode_images, self._encode_texts = encode_images, encode_texts
        self.scale = scale
        self._known: dict[str, NDArray[np.float64]] = {}  # Texts are the same in every image.

    @staticmethod
    def of_clip(model: Any, preprocess: Callable[[Any], Any], tokenize: Callable[[list[str]], Any],
                device: str = "cpu", scale: float = 100.0) -> "ImageTextScorer":
        """A model with encode_image() and encode_text(), as open_clip and OpenAI's CLIP have them.

        preprocess: a PIL image to a tensor [3, h, w]. tokenize: texts to a tensor of tokens.
        """
        model = model.to(device).eval()

        def encode(method: Callable[[Any], Any], batch: Any) -> NDArray[np.float64]:
            import torch

            with torch.inference_mode():
                return method(batch.to(device)).float().cpu().numpy()

        def encode_images(images: list[NDArray[np.uint8]]) -> NDArray[np.float64]:
            import torch
            from PIL import Image

            batch = torch.stack([preprocess(Image.fromarray(np.ascontiguousarray(image))) for image in images])
            return encode(model.encode_image, batch)

        return ImageTextScorer(encode_images, lambda texts: encode(model.encode_text, tokenize(texts)), scale)

    def cosines(self, images: Sequence[NDArray[np.uint8]], texts: Sequence[str]) -> NDArray[np.float64]:
        """[images, texts], in [-1, 1]."""
        unknown = [text for text in dict.fromkeys(texts) if text not in self._known]
        if unknown:
            self._known.update(zip(unknown, _unit(self._encode_texts(unknown), len(unknown), "encode_texts")))
        if not images:
            return np.zeros((0, len(texts)))
        return _unit(self._encode_images(list(images)), len(images), "encode_images") @ \
            np.stack([self._known[text] for text in texts]).T

    def score(self, rgb: NDArray[np.uint8], texts: Sequence[str]) -> NDArray[np.float64]:
        """[texts]: cosines of one image."""
        return self.cosines([rgb], texts)[0]

    def probabilities(self, images: Sequence[NDArray[np.uint8]], texts: Sequence[str]) -> NDArray[np.float64]:
        """[images, texts]: which of the texts each image fits; rows add up to 1."""
        scaled = self.scale * self.cosines(images, texts)
        weights = np.exp(scaled - scaled.max(axis=1, keepdims=True))
        return weights / weights.sum(axis=1, keepdims=True)


def _unit(embeddings: ArrayLike, count: int, name: str) -> NDArray[np.float64]:
    rows = np.asarray(embeddings, np.float64)
    if rows.ndim != 2 or len(rows) != count:
        raise ValueError(f"{name}: expected an array [{count}, d], found one of the shape {rows.shape}")
    return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)


class ImageTextDetector:
    """Boxes of another detector, named by an image-text model with the goals of the spec.

        class MyDetector(ImageTextDetector):
            def __init__(self, goals):
                super().__init__(goals, my_boxes, my_scorer)
    """

    def __init__(self, goals: Sequence[str], boxes: BoxSource, scorer: ImageTextScorer, score_threshold: float = 0.5,
                 prompt: str = "a photo of a {}",
                 others: Sequence[str] = ("a photo of a wall", "a photo of the floor", "a photo of something else"),
                 margin: float = 0.1, least_side_px: float = 8.0) -> None:
        """boxes: whose boxes are cut out, grown by the share `margin` on all sides; those with a shorter side than
        least_side_px are left out. others: what a box may show instead of a goal. A score is the probability of the
        goal among goals and others; lower ones than score_threshold are not told."""
        self.class_names = list(goals)
        self._texts = [prompt.format(goal) for goal in goals] + list(others)
        self._boxes, self._scorer = boxes, scorer
        self._score_threshold, self._margin, self._least_side_px = score_threshold, margin, least_side_px

    def detect(self, seen: Observation) -> list[Detection]:
        """What of the boxes is a goal."""
        if seen.rgb is None:
            return []
        crops, found = [], []
        for detection in self._boxes.detect(seen):
            crop = self._crop(seen.rgb, detection.box_px)
            if crop is not None:
                crops.append(crop)
                found.append(detection)
        if not crops:
            return []
        named = []
        for detection, row in zip(found, self._scorer.probabilities(crops, self._texts)[:, :len(self.class_names)]):
            best = int(row.argmax())
            if row[best] >= self._score_threshold:
                named.append(Detection(best, float(row[best]), detection.box_px))
        return named

    def _crop(self, rgb: NDArray[np.uint8], box_px: Sequence[float]) -> NDArray[np.uint8] | None:
        x0, y0, x1, y1 = box_px
        if min(x1 - x0, y1 - y0) < self._least_side_px:
            return None
        grow_x, grow_y = self._margin * (x1 - x0), self._margin * (y1 - y0)
        columns = slice(max(0, int(x0 - grow_x)), max(0, int(np.ceil(x1 + grow_x))))
        rows = slice(max(0, int(y0 - grow_y)), max(0, int(np.ceil(y1 + grow_y))))
        crop = rgb[rows, columns]
        return crop if crop.size else None
