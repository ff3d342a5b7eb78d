#!/usr/bin/env python3
"""Fails when a public header cannot be included by itself.

  check_headers.py ROOT COMPILER

A source file that includes its own header first has shown already, by compiling, that this header needs nothing before it.
The other headers are compiled here, each alone and for syntax only. Public are the headers outside of `internal` and `cuda`
folders; those whose name ends in -inl.h are parts of sources.
"""
import concurrent.futures
import os
import pathlib
import re
import subprocess
import sys

MODULES = ("core", "renderer", "reconstruction", "perception", "nav", "sim", "ros", "peers", "worlds", "experiments")
INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]', re.MULTILINE)


def public_headers(root):
    for module in MODULES:
        for path in sorted((root / module).rglob("*.h")):
            if not {"internal", "cuda"} & set(path.relative_to(root).parts) and not path.stem.endswith("-inl"):
                yield path.relative_to(root)


def shown_by_its_source(root, header):
    source = root / header.with_suffix(".cpp")
    if not source.exists():
        return False
    first = INCLUDE.search(source.read_text())
    return first is not None and first.group(1) == header.as_posix()


def complaint(root, compiler, header):
    """What the compiler says of a header alone; None if it is content."""
    run = subprocess.run([compiler, "-std=c++20", "-fsyntax-only", "-x", "c++", f"-I{root}", "-"], check=False,
                         input=f'#include "{header.as_posix()}"\n', capture_output=True, text=True)
    return run.stderr if run.returncode else None


def main(root, compiler):
    root = pathlib.Path(root).resolve()
    headers = list(public_headers(root))
    alone = [header for header in headers if not shown_by_its_source(root, header)]
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        complaints = list(pool.map(lambda header: complaint(root, compiler, header), alone))
    for header, text in zip(alone, complaints):
        if text:
            print(f"{header} does not compile by itself:\n{text}")
    print(f"{len(headers)} public headers, {len(alone)} of them compiled alone")
    return 1 if any(complaints) else 0


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
