"""The rasterizers of C++, each for one view at a time, which keep their memory from call to call."""

import atexit
import threading
import weakref
from typing import Any

import torch

from fastsegsim import InputError, _rasterizer

#: Whether the package was built with CUDA.
HAS_CUDA: bool = _rasterizer.has_cuda
#: What is nearer to the camera than this, along its z in metres, is not drawn.
NEAR_M: float = _rasterizer.near_m

#: Views of a call that keep what their backward pass needs; that of the others is made anew when it comes.
MOST_KEPT = 8
_MOST_IDLE = MOST_KEPT + 1  # Of a kind.
# No lock: each step is a single one of a dict or a list, and collecting garbage, at any time, may hand back.
_idle: dict[tuple[Any, ...], list[Any]] = {}
_used: weakref.WeakSet["Rasterizers"] = weakref.WeakSet()


def release_memory() -> None:
    """Give back the memory that rasterizers keep for the next call: the more, the more surfels and pixels."""
    while _idle:
        _idle.popitem()


@atexit.register
def _end() -> None:
    # What autograd still keeps is not destroyed at the end of a program: memory of a GPU would outlive CUDA.
    for rasterizers in tuple(_used):
        rasterizers.end()
    release_memory()


def _made(kind: tuple[Any, ...]) -> Any:
    if kind[0] == "cuda":
        return _rasterizer.CudaRasterizer(kind[2], kind[3])
    return (_rasterizer.CpuRasterizer32 if kind[1] == torch.float32 else _rasterizer.CpuRasterizer64)(kind[2])


class Rasterizers:
    """Those of one call; they are handed back when the call, or what autograd keeps of it, is gone."""

    def __init__(self, cameras: Any, like: torch.Tensor, threads: int, deterministic: bool) -> None:
        """like: a tensor of the type and at the place of all others."""
        self.cameras = cameras
        self.redrawing = threading.Lock()  # While the rasterizer MOST_KEPT draws and differentiates a view.
        self._held: list[Any] = []
        if like.device.type == "cuda":
            if not HAS_CUDA:
                raise InputError("positions_m: expected a tensor of the CPU, as this fastsegsim was built without "
                                 "CUDA (docs/python_training.md), found one of a GPU")
            if like.dtype != torch.float32:
                raise InputError(f"positions_m: expected float32 on a GPU, found {like.dtype}")
            stream = torch.cuda.current_stream(like.device).cuda_stream
            self._kind: tuple[Any, ...] = ("cuda", like.device.index, stream, deterministic)
        elif like.device.type == "cpu":
            self._kind = ("cpu", like.dtype, threads)
        else:
            raise InputError(f"positions_m: expected a tensor of the CPU or of a CUDA GPU, found {like.device}")
        _used.add(self)

    def numbered(self, number: int) -> Any:
        """The rasterizer with this number; it is the same in every call."""
        while len(self._held) <= number:
            try:
                self._held.append(_idle[self._kind].pop())
            except LookupError:
                self._held.append(_made(self._kind))
        return self._held[number]

    def end(self) -> None:
        """Nothing is drawn or differentiated any more."""
        self._held, self.cameras = [], None

    def __del__(self) -> None:
        if getattr(self, "_held", None):
            idle = _idle.setdefault(self._kind, [])
            idle.extend(self._held[:max(0, _MOST_IDLE - len(idle))])
