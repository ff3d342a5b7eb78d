"""Notebooks of python/examples: they are small, hold no outputs, and run from the first cell to the last."""

import json
import os
import pathlib

import pytest

from test_adapters import TINY_NETWORK, write_views

NOTEBOOKS = pathlib.Path(__file__).resolve().parents[2] / "python/examples/notebooks"
NAMES = ["compare_runs", "evaluate_detector", "render_scene"]


def test_notebooks_hold_no_outputs():
    assert sorted(file.stem for file in NOTEBOOKS.glob("*.ipynb")) == NAMES
    for name in NAMES:
        file = NOTEBOOKS / f"{name}.ipynb"
        assert file.stat().st_size < 8000
        cells = json.loads(file.read_text())["cells"]
        assert cells[0]["cell_type"] == "markdown"
        for cell in cells:
            assert cell.get("outputs", []) == [] and cell.get("execution_count") is None
            assert all(len(line.rstrip("\n")) <= 120 for line in cell["source"])


def run_notebook(name: str, environment: dict[str, str], monkeypatch) -> tuple[str, int]:
    """What it prints, and the number of its pictures."""
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    pytest.importorskip("matplotlib")
    for key, value in environment.items():
        monkeypatch.setenv(key, str(value))
    notebook = nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)
    nbformat.validate(notebook)
    nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3",
                            resources={"metadata": {"path": str(NOTEBOOKS)}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    printed = "".join(output.get("text", "") for output in outputs)
    return printed, sum("image/png" in output.get("data", {}) for output in outputs)


def test_a_scene_is_shown(tiny, monkeypatch):
    printed, pictures = run_notebook("render_scene", {"SEGSIM_SCENE": tiny.bundle}, monkeypatch)
    assert "tiny: " in printed and "couch" in printed and "nearest" in printed and pictures == 1


def test_runs_are_compared(small_run, monkeypatch):
    printed, pictures = run_notebook("compare_runs", {"SEGSIM_RUN": small_run}, monkeypatch)
    assert "95 % interval" in printed and "of 4 pairs, p = " in printed and "after: path" in printed and pictures == 1


def test_a_detector_is_evaluated(tmp_path, monkeypatch):
    pytest.importorskip("torch")
    write_views(tmp_path, 12).rename(tmp_path / "train.json")
    write_views(tmp_path, 5).rename(tmp_path / "val_views.json")
    (tmp_path / "tiny_network.py").write_text(TINY_NETWORK)
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    printed, pictures = run_notebook("evaluate_detector", {
        "SEGSIM_VIEWS": tmp_path, "SEGSIM_NETWORK": "tiny_network:ColourFinder", "SEGSIM_STEPS": "100",
        "SEGSIM_RATE": "0.1", "PYTHONPATH": paths}, monkeypatch)
    assert "before: AP50 0.000" in printed and "after: AP50 1.000" in printed and pictures == 1
