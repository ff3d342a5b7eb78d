#!/usr/bin/env python3
"""Runs fuzz targets and says what they found.

    run_targets.py TARGETS OUT MINUTES [TARGET...] [--executions N]

TARGETS is the list that CMake writes: name, program and dictionary of each target, one a line. OUT keeps corpora, logs
and findings between runs, and has a line for each process that has ended in record.jsonl. Without --executions each
target has the same time; with it, those that need least time come first. Exit code 0: nothing was found, 1: something,
2: a target could not be run.
"""

import argparse
import datetime
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import campaign


def read_targets(file, wanted):
    targets = {}
    folder = Path(file).resolve().parent
    for line in Path(file).read_text().splitlines():
        name, program, *dictionary = line.split()
        words = str(folder / dictionary[0]) if dictionary else None
        targets[name] = campaign.Program(name, str(folder / program), words)
    unknown = sorted(set(wanted) - set(targets))
    if unknown:
        sys.exit(f"run_targets.py: expected targets among {', '.join(sorted(targets))}, found {', '.join(unknown)}")
    return [targets[name] for name in (wanted or targets)]


def print_table(results):
    print(f"{'target':<20} {'executions':>11} {'per s':>8} {'inputs kept':>11} {'peak MB':>8} {'findings':>8}")
    for r in results:
        if "error" in r:
            print(f"{r['name']:<20} {r['error']}")
        else:
            print(f"{r['name']:<20} {r['executions']:>11} {r['executions'] / max(r['seconds'], 1e-9):>8.0f} "
                  f"{r['inputs']:>11} {r['peak_mb']:>8} {len(r['findings']):>8}")
    for r in results:
        for finding in r.get("findings", []):
            print(f"  {r['name']}: {finding}")


def git(*arguments):
    if shutil.which("git") is None:
        return ""
    return subprocess.run(["git", *arguments], capture_output=True, text=True, check=False).stdout.strip()


def processor():
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return None


def record(results, command):
    """A record as results/README.md describes it."""
    values = []
    for r in results:
        for name, unit, value in (("executions", "", r["executions"]), ("coverage", "", r["coverage"]),
                                  ("executions per second", "1/s", round(r["executions"] / max(r["seconds"], 1e-9))),
                                  ("peak memory", "MB", r["peak_mb"]), ("findings", "", len(r["findings"]))):
            value = {"name": name, "unit": unit, "value": value, "table": "Fuzz targets", "case": r["name"]}
            if name == "findings":
                value["goal"] = {"is": 0}
            values.append(value)
    commit = os.environ.get("SEGSIM_COMMIT") or git("rev-parse", "HEAD")
    dirty = git("status", "--porcelain", "--untracked-files=no")
    return {"schema": "segsim.record/1", "title": "Parsers under libFuzzer", "command": command,
            "commit": commit + ("-dirty" if dirty else "") if commit else None,
            "date": datetime.date.today().isoformat(),
            "machine": {"processor": processor(), "cores": os.cpu_count(), "gpu": None, "conditions": None},
            "note": ["Every parser of files and messages of others, under AddressSanitizer and "
                     "UndefinedBehaviorSanitizer; `tests/fuzz/README.md` says what counts as a finding."],
            "values": values}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets")
    parser.add_argument("out", type=Path)
    parser.add_argument("minutes", type=float)
    parser.add_argument("wanted", nargs="*", metavar="TARGET")
    parser.add_argument("--executions", type=int, metavar="N", help="of each target")
    parser.add_argument("--resume", action="store_true", help="count on from what record.jsonl of OUT has")
    parser.add_argument("--jobs", type=int, default=int(os.environ.get("JOBS", "2")), metavar="N",
                        help="processes at a time (JOBS, or 2)")
    parser.add_argument("--loader", metavar="FILE", help="ld-linux.so that starts the programs: where the libraries "
                                                         "that they were built with are not installed")
    parser.add_argument("--library-path", metavar="FOLDERS", help="of the loader, with colons between them")
    options = parser.parse_args()
    programs = read_targets(options.targets, options.wanted)
    machine = campaign.Machine(options.loader, options.library_path)
    out = options.out.resolve()
    results = campaign.Campaign(programs, out, machine, options.jobs, options.minutes * 60, options.executions,
                                options.resume).run(
        lambda target: print(f"{target.program.name}: {target.error or f'{target.executions} executions'}, "
                             f"{len(target.found())} findings", file=sys.stderr, flush=True))
    print_table(results)
    done = [r for r in results if "error" not in r]
    command = " ".join(["tests/fuzz/run.sh", f"{options.minutes:g}", *options.wanted])
    if options.executions:
        command = f"EXECUTIONS={options.executions} {command}"
    (out / "record.json").write_text(json.dumps(record(done, command), indent=1) + "\n")
    if len(done) < len(results):
        return 2
    return 1 if any(r["findings"] for r in done) else 0


if __name__ == "__main__":
    sys.exit(main())
