import ast
import pathlib
import re
import subprocess
import sys

import pytest

import fastsegsim
from fastsegsim import adapters, results

ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGE = pathlib.Path(fastsegsim.__file__).parent


def run_python(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout


def test_the_version_is_the_projects():
    [version] = re.findall(r"project\(segsim VERSION ([0-9.]+)", (ROOT / "CMakeLists.txt").read_text())
    assert fastsegsim.__version__ == version


def test_every_public_name_is_documented():
    for module in (fastsegsim, adapters, results):
        for name in module.__all__:
            documented = getattr(module, name)
            assert documented.__doc__, f"{module.__name__}.{name}"
            for member, value in vars(documented).items() if isinstance(documented, type) else ():
                if not member.startswith("_") and (callable(value) or isinstance(value, property)):
                    assert value.__doc__, f"{module.__name__}.{name}.{member}"


def test_the_package_is_typed():
    assert (PACKAGE / "py.typed").exists()
    stubs = ast.parse((PACKAGE / "_native.pyi").read_text())
    classes = {node.name: node for node in stubs.body if isinstance(node, ast.ClassDef)}
    assert {"InputError", "Renderer", "Scene", "SceneClass", "SceneInstance"} <= set(classes)
    [render] = [node for node in classes["Renderer"].body if getattr(node, "name", "") == "render"]
    assert [argument.arg for argument in render.args.args] == ["self", "T_world_camera", "K", "size", "channels"]
    assert "NDArray" in ast.unparse(render.returns)


def test_importing_is_quick_and_loads_little():
    took_s = min(float(run_python("import time; before = time.process_time(); import fastsegsim; "
                                  "print(time.process_time() - before)")) for _ in range(5))
    assert took_s < 0.3
    loaded = run_python("import sys, fastsegsim; print('numpy' in sys.modules, 'sqlite3' in sys.modules); "
                        "print(open('/proc/self/maps').read())")
    assert loaded.startswith("False False\n")
    assert not re.search(r"lib(torch|opencv|pcl|vtk|embree)", loaded)


def test_an_error_says_where_it_comes_from():
    assert f"{fastsegsim.InputError.__module__}.{fastsegsim.InputError.__name__}" == "fastsegsim.InputError"


def test_what_is_not_there_is_no_attribute():
    with pytest.raises(AttributeError, match="module 'fastsegsim' has no attribute 'nothing'"):
        fastsegsim.nothing
    assert fastsegsim.results is results


def test_the_reference_is_that_of_the_docstrings():
    checked = subprocess.run([sys.executable, ROOT / "tools/python_reference.py", PACKAGE, "--check"], check=False,
                             capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_the_example_draws_a_scene(bundle, tmp_path):
    program = ROOT / "python" / "examples" / "render_scene.py"
    printed = subprocess.run([sys.executable, program, bundle, "--from", "0.5", "3", "1.4", "--to", "8", "3", "1.2"],
                             cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert "couch" in printed and "4000 surfels" in printed
    magic, size, largest, pixels = (tmp_path / "view.ppm").read_bytes().split(b"\n", 3)
    assert (magic, size, largest, len(pixels)) == (b"P6", b"640 480", b"255", 3 * 640 * 480)
    assert len(set(pixels)) > 100
