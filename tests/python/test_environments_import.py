"""What importing environments asks for, and what it says where something is missing."""

import ast
import pathlib
import shutil
import subprocess
import sys

import pytest

import fastsegsim

PACKAGE = pathlib.Path(fastsegsim.__file__).parent


def said_by(code: str, path: pathlib.Path | None = None) -> str:
    """What Python prints."""
    before = f"import sys; sys.path.insert(0, {str(path)!r}); " if path else ""
    return subprocess.run([sys.executable, "-c", before + code], check=True, capture_output=True, text=True).stdout


def test_the_package_alone_needs_no_gymnasium():
    printed = said_by("import sys; sys.modules['gymnasium'] = None; import fastsegsim; print(fastsegsim.Scene)\n"
                      "try:\n  fastsegsim.environments\nexcept ImportError as error:\n  print(error)")
    assert "fastsegsim.environments needs Gymnasium: pip install gymnasium" in printed
    assert said_by("import sys, fastsegsim; print('gymnasium' in sys.modules)") == "False\n"


def test_a_package_that_was_built_without_environments_says_so(tmp_path):
    pytest.importorskip("gymnasium", reason="Gymnasium is not installed")
    shutil.copytree(PACKAGE, tmp_path / "fastsegsim", ignore=shutil.ignore_patterns("_environments*"))
    (tmp_path / "fastsegsim" / "environments_missing.txt").write_text("libembree-dev librecast-dev\n")
    printed = said_by("import fastsegsim\ntry:\n  fastsegsim.environments\n"
                      "except ImportError as error:\n  print(error)", tmp_path)
    assert printed == ("this fastsegsim was built without environments, for want of: libembree-dev librecast-dev; "
                       "install them, and the package once more\n")


def test_importing_environments_gives_the_name():
    pytest.importorskip("gymnasium", reason="Gymnasium is not installed")
    listed = "print('SegSim/ObjectNav-v0' in gymnasium.registry)"
    assert said_by(f"import gymnasium; {listed}; import fastsegsim.environments; {listed}") == "False\nTrue\n"
    # Gymnasium imports what stands before a colon.
    printed = said_by("import gymnasium\ntry:\n"
                      "  gymnasium.make('fastsegsim.environments:SegSim/ObjectNav-v0', scene='no')\n"
                      "except ValueError as error:\n  print(type(error).__name__, error)")
    assert printed.startswith("InputError no: expected a scene bundle")
    from fastsegsim import environments
    for name in environments.__all__:
        documented = getattr(environments, name)
        if isinstance(documented, type):
            for member in ("reset", "step", "render", "commands_of", "infeasible_episodes"):
                assert vars(documented)[member].__doc__, f"{name}.{member}"
            assert "InputError" in documented.__doc__ or "ObjectNavEnv" in documented.__doc__


def test_environments_are_typed():
    pytest.importorskip("gymnasium", reason="Gymnasium is not installed")
    stubs = ast.parse((PACKAGE / "_environments.pyi").read_text())
    classes = {node.name: ast.unparse(node) for node in stubs.body if isinstance(node, ast.ClassDef)}
    assert set(classes) == {"EnvironmentBatch", "EnvironmentSettings"}
    assert "def reset(self, seeds: Sequence[int | None]" in classes["EnvironmentBatch"]
    assert "def horizontal_fov_rad(self) -> float" in classes["EnvironmentSettings"]
