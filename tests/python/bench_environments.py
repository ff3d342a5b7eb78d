#!/usr/bin/env python3
"""Steps a second of environments: of C++ alone, and through Python.

  bench_environments.py TINY_TRIAL [--steps 60] [--rounds 5] [--threads 0] [--folder FOLDER]

TINY_TRIAL is the program of tests/python/tiny_trial.cpp. Both step the same eight environments of its scene with the
same actions, in turns; the best round of each counts, because other programs only make rounds slower. What Python
takes is compared by the time of processors, which other programs disturb least. The package must be on the path of
Python. FOLDER keeps the scene; without it the scene is made anew.
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


def python_s(environment: ObjectNavVectorEnv, steps: int) -> tuple[float, float]:
    """Seconds for the steps: by the clock, and of processors."""
    environment.reset(seed=0)
    i = np.arange(COUNT)
    actions = [1 + (k + i) * (k % 5 + 1) % 3 for k in range(steps)]
    start_s, cpu_start_s = time.perf_counter(), time.process_time()
    for chosen in actions:
        environment.step(chosen)
    return time.perf_counter() - start_s, time.process_time() - cpu_start_s


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
                alone.append(tuple(map(float, ran.stdout.split())))
                through.append(python_s(environment, arguments.steps))
            steps = COUNT * arguments.steps
            (alone_s, alone_cpu_s), (through_s, through_cpu_s) = (np.min(times, axis=0) for times in (alone, through))
            print(f"{width} x {height}: "
                  f"C++ {steps / alone_s:.0f} ({alone_cpu_s / steps * 1e3:.2f} ms of a processor each), "
                  f"Python {steps / through_s:.0f} ({through_cpu_s / steps * 1e3:.2f} ms, "
                  f"{through_cpu_s / alone_cpu_s - 1:+.1%})", flush=True)


if __name__ == "__main__":
    main()
