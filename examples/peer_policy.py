#!/usr/bin/env python3
"""A policy in Python, in a process of its own: needs nothing but Python, and shows the whole protocol.

    policy: {type: process, command: [python3, examples/peer_policy.py]}

It looks around, drives towards the goal when the detector sees it, stops in front of it, and turns away from whatever
stands in its way, by an angle of chance.
docs/connect.md lists the fields of the messages. With NumPy, `policy: python:MODULE:CLASS` is shorter.
"""
import json
import math
import mmap
import os
import random
import struct
import sys

answers = os.fdopen(os.dup(1), "wb", buffering=0)
os.dup2(2, 1)  # What is printed goes to standard error, and cannot be taken for an answer.


def say(**answer):
    text = json.dumps(answer).encode()
    answers.write(struct.pack("<I", len(text)) + text)


def free_ahead_m(images):
    """The nearest depth in the middle of the image."""
    height, width = images["depth_m"]["shape"]
    with open(images["file"], "rb") as file:
        shared = mmap.mmap(file.fileno(), images["bytes"], prot=mmap.PROT_READ)
    depth_m = memoryview(shared)[images["depth_m"]["offset"]:][:4 * width * height].cast("f")
    middle_m = [depth_m[y * width + x] for y in range(height // 3, 2 * height // 3, 2)
                for x in range(width // 3, 2 * width // 3, 2)]
    return min((d for d in middle_m if not math.isnan(d)), default=10.0)


def decide(seen, episode):
    """The velocity for what the robot sees, or that it is there."""
    ahead_m = free_ahead_m(seen["images"])
    for found in seen["detections"]:
        if found["class_index"] == episode["goal"]["class_index"]:
            x_px = (found["box_px"][0] + found["box_px"][2]) / 2
            left_rad = math.atan((seen["intrinsics"]["cx_px"] - x_px) / seen["intrinsics"]["fx_px"])
            if abs(left_rad) < 0.2 and ahead_m < 1.0:
                return {"stop": "goal_reached"}
            return {"forward_mps": 0.4 if abs(left_rad) < 0.2 else 0.0, "turn_radps": left_rad, "mode": "navigate"}
    now_s = seen["time_ns"] * 1e-9
    if now_s > episode["turn_until_s"] and ahead_m < 1.2:
        episode["turn_until_s"] = now_s + episode["random"].uniform(0.5, 4.0)
    return {"turn_radps": 0.8} if now_s < episode["turn_until_s"] else {"forward_mps": 0.6}


while header := sys.stdin.buffer.read(4):
    message = json.loads(sys.stdin.buffer.read(struct.unpack("<I", header)[0]))
    if message["type"] == "hello":
        say(type="ready")
    elif message["type"] == "reset":
        # It looks around first.
        episode = {"goal": message["goal"], "random": random.Random(message["seed"]), "turn_until_s": 8.0}
        say(type="ok")
    else:
        say(type="decision", **decide(message, episode))
