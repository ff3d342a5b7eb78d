"""Fast-SegSim in Python: surfel scenes rendered with depth, normals and labels; gradients; environments; results.

    scene = fastsegsim.Scene.load("out/flat/scene")
    renderer = fastsegsim.Renderer(scene)
    images = renderer.render(fastsegsim.look_at((0, 0, 1.2), (1, 0, 1)), fastsegsim.pinhole((640, 480), 1.2),
                             (640, 480), ("rgb", "depth", "semantic"))

Frames, units and shapes stand with each function; docs/python.md tells the rest.
"""

import importlib
from typing import Any

from fastsegsim._native import (InputError, Recording, Renderer, Scene, SceneClass, SceneInstance, look_at, mast_camera,
                                pinhole, read_frame)
from fastsegsim._native import build as _build

__all__ = ["InputError", "Recording", "Renderer", "Scene", "SceneClass", "SceneInstance", "look_at", "mast_camera",
           "pinhole", "read_frame", "results"]
InputError.__module__ = "fastsegsim"  # Where users catch it.
__version__ = _build.partition(" ")[0]


def __getattr__(name: str) -> Any:
    # Databases, statistics, environments and gradients are loaded by who uses them: `import fastsegsim` stays quick.
    if name in ("differentiable", "environments", "results"):
        return importlib.import_module(f"fastsegsim.{name}")
    raise AttributeError(f"module 'fastsegsim' has no attribute '{name}'")
