#!/usr/bin/env python3
"""A policy in Python, in a process of its own: needs NumPy alone, and shows the whole protocol.

    policy: {type: process, command: [python3, examples/peer_policy.py]}

It drives towards the goal when the detector sees it, stops in front of it, and turns away from what stands in its way.
docs/connect.md lists the fields of the messages.
"""
import json
import os
import struct
import sys

import numpy as np

answers = os.fdopen(os.dup(1), "wb", buffering=0)
os.dup2(2, 1)  # What is printed goes to standard error, and cannot be taken for an answer.


def say(**answer):
    text = json.dumps(answer).encode()
    answers.write(struct.pack("<I", len(text)) + text)


def decide(seen, goal):
    """The velocity for what the robot sees, or that it is there."""
    depth = seen["images"]["depth_m"]
    shared = np.memmap(seen["images"]["file"], np.uint8, mode="r")  # Of this decision alone.
    depth_m = shared[depth["offset"]:].view(np.float32)[:np.prod(depth["shape"])].reshape(depth["shape"])
    height, width = depth_m.shape
    band_m = depth_m[height // 3:2 * height // 3, width // 3:2 * width // 3]
    ahead_m = np.nanpercentile(band_m, 5) if np.isfinite(band_m).any() else 10.0
    for found in seen["detections"]:
        if found["class_index"] == goal["class_index"]:
            x_px = (found["box_px"][0] + found["box_px"][2]) / 2
            left_rad = np.arctan((seen["intrinsics"]["cx_px"] - x_px) / seen["intrinsics"]["fx_px"])
            if abs(left_rad) < 0.2 and ahead_m < 1.0:
                return {"stop": "goal_reached"}
            return {"forward_mps": 0.4 if abs(left_rad) < 0.2 else 0.0, "turn_radps": float(left_rad), "mode": "navigate"}
    return {"forward_mps": 0.6} if ahead_m > 1.2 else {"turn_radps": 0.6}


while header := sys.stdin.buffer.read(4):
    message = json.loads(sys.stdin.buffer.read(struct.unpack("<I", header)[0]))
    if message["type"] == "hello":
        say(type="ready")
    elif message["type"] == "reset":
        goal = message["goal"]
        say(type="ok")
    else:
        say(type="decision", **decide(message, goal))
