#!/usr/bin/env python3
"""Holds `segsim` to what it promises about inputs, whatever they are.

    contract_fuzzer.py SEGSIM OUT [--count N] [--seed S] [--jobs J] [--results PROGRAM]

Every execution damages one file of a set of seeds (which the program itself makes), or gives a flag an odd value. The
promise: exit code 0, 1 or 2, never a signal and never 3; less than 20 s of processor time and 2 GB; and with exit code
2 one line that begins with "segsim". What breaks it is kept in OUT/failures: the command and its input. --results is
the program of the tests that writes a small results database; without it commands about results are left out.

Exit code 0: no failure, 1: some, 2: the seeds could not be made. An execution is decided by --seed and its number.
"""

import argparse
import concurrent.futures
import hashlib
import os
import random
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

MOST_S, MOST_BYTES = 20.0, 2 * 1024**3  # Seconds of processors: others may be at work.
MOST_WALL_S = 120.0
ODD_VALUES = ["nan", "inf", "-inf", "-1", "0", "1", "1e308", "-1e-300", "", " ", "~", "true", "0x10", "1,2", "a/../b",
              "999999999999999999999", "-9223372036854775808", "4294967296", "/dev/null", "/dev/zero", "/", "..",
              "\u00e9\u4e16", "x" * 300, "%s%n", "$(id)", "--help", "1 2 3"]
ODD_NUMBERS = [b"nan", b"1e308", b"-1", b"0", b"99999999999999999999", b"1e-320", b"-2147483649", b"4294967296", b"",
               b"true", b"null", b"0x7f", b"1.5"]


class Seeds:
    """Small inputs of every kind, made once."""

    def __init__(self, segsim, folder, results):
        self.segsim, self.folder = segsim, folder
        folder.mkdir(parents=True, exist_ok=True)
        self.make("capture", "--flat", "3", "--frames", "40", "--width", "128", "--height", "96", "--out", "rec")
        self.make("reconstruct", "rec", "--init-only", "--voxel", "0.1", "--out", "bundle")
        self.make("masks", "simulate", "rec", "--out", "masks")
        self.make("label", "bundle", "--views", "3", "--width", "64", "--height", "48", "--out", "labels",
                  "--classes", "couch", "bed", "chair")
        self.make("episodes", "generate", "bundle", "-o", "episodes.jsonl", "--count", "2", "--seed", "1")
        (folder / "poses.txt").write_text("1.5 1.5 1.2 0 0\n2.0 1.5 1.2 1.57 0.1\n")
        (folder / "cube.obj").write_text(
            "mtllib cube.mtl\nusemtl red\n"
            + "".join(f"v {x} {y} {z}\n" for x in (0, 4) for y in (0, 4) for z in (0, 3))
            + "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\n")
        (folder / "cube.mtl").write_text("newmtl red\nKd 0.8 0.1 0.1\n")
        (folder / "room.world").write_text(
            '<?xml version="1.0"?>\n<sdf version="1.6"><world name="w"><include><uri>model://sun</uri></include>\n'
            '<model name="Chair_01"><static>true</static><pose>1 1 0.4 0 0 0</pose><link name="l"><visual name="v">\n'
            '<geometry><box><size>0.5 0.5 0.8</size></box></geometry></visual></link></model>\n'
            '<model name="floor"><static>true</static><link name="l"><visual name="v"><geometry><box>'
            '<size>6 6 0.02</size></box></geometry></visual></link></model></world></sdf>\n')
        root = Path(__file__).resolve().parents[2]
        for name, source in (("budget.yaml", "budgets/example-edge.yaml"), ("trial.yaml", "trials/drive.yaml"),
                             ("suite.yaml", "suites/homes-v1.yaml")):
            shutil.copy(root / "experiments" / source, folder / name)
        (folder / "robot.yaml").write_text("")
        shutil.copy(root / "perception/weights/source_rooms.weights", folder / "small.weights")
        if results:
            subprocess.run([results, folder / "results.sqlite"], check=True)

    def make(self, *arguments):
        if (self.folder / arguments[-1]).exists():
            return
        done = subprocess.run([self.segsim, *arguments], cwd=self.folder, capture_output=True, text=True)
        if done.returncode != 0:
            print(f"contract_fuzzer.py: segsim {shlex.join(arguments)}: expected exit code 0, found {done.returncode}: "
                  f"{done.stderr.strip()}", file=sys.stderr)
            sys.exit(2)


