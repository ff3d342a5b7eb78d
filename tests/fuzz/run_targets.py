#!/usr/bin/env python3
"""Runs fuzz targets for their shares of a time and says what they found.

    run_targets.py TARGETS OUT MINUTES [TARGET...]

TARGETS is the list that CMake writes: name, program and dictionary of each target, one a line. OUT keeps corpora, logs
and findings between runs. Exit code 0: nothing was found, 1: something, 2: a target could not be run.
"""

import argparse
import concurrent.futures
import datetime
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

MOST_INPUT_S, MOST_MB, MOST_INPUT_BYTES = 20, 2048, 65536
SANITIZERS = {
    # Libraries of others are compiled without sanitizers, and containers that they fill look overflown. A fuzzer finds
    # what the program holds on to by its memory; leaks at the end are libraries' own.
    "ASAN_OPTIONS": "detect_leaks=0:detect_container_overflow=0:allocator_may_return_null=1:handle_abort=1:"
                    "quarantine_size_mb=16:max_allocation_size_mb=2048",
    "UBSAN_OPTIONS": "print_stacktrace=1",
}


def read_targets(file, wanted):
    targets = {}
    for line in Path(file).read_text().splitlines():
        name, program, *dictionary = line.split()
        targets[name] = (program, dictionary[0] if dictionary else None)
    unknown = sorted(set(wanted) - set(targets))
    if unknown:
        sys.exit(f"run_targets.py: expected targets among {', '.join(sorted(targets))}, found {', '.join(unknown)}")
    return {name: targets[name] for name in (wanted or targets)}


def environment(folder):
    # Files of inputs in memory, where there is a file system of it.
    place = Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else folder
    work = place / f"segsim_fuzz_{os.getpid()}_{folder.name}"
    work.mkdir(parents=True, exist_ok=True)
    return {**os.environ, **SANITIZERS, "TMPDIR": str(work), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}, work


def fuzz_once(command, log, env):
    """Appends to the log; returns libFuzzer's exit code."""
    with open(log, "ab") as out:
        return subprocess.run(command, stdout=out, stderr=subprocess.STDOUT, env=env, check=False).returncode


def fuzz(name, program, dictionary, seconds, out):
    """A target until its time is over, begun anew after each finding."""
    corpus, findings, log = (out / kind / name for kind in ("corpus", "findings", "logs"))
    for folder in (corpus, findings, log.parent):
        folder.mkdir(parents=True, exist_ok=True)
    log = log.with_suffix(".log")
    log.unlink(missing_ok=True)
    env, work = environment(out / name)
    before = set(findings.iterdir())
    if not Path(program).exists():
        return {"name": name, "error": "is not built"}
    if subprocess.run([program, "--seeds", str(corpus)], env=env, check=False, capture_output=True).returncode:
        return {"name": name, "error": "its seeds could not be made"}
    begin, code = time.monotonic(), 0
    while (left := seconds - (time.monotonic() - begin)) >= 1:
        command = [program, str(corpus), f"-max_total_time={int(left)}", f"-timeout={MOST_INPUT_S}",
                   f"-rss_limit_mb={MOST_MB}", f"-max_len={MOST_INPUT_BYTES}", "-print_final_stats=1",
                   f"-report_slow_units={MOST_INPUT_S}", "-close_fd_mask=1", f"-artifact_prefix={findings}/"]
        if dictionary:
            command.append(f"-dict={dictionary}")
        code = fuzz_once(command, log, env)
        if code == 0 or len(set(findings.iterdir()) - before) >= 10:
            break
    shutil.rmtree(work, ignore_errors=True)
    text = log.read_text(errors="replace")
    executions = sum(int(n) for n in re.findall(r"stat::number_of_executed_units:\s*(\d+)", text))
    peak = max((int(n) for n in re.findall(r"stat::peak_rss_mb:\s*(\d+)", text)), default=0)
    found = sorted(str(p) for p in set(findings.iterdir()) - before)
    if code != 0 and not found:
        return {"name": name, "error": f"ended with exit code {code} (see {log})"}
    return {"name": name, "executions": executions, "seconds": time.monotonic() - begin, "peak_mb": peak,
            "inputs": len(list(corpus.iterdir())), "findings": found}


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
        for name, unit, value in (("executions", "", r["executions"]),
                                  ("executions per second", "1/s", round(r["executions"] / max(r["seconds"], 1e-9))),
                                  ("peak memory", "MB", r["peak_mb"]), ("findings", "", len(r["findings"]))):
            value = {"name": name, "unit": unit, "value": value, "table": "Fuzz targets", "case": r["name"]}
            if name == "findings":
                value["goal"] = {"is": 0}
            values.append(value)
    commit = git("rev-parse", "HEAD")
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
    options = parser.parse_args()
    targets = read_targets(options.targets, options.wanted)
    jobs = int(os.environ.get("JOBS", "2"))
    seconds = max(options.minutes * 60 * min(jobs, len(targets)) / len(targets), 5.0)
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        runs = [pool.submit(fuzz, name, program, dictionary, seconds, options.out.resolve())
                for name, (program, dictionary) in targets.items()]
        results = []
        for run in concurrent.futures.as_completed(runs):
            results.append(run.result())
            r = results[-1]
            said = r.get("error") or f"{len(r['findings'])} findings"
            print(f"{r['name']}: {said}", file=sys.stderr, flush=True)
    results.sort(key=lambda r: r["name"])
    print_table(results)
    done = [r for r in results if "error" not in r]
    command = " ".join(["tests/fuzz/run.sh", f"{options.minutes:g}", *options.wanted])
    (options.out / "record.json").write_text(json.dumps(record(done, command), indent=1) + "\n")
    if len(done) < len(results):
        return 2
    return 1 if any(r["findings"] for r in done) else 0


if __name__ == "__main__":
    sys.exit(main())
