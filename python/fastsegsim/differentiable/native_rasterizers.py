"""The rasterizers of C++, each for one view at a time, which keep their memory from call to call."""

import threading
from typing import Any

import torch

from fastsegsim import InputError, _rasterizer

#: Whether the package was built with CUDA.
HAS_CUDA: bool = _rasterizer.has_cuda
#: What is nearer to the camera than this, along its z in metres, is not drawn.
NEAR_M: float = _rasterizer.near_m

_MOST_IDLE = 8  # Of a kind: a batch of that many views asks for no memory.
_idle: dict[tuple[Any, ...], list[Any]] = {}
_lock = threading.Lock()


def release_memory() -> None:
    """Give back the memory that rasterizers keep for the next call: the more, the more surfels and pixels."""
    with _lock:
        idle = [rasterizer for rasterizers in _idle.values() for rasterizer in rasterizers]
        _idle.clear()
    del idle


def _made(kind: tuple[Any, ...]) -> Any:
    if kind[0] == "cuda":
        return _rasterizer.CudaRasterizer(kind[2], kind[3])
    return (_rasterizer.CpuRasterizer32 if kind[1] == torch.float32 else _rasterizer.CpuRasterizer64)(kind[2])


class Rasterizers:
    """Those of one call; they are handed back when the call, or what autograd keeps of it, is gone."""

    def __init__(self, like: torch.Tensor, threads: int, deterministic: bool) -> None:
        """like: a tensor of the type and at the place of all others."""
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
        self._held: list[Any] = []

    def of_view(self, view: int) -> Any:
        """The rasterizer with this number; it is the same in every call."""
        while len(self._held) <= view:
            with _lock:
                idle = _idle.get(self._kind)
                rasterizer = idle.pop() if idle else None
            self._held.append(_made(self._kind) if rasterizer is None else rasterizer)
        return self._held[view]

    def __del__(self) -> None:
        held = getattr(self, "_held", None)
        if not held:
            return
        with _lock:
            idle = _idle.setdefault(self._kind, [])
            idle.extend(held[:_MOST_IDLE - len(idle)])
