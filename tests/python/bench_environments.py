#!/usr/bin/env python3
"""Steps a second of environments: of C++ alone, and through Python.

  bench_environments.py TINY_TRIAL [--steps 60] [--rounds 5] [--threads 0] [--folder FOLDER]

TINY_TRIAL is the program of tests/python/tiny_trial.cpp. Both step the same eight environments of its scene with the
same actions, in turns; the best round of each counts, because other programs only make rounds slower. The package must
be on the path of Python. FOLDER keeps the scene; without it the scene is made anew.
"""

import argparse
import os
import pathlib
import subprocess
import tempfile
import time

import numpy as np

from fastsegsim.environments import ObjectNavVectorEnv

COUNT = 8
SIZES = ((128, 128), (256, 192))


def python_s(environment: ObjectNavVectorEnv, steps: int) -> float:
    """Seconds for the steps."""
    environment.reset(seed=0)
    i = np.arange(COUNT)
    actions = [1 + (k + i) * (k % 5 + 1) % 3 for k in range(steps)]
    start_s = time.perf_counter()
    for chosen in actions:
        environment.step(chosen)
    return time.perf_counter() - start_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--folder", type=pathlib.Path)
    arguments = parser.parse_args()
    threads = arguments.threads or len(os.sched_getaffinity(0))

    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or pathlib.Path(temporary)
        if not (folder / "episodes.jsonl").exists():
            subprocess.run([arguments.program, "scene", folder], check=True, stderr=subprocess.DEVNULL)
        print(f"{COUNT} environments, {threads} threads, steps a second of all together")
        for width, height in SIZES:
            environment = ObjectNavVectorEnv(folder / "bundle", folder / "episodes.jsonl", num_envs=COUNT,
                                             size=(width, height), threads=threads)
            command = [arguments.program, "bench", folder, COUNT, width, height, arguments.steps, threads]
            alone, through = [], []
            for _ in range(arguments.rounds):
                ran = subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True)
                alone.append(float(ran.stdout))
                through.append(python_s(environment, arguments.steps))
            steps = COUNT * arguments.steps
            print(f"{width} x {height}: C++ {steps / min(alone):.0f}, Python {steps / min(through):.0f}, "
                  f"Python takes {min(through) / min(alone) - 1:+.1%}")


if __name__ == "__main__":
    main()
