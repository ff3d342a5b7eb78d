"""Reads what `segsim render --single-part` writes: scan lines in blocks of 16, compressed as ZIP."""

import pathlib
import struct
import zlib

import numpy as np

TYPES = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}


def read_exr(file: pathlib.Path) -> dict[str, np.ndarray]:
    """Channel -> [H, W], as it is stored."""
    data = file.read_bytes()
    magic, version = struct.unpack_from("<II", data)
    assert magic == 20000630 and version & 0x1A00 == 0, "expected an OpenEXR file of one part with scan lines"
    at, header = 8, {}
    while data[at]:
        name, at = _text(data, at)
        _, at = _text(data, at)
        size = struct.unpack_from("<i", data, at)[0]
        header[name], at = data[at + 4:at + 4 + size], at + 4 + size
    assert header["compression"] == b"\x03", "expected ZIP"
    left, top, right, bottom = struct.unpack("<4i", header["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    channels = _channels(header["channels"])
    images = {name: np.empty((height, width), kind) for name, kind in channels}
    offsets = struct.unpack_from(f"<{-(-height // 16)}Q", data, at + 1)
    for offset in offsets:
        row, size = struct.unpack_from("<ii", data, offset)
        rows = min(16, height - (row - top))
        length = rows * width * sum(kind.itemsize for _, kind in channels)
        block = data[offset + 8:offset + 8 + size]
        pixels = _inflated(block) if size < length else block
        begin = 0
        for line in range(row - top, row - top + rows):
            for name, kind in channels:  # In a line the channels follow one another.
                images[name][line] = np.frombuffer(pixels, kind, width, begin)
                begin += width * kind.itemsize
    return images


def _text(data: bytes, at: int) -> tuple[str, int]:
    end = data.index(b"\0", at)
    return data[at:end].decode(), end + 1


def _channels(data: bytes) -> list[tuple[str, np.dtype]]:
    at, channels = 0, []
    while data[at]:
        name, at = _text(data, at)
        channels.append((name, TYPES[struct.unpack_from("<i", data, at)[0]]))
        at += 16
    return channels


def _inflated(block: bytes) -> bytes:
    """ZIP stores differences of bytes, first those at even places, then those at odd ones."""
    stored = np.frombuffer(zlib.decompress(block), np.uint8).astype(np.int64)
    stored[1:] -= 128
    stored = np.cumsum(stored).astype(np.uint8)
    half = -(-len(stored) // 2)
    pixels = np.empty_like(stored)
    pixels[0::2], pixels[1::2] = stored[:half], stored[half:]
    return pixels.tobytes()
