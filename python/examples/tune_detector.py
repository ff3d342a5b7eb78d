#!/usr/bin/env python3
"""Fine-tunes a network of torchvision with the labels of a scene, and says how well it finds objects before and after.

  tune_detector.py TRAIN VALIDATION [--weights FILE] [--network MODULE:FUNCTION] [--steps 200] [--out FILE]

TRAIN and VALIDATION are what `segsim label` writes (train.json, val_views.json). FUNCTION makes the network from the
number of labels, 0 being the background: by default a Faster R-CNN on MobileNet. Prints AP50, and writes the weights.
"""

import argparse
import dataclasses
import importlib

import numpy as np
import torch
from PIL import Image

from fastsegsim.adapters import TorchvisionDetector
from fastsegsim.labels import Views, average_precision, load_views


def picture(view) -> np.ndarray:
    return np.array(Image.open(view.file).convert("RGB"))


def example(view) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    image, chosen = torch.from_numpy(picture(view)).permute(2, 0, 1).float() / 255.0, view.objects()
    return image, {"boxes": torch.from_numpy(view.boxes[chosen]), "labels": torch.from_numpy(view.classes[chosen] + 1)}


def evaluate(network: torch.nn.Module, views: Views, name: str) -> float:
    detector = TorchvisionDetector(network, ["__background__", *views.class_names], score_threshold=0.0)
    found = [detector.find(picture(view)) for view in views]
    precision = average_precision(
        views, [[dataclasses.replace(d, class_index=d.class_index - 1) for d in of_view] for of_view in found])
    by_class = ", ".join(f"{label} {ap50:.3f}" for label, ap50 in precision.ap50_of.items())
    print(f"{name}: AP50 {precision.ap50:.3f} ({by_class})", flush=True)
    return precision.ap50


def tune(network: torch.nn.Module, views: Views, steps: int, rate: float) -> None:
    examples, random = [example(view) for view in views if len(view.objects())], np.random.default_rng(1)
    optimizer = torch.optim.SGD([p for p in network.parameters() if p.requires_grad], rate, momentum=0.9)
    network.train()
    for step in range(steps):
        chosen = random.choice(len(examples), min(4, len(examples)), replace=False)
        images, targets = zip(*(examples[k] for k in chosen))
        loss = sum(network(list(images), list(targets)).values())
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if step % 20 == 0:
            print(f"step {step}: loss {loss.item():.3f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("train")
    parser.add_argument("validation")
    parser.add_argument("--weights")
    parser.add_argument("--network", default="torchvision.models.detection:fasterrcnn_mobilenet_v3_large_320_fpn")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--rate", type=float, default=0.005)
    parser.add_argument("--out", default="tuned.pt")
    arguments = parser.parse_args()
    torch.manual_seed(1)
    train, validation = load_views(arguments.train), load_views(arguments.validation)
    module, _, function = arguments.network.partition(":")
    make = getattr(importlib.import_module(module), function)
    own = {"weights": None, "weights_backbone": None} if module.startswith("torchvision.") else {}
    network = make(num_classes=len(train.class_names) + 1, **own)
    if arguments.weights:
        network.load_state_dict(torch.load(arguments.weights, weights_only=True))
    before = evaluate(network, validation, "before")
    tune(network, train, arguments.steps, arguments.rate)
    print(f"gain: {evaluate(network, validation, 'after') - before:+.3f}")
    torch.save(network.state_dict(), arguments.out)


if __name__ == "__main__":
    main()