# A command, what of the seeds it is given a copy of, and which file of that is damaged ("" = the copy itself).
COMMANDS = [
    ("scene inspect {copy}", "bundle", None),
    ("episodes generate {copy} -o e.jsonl --count 2 --seed 1", "bundle", None),
    ("scene coverage {copy} --spacing 1.5", "bundle", None),
    ("label {copy} --views 2 --width 48 --height 36 --out l", "bundle", None),
    ("render {copy} --pose 1.5 1.5 1.2 0 0 --size 64x48 --out v.exr", "bundle", "surfels.ply"),
    ("render {copy} --pose 1.5 1.5 1.2 0 0 --size 64x48 --out v.exr", "bundle", "scene.yaml"),
    ("scene inspect {copy}", "bundle", "navmesh.bin"),
    ("episodes validate {copy} {seeds}/bundle", "episodes.jsonl", ""),
    ("reconstruct --check {copy} --check-picture p.png", "rec", None),
    ("reconstruct {copy} --init-only --voxel 0.1 --out b", "rec", None),
    ("masks measure {copy} --truth {seeds}/rec", "masks", None),
    ("evaluate --predictions {copy} --truth {seeds}/masks", "masks", None),
    ("detector evaluate --weights {seeds}/small.weights --on {copy}/labels.json", "labels", None),
    ("detector lineage {copy}", "small.weights", ""),
    ("detector finetune --from {copy} --train {seeds}/labels/labels.json --steps 1 --out a.weights", "small.weights",
     ""),
    ("capture --flat 3 --trajectory {copy} --frames 2 --width 32 --height 24 --out c", "poses.txt", ""),
    ("capture --mesh {copy} --frames 2 --width 32 --height 24 --out c", "cube.obj", ""),
    ("capture --world {copy} --frames 2 --width 32 --height 24 --out c", "room.world", ""),
    ("budget check {copy} --seconds 5", "budget.yaml", ""),
    ("trial check {copy}", "trial.yaml", ""),
    ("suite show {copy}", "suite.yaml", ""),
    ("robots {copy}", "robot.yaml", ""),
    ("table {copy}", "results.sqlite", ""),
    ("export {copy} --output e.jsonl", "results.sqlite", ""),
    ("compare {copy} --before before --after after", "results.sqlite", ""),
    ("report {copy} -o r", "results.sqlite", ""),
    ("explain {copy}", "results.sqlite", ""),
]

# Commands whose flags get odd values; {seeds} are left whole.
FLAGGED = [
    "scene inspect {seeds}/bundle", "episodes generate {seeds}/bundle -o e.jsonl",
    "capture --flat 3 --out c --frames 2",
    "render {seeds}/bundle --out v.exr", "label {seeds}/bundle --out l --views 2",
    "bench render --surfels 2000 --views 1 --repeat 1 --size 64x48",
    "reconstruct {seeds}/rec --out b --init-only", "masks simulate {seeds}/rec --out m",
    "budget check {seeds}/budget.yaml",
    "scene coverage {seeds}/bundle", "plan", "robots", "doctor", "trial check {seeds}/trial.yaml",
    "detector finetune --from {seeds}/small.weights --train {seeds}/labels/labels.json --steps 1 --out a.weights",
    "sensors {seeds}/bundle -o s", "evaluate --predictions {seeds}/masks --truth {seeds}/masks", "suite list",
]


def damaged(data, rng):
    """The bytes with one to three faults."""
    data = bytearray(data)
    text = b"\0" not in data[:4096]
    for _ in range(rng.randint(1, 3)):
        if not data:
            return bytes(rng.getrandbits(8) for _ in range(8))
        at, n = rng.randrange(len(data)), rng.choice([1, 2, 4, 8, 64, 1024])
        kind = rng.choice(["bit", "fill", "cut", "double", "end", "swap", "number", "number", "line"])
        if kind == "bit":
            data[at] ^= 1 << rng.randrange(8)
        elif kind == "fill":
            data[at:at + n] = bytes([rng.choice([0, 1, 127, 128, 255])]) * len(data[at:at + n])
        elif kind == "cut":
            del data[at:at + n]
        elif kind == "double":
            data[at:at] = data[at:at + n]
        elif kind == "end":
            del data[at:]
        elif kind == "swap":
            other = rng.randrange(len(data))
            data[at:at + n], data[other:other + n] = data[other:other + n], data[at:at + n]
        elif kind == "number" and text:
            numbers = list(re.finditer(rb"-?\d+(\.\d+)?", bytes(data[:200_000])))
            if numbers:
                found = rng.choice(numbers)
                data[found.start():found.end()] = rng.choice(ODD_NUMBERS)
        elif kind == "line" and text:
            lines = bytes(data).split(b"\n")
            here, there = rng.randrange(len(lines)), rng.randrange(len(lines))
            lines.insert(here, lines[there])
            data = bytearray(b"\n".join(lines))
    return bytes(data)


