#!/usr/bin/env python3
"""Tests of tools/centernet_to_onnx.py: kernels are turned, weights are counted, other files are refused."""
import json
import pathlib
import struct
import subprocess
import sys
import tempfile
import unittest

TOOLS = pathlib.Path(__file__).resolve().parents[2] / "tools"
sys.path.insert(0, str(TOOLS))

import centernet_to_onnx as tool  # noqa: E402


class Converter(unittest.TestCase):
    def test_kernels_are_turned(self):
        shape = [2, 1, 3, 2]  # Height, width, in, out; the value tells where it was.
        values = [100 * y + 10 * i + o for y in range(2) for i in range(3) for o in range(2)]
        turned, flat = tool.kernel(shape, values, False)
        self.assertEqual(turned, [2, 3, 2, 1])
        self.assertEqual(flat, [100 * y + 10 * i + o for o in range(2) for i in range(3) for y in range(2)])

    def test_depthwise_kernels_are_turned(self):
        values = [10 * y + c for y in range(2) for c in range(3)]
        turned, flat = tool.kernel([2, 1, 3, 1], values, True)
        self.assertEqual(turned, [3, 1, 2, 1])
        self.assertEqual(flat, [10 * y + c for c in range(3) for y in range(2)])

    def test_weights_are_counted(self):
        manifest = [{"name": "a", "shape": [2], "dtype": "float32", "quantization": {"dtype": "float16"}},
                    {"name": "b", "shape": [], "dtype": "int32"}]
        content = struct.pack("<2ei", 0.5, -2.0, 7)
        self.assertEqual(tool.read_weights(manifest, content), {"a": ([2], (0.5, -2.0)), "b": ([], (7,))})
        for wrong in (content[:-1], content + b"x"):
            with self.assertRaises(tool.Refused):
                tool.read_weights(manifest, wrong)

    def test_numbers_of_a_message(self):
        self.assertEqual(tool.varint(300), b"\xac\x02")
        self.assertEqual(tool.field(4, "Conv"), b"\x22\x04Conv")

    def test_another_file_is_refused(self):
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "centernet.json"
            file.write_text(json.dumps({"weightsManifest": [], "modelTopology": {"node": []}}))
            file.with_suffix(".bin").write_bytes(b"")
            out = pathlib.Path(folder) / "x.onnx"
            run = [sys.executable, str(TOOLS / "centernet_to_onnx.py"), str(file), "--out", str(out)]
            for flags, words in (([], "SHA-256"), (["--any-file"], "tower_0"), (["--side", "100"], "--side")):
                done = subprocess.run(run + flags, capture_output=True, text=True)
                self.assertEqual(done.returncode, 2)
                self.assertIn(words, done.stderr)
                self.assertEqual(done.stderr.count("\n"), 1)
            self.assertFalse(out.exists())


if __name__ == "__main__":
    unittest.main()
