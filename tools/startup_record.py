#!/usr/bin/env python3
"""What it costs to start `segsim`, as a record for results/.

  startup_record.py SEGSIM RUN RECORD.json     RUN: the folder of a finished run with arms "before" and "after"

For each of the subcommands that do little: CPU time and peak memory, the lowest of five, and the shared libraries that were
loaded. Other programs make the CPU time longer, never shorter.
"""
import os
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools" / "results"))

from record import SCHEMA, write_record  # noqa: E402
from run_record import commit_of, cores_here  # noqa: E402

MOST_CPU_S, MOST_MEMORY_MB, REPETITIONS = 0.10, 60, 5


def subcommands(run):
    return {"segsim --version": ["--version"], "segsim --help": ["--help"], "segsim table RUN": ["table", run],
            "segsim compare RUN": ["compare", run, "--before", "before", "--after", "after"],
            "segsim plan": ["plan", "--psi", "0.35", "--delta", "0.25"],
            "segsim trial check": ["trial", "check", str(ROOT / "experiments/trials/drive.yaml")]}


def cpu_and_memory(program, arguments):
    """CPU time [s] and peak memory [MB] of one call."""
    child = os.fork()
    if child == 0:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        os.execv(program, [program, *arguments])
    _, status, usage = os.wait4(child, 0)
    if status != 0:
        sys.exit(f"{program} {' '.join(arguments)}: expected exit code 0, found {os.waitstatus_to_exitcode(status)}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def libraries(program, arguments):
    """Shared libraries that the loader initialised, in whichever process of the call had most."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([program, *arguments], stdout=subprocess.DEVNULL, check=True,
                       env={**os.environ, "LD_DEBUG": "libs", "LD_DEBUG_OUTPUT": os.path.join(folder, "loader")})
        texts = [path.read_text(errors="replace") for path in pathlib.Path(folder).iterdir()]
    return max((len(set(re.findall(r"calling init: (\S+)", text))) for text in texts), default=0)


def processor():
    found = re.search(r"^model name\s*: (.*)$", pathlib.Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return found[1] if found else None


def values(program, run):
    for name, arguments in subcommands(run).items():
        calls = [cpu_and_memory(program, arguments) for _ in range(REPETITIONS)]
        yield {"case": name, "name": "CPU time", "unit": "s", "value": round(min(cpu for cpu, _ in calls), 3),
               "goal": {"at_most": MOST_CPU_S}}
        yield {"case": name, "name": "peak memory", "unit": "MB", "value": round(min(memory for _, memory in calls)),
               "goal": {"at_most": MOST_MEMORY_MB}}
        yield {"case": name, "name": "shared libraries", "unit": "", "value": libraries(program, arguments)}


def main(program, run, record):
    version = subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout
    today = subprocess.run(["date", "-u", "+%F"], capture_output=True, text=True, check=True).stdout.strip()
    write_record(record, {"schema": SCHEMA, "title": "Start of the program",
                          "command": "tools/startup_record.py build/release/experiments/segsim RUN RECORD.json",
                          "commit": commit_of(version), "date": today,
                          "machine": {"processor": processor(), "cores": cores_here(), "gpu": None}, "note": [],
                          "values": list(values(program, run))})


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
