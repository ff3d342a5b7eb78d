#!/usr/bin/env python3
"""What `segsim` loads and uses until a subcommand has done its work.

  startup.py check SEGSIM --results PROGRAM     exit code 1 if a light subcommand loads too much
  startup.py measure SEGSIM --results PROGRAM [--record FILE]
                                                a table; FILE gets it as a record (results/README.md)

SEGSIM is the launcher of a build. PROGRAM writes small results to the file that it is given (tests/system/small_results.cpp).
Processor time is the lowest of five runs, memory (resident set) the highest. Libraries are those that the
dynamic loader initialises, counted once.
"""
import argparse
import datetime
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
MOST_CPU_S, MOST_MB = 0.10, 60
MOST_LIBRARIES = 60
SHARED_MACHINE = 5  # A test's bound on processor time is so many times the goal: others compute beside it.
HEAVY = re.compile(r"/lib(torch|opencv_(videoio|imgcodecs)|vtk|gdal|Qt|ignition-transport|pcl_io)")
RUNS = 5


def commands(segsim, results):
    """Arguments, and whether they must start at once: work that is done at once, then every other subcommand's --help."""
    drive = str(ROOT / "experiments" / "trials" / "drive.yaml")
    light = [
        ["--version"], ["--help"], ["table", results], ["compare", results], ["plan", "--psi", "0.3", "--delta", "0.2"],
        ["export", results, "-o", f"{results}/trials.csv"], ["suite", "list"], ["suite", "verify", "--help"], ["robots"],
        ["trial", "check", "--help"], ["trial", "check", drive],
    ]
    text = subprocess.run([segsim, "--help"], capture_output=True, text=True, check=True).stdout
    names = re.findall(r"^  ([a-z]+) ", text.split("Subcommands:")[1], re.MULTILINE)
    done = {arguments[0] for arguments in light}
    return [(arguments, True) for arguments in light] + [([name, "--help"], False) for name in names if name not in done]


def title(arguments, results):
    words = [word.replace(results, "DIR") for word in arguments]
    return " ".join(["segsim"] + [pathlib.Path(w).name if w.startswith("/") else w for w in words])


def run_once(command, environment):
    """Processor time [s] and memory [MB] of the program, its errors if any."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(write, 2)
        os.close(read)
        os.execve(command[0], command, environment)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        errors = pipe.read().decode(errors="replace")
    _, status, usage = os.wait4(child, 0)
    if os.waitstatus_to_exitcode(status) != 0:
        sys.exit(f"startup.py: {' '.join(command)}: expected exit code 0, found\n{errors}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, errors


def measure(command):
    runs = [run_once(command, dict(os.environ)) for _ in range(RUNS)]
    _, _, log = run_once(command, dict(os.environ, LD_DEBUG="files"))
    libraries = set(re.findall(r"calling init: (\S+)", log))
    return {"cpu_s": min(run[0] for run in runs), "mb": max(run[1] for run in runs), "libraries": sorted(libraries)}


def faults(name, found):
    """What a light subcommand must not do."""
    if found["mb"] > MOST_MB:
        yield f"{name}: expected at most {MOST_MB} MB, found {found['mb']:.0f} MB"
    if len(found["libraries"]) > MOST_LIBRARIES:
        yield f"{name}: expected at most {MOST_LIBRARIES} libraries, found {len(found['libraries'])}"
    if found["cpu_s"] > SHARED_MACHINE * MOST_CPU_S:
        yield f"{name}: expected at most {SHARED_MACHINE * MOST_CPU_S:.2f} s, found {found['cpu_s']:.2f} s"
    for library in found["libraries"]:
        if HEAVY.search(library):
            yield f"{name}: expected none of the heavy libraries, found {library}"


def record_of(segsim, rows):
    values = []
    for name, light, found in rows:
        goals = {"processor time": MOST_CPU_S, "memory": MOST_MB} if light else {}
        if name.endswith(".yaml"):
            del goals["processor time"]  # It starts, and then builds the flat that it checks the file against.
        for value, unit, number in (("libraries", "", len(found["libraries"])),
                                    ("processor time", "s", round(found["cpu_s"], 3)),
                                    ("memory", "MB", round(found["mb"]))):
            values.append({"case": name, "name": value, "unit": unit, "value": number})
            if goals.get(value):
                values[-1]["goal"] = {"at_most": goals[value]}
    version = subprocess.run([segsim, "--version"], capture_output=True, text=True, check=True).stdout
    model = re.search(r"model name\s*: (.*)", pathlib.Path("/proc/cpuinfo").read_text())
    return {
        "schema": "segsim.record/1", "title": "Start-up",
        "command": "python3 tools/startup.py measure SEGSIM --results PROGRAM --record FILE",
        "commit": version.split("(")[-1].strip(") \n"), "date": datetime.date.today().isoformat(),
        "machine": {"processor": model.group(1) if model else None, "cores": os.cpu_count(), "gpu": None,
                    "conditions": "not quiet: processor time is the lowest of five runs"},
        "note": ["Libraries that the loader initialises, processor time (user and system) and largest resident set of each "
                 "command, from the launcher's start to the end."],
        "values": values,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("check", "measure"))
    parser.add_argument("segsim")
    parser.add_argument("--results", required=True)
    parser.add_argument("--record")
    flags = parser.parse_args()
    segsim = os.path.abspath(flags.segsim)
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([flags.results, f"{folder}/results.sqlite"], check=True)
        rows = [(title(arguments, folder), light, measure([segsim, *arguments]))
                for arguments, light in commands(segsim, folder) if light or flags.what == "measure"]
    print(f"{'':42} libraries  processor time  memory")
    for name, _, found in rows:
        print(f"{name:42} {len(found['libraries']):9}  {found['cpu_s']:12.3f} s  {found['mb']:3.0f} MB")
    if flags.record:
        pathlib.Path(flags.record).write_text(json.dumps(record_of(segsim, rows), indent=1) + "\n")
    wrong = [fault for name, light, found in rows if light for fault in faults(name, found)]
    print("\n".join(wrong), file=sys.stderr)
    sys.exit(flags.what == "check" and bool(wrong))


if __name__ == "__main__":
    main()
