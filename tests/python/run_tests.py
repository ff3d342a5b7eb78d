#!/usr/bin/env python3
"""Builds the Python package and runs its tests on it.

  run_tests.py ROOT WORK [SEGSIM SMALL_RESULTS TINY_TRIAL SURFEL_GRADIENTS]

ROOT is the repository, WORK a folder for the package; pip compiles in ROOT/build, as it does for users. SEGSIM,
SMALL_RESULTS, TINY_TRIAL and SURFEL_GRADIENTS are the programs that the package's images, figures, environments and
gradients are compared with; without them those tests are skipped. Nothing is downloaded: where a module is missing that
building or testing needs, the exit code is 77, and the reason is printed. Without Gymnasium the tests of environments
are skipped, and so are, by name, those that need PyTorch, pyarrow, pandas, PyAV, LeRobot, torchvision or nbclient with
ipykernel and matplotlib.
"""
import importlib.util
import os
import pathlib
import subprocess
import sys

SKIPPED = 77
NEEDED = ("pip", "nanobind", "scikit_build_core", "numpy", "pytest")


def main(root, work, segsim="", small_results="", tiny_trial="", surfel_gradients=""):
    missing = [module for module in NEEDED if importlib.util.find_spec(module) is None]
    if sys.version_info < (3, 11):
        missing.append("3.11 of Python itself")
    if missing:
        print(f"python/package: skipped, {sys.executable} has no {', '.join(missing)}")
        return SKIPPED
    package = pathlib.Path(work).resolve() / "package"
    subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index",
                    "--no-build-isolation", "--no-deps", "--upgrade", "--target", str(package), root], check=True)
    programs = {"SEGSIM_PROGRAM": segsim, "SEGSIM_SMALL_RESULTS": small_results, "SEGSIM_TINY_TRIAL": tiny_trial,
                "SEGSIM_SURFEL_GRADIENTS": surfel_gradients}
    environment = {**os.environ, "PYTHONPATH": str(package), **{name: path for name, path in programs.items() if path}}
    tests = pathlib.Path(__file__).resolve().parent
    return subprocess.run([sys.executable, "-m", "pytest", "-q", "-ra", "-p", "no:cacheprovider", str(tests)],
                          env=environment, check=False).returncode


if __name__ == "__main__":
    if len(sys.argv) not in (3, 7):
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
