"""Many targets of libFuzzer on the cores of one machine until each has its executions or the time is over.

A target runs in slices, each of which is one process. Those that need least time come first, so that as many targets
as possible are done whenever it ends; a slow target has several processes at once, with seeds of their own. After each
slice there is a line in record.jsonl: the last line of a target says how far it is.
"""

import collections
import concurrent.futures
import json
import os
import re
import shutil
import subprocess
import time
from pathlib import Path

MOST_INPUT_S, MOST_MB, MOST_INPUT_BYTES, MOST_FINDINGS = 20, 2048, 65536, 10
FIRST_SLICE_S, SLICE_S = 10, 60
SANITIZERS = {
    # Libraries of others are compiled without sanitizers, and containers that they fill look overflown. A fuzzer finds
    # what the program holds on to by its memory; leaks at the end are libraries' own, and finding them takes ptrace.
    "ASAN_OPTIONS": "detect_leaks=0:detect_container_overflow=0:allocator_may_return_null=1:handle_abort=1:"
                    "quarantine_size_mb=16:max_allocation_size_mb=2048",
    "UBSAN_OPTIONS": "print_stacktrace=1",
}
Program = collections.namedtuple("Program", "name, file, dictionary")


class Machine:
    """How programs are started."""

    def __init__(self, loader=None, library_path=None):
        self.prefix = [loader, "--library-path", library_path] if loader else []

    def command(self, program, arguments):
        return [*self.prefix, program.file, *arguments]

    def run(self, command, log, work):
        """Appends to the log; returns the exit code."""
        # Files of inputs in memory, where there is a file system of it.
        place = Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else work
        files = place / f"segsim_fuzz_{os.getpid()}_{log.stem}"
        files.mkdir(parents=True, exist_ok=True)
        env = {**os.environ, **SANITIZERS, "TMPDIR": str(files), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        with open(log, "ab") as out:
            code = subprocess.run(command, stdout=out, stderr=subprocess.STDOUT, env=env, check=False).returncode
        shutil.rmtree(files, ignore_errors=True)
        return code


class Target:
    """What is known of one target."""

    def __init__(self, program, out):
        self.program = program
        self.corpus, self.findings = (out / kind / program.name for kind in ("corpus", "findings"))
        self.logs = out / "logs"
        for folder in (self.corpus, self.findings, self.logs):
            folder.mkdir(parents=True, exist_ok=True)
        self.before = set(self.findings.iterdir())
        self.slices = self.running = self.promised = self.failures = 0
        self.executions = self.seconds = self.peak_mb = self.coverage = 0
        self.error = None

    def found(self):
        return sorted(str(p) for p in set(self.findings.iterdir()) - self.before if p.suffix != ".txt")

    def go_on(self, result):
        """From what an earlier campaign has written of it."""
        for name in ("executions", "seconds", "peak_mb", "coverage", "slices"):
            setattr(self, name, result.get(name, 0))
        self.before = set()

    def open(self):
        return self.error is None and self.failures < MOST_FINDINGS

    def rate(self):
        return max(self.executions, 1) / max(self.seconds, 1e-3)

    def result(self):
        if self.error:
            return {"name": self.program.name, "error": self.error}
        return {"name": self.program.name, "executions": self.executions, "seconds": round(self.seconds, 1),
                "peak_mb": self.peak_mb, "coverage": self.coverage, "slices": self.slices,
                "inputs": len(list(self.corpus.iterdir())), "findings": self.found()}

    def seed(self, machine):
        if not Path(self.program.file).exists():
            self.error = "is not built"
        elif machine.run(machine.command(self.program, ["--seeds", str(self.corpus)]), self.log("seeds"), self.logs):
            self.error = f"its seeds could not be made (see {self.log('seeds')})"

    def log(self, what):
        return self.logs / f"{self.program.name}.{what}.log"

    def arguments(self, seconds, executions, seed):
        arguments = [str(self.corpus), f"-max_total_time={max(int(seconds), 1)}", f"-timeout={MOST_INPUT_S}",
                     f"-rss_limit_mb={MOST_MB}", f"-malloc_limit_mb={MOST_MB}", f"-max_len={MOST_INPUT_BYTES}",
                     "-print_final_stats=1", f"-report_slow_units={MOST_INPUT_S}", "-close_fd_mask=1", f"-seed={seed}",
                     f"-artifact_prefix={self.findings}/"]
        if executions is not None:
            arguments.append(f"-runs={executions}")
        if self.program.dictionary:
            arguments.append(f"-dict={self.program.dictionary}")
        return arguments

    def add(self, log, seconds, code):
        """Takes in what a slice has said."""
        text = log.read_text(errors="replace")
        counts = re.findall(r"stat::number_of_executed_units:\s*(\d+)", text) or re.findall(r"^#(\d+)\t", text, re.M)
        self.executions += int(counts[-1]) if counts else 0
        self.seconds += seconds
        for name, pattern in (("peak_mb", r"stat::peak_rss_mb:\s*(\d+)"), ("coverage", r" cov: (\d+) ")):
            setattr(self, name, max([getattr(self, name), *map(int, re.findall(pattern, text))]))
        begin = min((at for at in (text.find("==ERROR"), text.find("runtime error:"), text.find("libFuzzer: "))
                     if at >= 0), default=0)
        self.failures += code != 0
        artifacts = re.findall(r"Test unit written to (\S+)", text)
        for artifact in artifacts:
            Path(artifact + ".txt").write_text(text[max(begin - 200, 0):][:20000])
        if code != 0 and not artifacts:
            self.error = f"ended with exit code {code} (see {log})"


class Campaign:
    def __init__(self, programs, out, machine, jobs, seconds, executions=None, resume=False):
        self.machine, self.jobs, self.executions, self.out = machine, jobs, executions, out
        out.mkdir(parents=True, exist_ok=True)
        self.targets = [Target(program, out) for program in programs]
        if resume:
            last = self.read()
            for target in self.targets:
                target.go_on(last.get(target.program.name, {}))
        self.end = time.monotonic() + seconds
        # Without a number of executions each has the same time.
        self.share = max(seconds * min(jobs, len(self.targets)) / len(self.targets), 5.0)

    def run(self, say):
        """`say` is called with a target after each of its slices."""
        with concurrent.futures.ThreadPoolExecutor(self.jobs) as pool:
            list(pool.map(lambda target: target.seed(self.machine), self.targets))
            running = {}
            while True:
                while len(running) < self.jobs and (work := self.next()):
                    running[pool.submit(self.slice, *work)] = work
                if not running:
                    break
                done, _ = concurrent.futures.wait(running, return_when=concurrent.futures.FIRST_COMPLETED)
                for future in done:
                    target, _, promised, _ = running.pop(future)
                    target.running -= 1
                    target.promised -= promised
                    target.add(*future.result())
                    self.write(target)
                    say(target)
        return [target.result() for target in sorted(self.targets, key=lambda t: t.program.name)]

    def next(self):
        """A target, seconds, executions and the number of the slice; None if there is nothing to begin."""
        left_s = self.end - time.monotonic()
        choice = self.next_of_executions(left_s) if self.executions else self.next_of_time()
        if choice is None or choice[1] < 1:
            return None
        target, seconds, promised = choice
        target.slices += 1
        target.running += 1
        target.promised += promised
        return target, seconds, promised, target.slices

    def next_of_time(self):
        for target in self.targets:
            if target.open() and not target.running and target.seconds + 1 < self.share:
                return target, self.share - target.seconds, 0
        return None

    def next_of_executions(self, left_s):
        best = None
        for target in self.targets:
            missing = self.executions - target.executions - target.promised
            if not target.open() or missing <= 0 or (target.slices == target.running and target.running > 0):
                continue  # Before the first slice nobody knows how quick it is.
            if target.slices == 0:
                return target, min(FIRST_SLICE_S, left_s), min(missing, self.executions)
            if best is None or missing / target.rate() < best[1] / best[0].rate():
                best = target, missing
        if best is None:
            return None
        target, missing = best
        seconds = min(SLICE_S, left_s)
        # Somewhat more than it can do: what remains goes to others.
        return target, seconds, min(missing, int(target.rate() * seconds) + 1)

    def slice(self, target, seconds, promised, number):
        log = target.log(number)
        log.unlink(missing_ok=True)
        executions = promised if self.executions else None
        begin = time.monotonic()
        code = self.machine.run(
            self.machine.command(target.program, target.arguments(seconds, executions, number)), log, target.logs)
        return log, time.monotonic() - begin, code

    def read(self):
        """The last lines of targets."""
        last = {}
        file = self.out / "record.jsonl"
        for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else []:
            try:
                result = json.loads(line)
            except ValueError:
                continue  # It was killed while it wrote.
            if "error" not in result:
                last[result["name"]] = result
        return last

    def write(self, target):
        with open(self.out / "record.jsonl", "a", encoding="utf-8") as file:
            file.write(json.dumps(target.result()) + "\n")
