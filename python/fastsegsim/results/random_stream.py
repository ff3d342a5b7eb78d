"""The random numbers of core/random.h (Philox4x32-10, Salmon et al. 2011), many at a time."""

import numpy as np
from numpy.typing import NDArray

_MASK32 = np.uint64(0xFFFFFFFF)
_MASK64 = 0xFFFFFFFFFFFFFFFF


def hash64(text: str, seed: int = 0) -> int:
    """64-bit FNV-1a."""
    value = 0xCBF29CE484222325 ^ (seed * 0x9E3779B97F4A7C15 & _MASK64)
    for byte in text.encode():
        value = (value ^ byte) * 0x100000001B3 & _MASK64
    return value


def _philox(counters: NDArray[np.uint64], key: int) -> NDArray[np.uint64]:
    """One block of four words for each counter. counters: [blocks, 4], words of 32 bits."""
    c0, c1, c2, c3 = counters.T
    key0, key1 = key & 0xFFFFFFFF, key >> 32
    shift = np.uint64(32)
    for _ in range(10):
        a, b = np.uint64(0xD2511F53) * c0, np.uint64(0xCD9E8D57) * c2
        c0, c1, c2, c3 = ((b >> shift) ^ c1 ^ np.uint64(key0), b & _MASK32,
                          (a >> shift) ^ c3 ^ np.uint64(key1), a & _MASK32)
        key0, key1 = (key0 + 0x9E3779B9) & 0xFFFFFFFF, (key1 + 0xBB67AE85) & 0xFFFFFFFF
    return np.stack([c0, c1, c2, c3], axis=1)


def random_indices(seed: int, name: str, count: int, below: int) -> NDArray[np.int64]:
    """The first `count` numbers that RandomStream(seed, name).index(below) gives: 0 to below - 1."""
    blocks = -(-count // 4)
    counters = np.zeros((blocks, 4), np.uint64)
    counters[:, 0] = np.arange(blocks, dtype=np.uint64) & _MASK32
    counters[:, 1] = np.arange(blocks, dtype=np.uint64) >> np.uint64(32)
    words = _philox(counters, hash64(name, seed)).reshape(-1)[:count]
    return ((words * np.uint64(below)) >> np.uint64(32)).astype(np.int64)