def flags_of(segsim, command, known={}):
    words = []
    for word in shlex.split(command):
        if word.startswith("-") or word.startswith("{"):
            break
        words.append(word)
    key = " ".join(words)
    if key not in known:
        text = subprocess.run([segsim, *words, "--help"], capture_output=True, text=True).stdout
        known[key] = [flag for flag in re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", text) if flag != "--help"]
    return known[key]


def prepare(seeds, number, seed, folder):
    """The arguments of an execution, with its input in `folder`."""
    rng = random.Random(f"{seed} {number}")
    if rng.random() < 0.3:
        command = rng.choice(FLAGGED)
        arguments = shlex.split(command.format(seeds=seeds.folder))
        flags = flags_of(seeds.segsim, command)
        for _ in range(rng.randint(1, 2)):
            if flags:
                arguments += [rng.choice(flags), rng.choice(ODD_VALUES)]
        return arguments
    choices = [c for c in COMMANDS if (seeds.folder / c[1]).exists()]
    command, kind, inner = rng.choice(choices)
    copy = folder / kind
    if inner == "":
        shutil.copy(seeds.folder / kind, copy)
        victim = copy
    else:
        shutil.copytree(seeds.folder / kind, copy)
        files = sorted(p for p in copy.rglob("*") if p.is_file())
        victim = copy / inner if inner else rng.choice(files)
    whole = victim.read_bytes()
    victim.write_bytes(damaged(whole, rng))
    manifest = copy / "scene.yaml"
    if kind == "bundle" and victim != manifest:  # The hash would refuse it before anybody reads it.
        old, new = (hashlib.sha256(data).hexdigest() for data in (whole, victim.read_bytes()))
        manifest.write_text(manifest.read_text().replace(old, new))
    return shlex.split(command.format(copy=copy, seeds=seeds.folder))


def run(segsim, arguments, folder):
    """What was broken; nothing if all was kept."""
    with open(folder / "stdout", "wb") as out, open(folder / "stderr", "wb") as errors:
        begin = time.monotonic()
        process = subprocess.Popen([segsim, *arguments], cwd=folder, stdout=out, stderr=errors,
                                   stdin=subprocess.DEVNULL, start_new_session=True)
        usage, status = None, None
        while status is None and time.monotonic() - begin < MOST_WALL_S:
            pid, code, usage = os.wait4(process.pid, os.WNOHANG)
            if pid:
                status = code
            else:
                time.sleep(0.02)
        if status is None:
            os.killpg(process.pid, signal.SIGKILL)
            os.wait4(process.pid, 0)
            process.returncode = -9
            return f"longer than {MOST_WALL_S:.0f} s"
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode < 0 or process.returncode > 128:
        return f"a signal ({process.returncode})"
    if process.returncode not in (0, 1, 2):
        return f"exit code {process.returncode}"
    if usage.ru_utime + usage.ru_stime > MOST_S:
        return f"{usage.ru_utime + usage.ru_stime:.0f} s of processor time"
    if usage.ru_maxrss * 1024 > MOST_BYTES:
        return f"{usage.ru_maxrss // 1024} MB"
    if process.returncode == 2:
        lines = (folder / "stderr").read_text(errors="replace").strip().splitlines()
        if not lines or not any(line.startswith("segsim") for line in lines):
            return "exit code 2 without a line that begins with segsim"
    return None


def execute(seeds, number, seed, out):
    folder = out / "work" / str(number)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    arguments = prepare(seeds, number, seed, folder)
    broken = run(seeds.segsim, arguments, folder)
    if broken:
        kept = out / "failures" / str(number)
        shutil.rmtree(kept, ignore_errors=True)
        kept.parent.mkdir(exist_ok=True)
        shutil.move(folder, kept)
        line = shlex.join(["segsim", *arguments]).replace(str(folder), str(kept))
        (kept / "command").write_text(f"{line}\n{broken}\n")
        print(f"{number}: {broken}: {line}", flush=True)
    else:
        shutil.rmtree(folder)
    return broken


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("segsim", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--results", type=Path)
    options = parser.parse_args()
    out = options.out.resolve()
    seeds = Seeds(options.segsim.resolve(), out / "seeds", options.results and options.results.resolve())
    begin, failures = time.monotonic(), 0
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        runs = [pool.submit(execute, seeds, number, options.seed, out) for number in range(options.count)]
        for done, finished in enumerate(concurrent.futures.as_completed(runs), 1):
            failures += 1 if finished.result() else 0
            if done % 50 == 0 and sys.stderr.isatty():
                left = (time.monotonic() - begin) / done * (options.count - done)
                print(f"\r{done} of {options.count}, {failures} failures, {left:.0f} s left ", end="", file=sys.stderr)
    print(f"{options.count} executions in {time.monotonic() - begin:.0f} s: {failures} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
