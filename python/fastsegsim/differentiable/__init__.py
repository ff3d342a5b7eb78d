"""Surfels that PyTorch can train: images of them, and the derivatives of losses by everything that a surfel has.

    from fastsegsim.differentiable import rasterize

    images = rasterize(positions_m, log_scales, rotations, opacity_logits, sh, T_world_camera, K, (640, 480))
    (images.rgb - photograph).abs().mean().backward()

docs/python_training.md tells the rest; who comes from gsplat finds its rasterization_2dgs here.
"""

import importlib.util

if importlib.util.find_spec("torch") is None:
    raise ImportError("fastsegsim.differentiable needs PyTorch: pip install torch", name="torch")

from fastsegsim.differentiable.depth_normals import depth_normals
from fastsegsim.differentiable.gsplat_interface import rasterization_2dgs
from fastsegsim.differentiable.native_rasterizers import HAS_CUDA, NEAR_M, release_memory
from fastsegsim.differentiable.rasterize import SurfelImages, rasterize

__all__ = ["HAS_CUDA", "NEAR_M", "SurfelImages", "depth_normals", "rasterization_2dgs", "rasterize", "release_memory"]
