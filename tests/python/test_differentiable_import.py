"""What importing gradients asks for, and what it says where PyTorch is missing."""

import ast
import pathlib
import subprocess
import sys

import pytest

import fastsegsim

PACKAGE = pathlib.Path(fastsegsim.__file__).parent


def said_by(code: str) -> str:
    """What Python prints."""
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout


def test_the_package_alone_needs_no_pytorch():
    hidden = ("import importlib.util, sys\nfind = importlib.util.find_spec\n"
              "importlib.util.find_spec = lambda name, *more: None if name == 'torch' else find(name, *more)\n")
    printed = said_by(hidden + "import fastsegsim; print(fastsegsim.Scene)\n"
                      "try:\n  fastsegsim.differentiable\nexcept ImportError as error:\n  print(error)")
    assert "fastsegsim.differentiable needs PyTorch: pip install torch" in printed
    loaded = said_by("import sys, fastsegsim; print('torch' in sys.modules, 'fastsegsim._rasterizer' in sys.modules)")
    assert loaded == "False False\n"


def test_the_rasterizer_is_linked_without_pytorch():
    """So that one build serves every version of it."""
    loaded = said_by("import fastsegsim._rasterizer; print(open('/proc/self/maps').read())")
    assert "_rasterizer" in loaded and "libtbb" in loaded
    assert not [line for line in loaded.splitlines() if "libtorch" in line or "libc10" in line]
    stubs = ast.parse((PACKAGE / "_rasterizer.pyi").read_text())
    assert {"Cameras", "CpuRasterizer32", "CpuRasterizer64"} <= {getattr(node, "name", "") for node in stubs.body}


def test_every_name_is_documented():
    pytest.importorskip("torch", reason="PyTorch is not installed")
    from fastsegsim import differentiable
    for name in differentiable.__all__:
        documented = getattr(differentiable, name)
        assert not callable(documented) or documented.__doc__, name
    with pytest.raises(AttributeError, match="has no attribute 'gradients'"):
        fastsegsim.gradients
