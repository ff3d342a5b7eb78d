"""A run as Arrow tables. They need pyarrow, which is imported when the first table is made.

Units are in the names of columns, and again in the metadata of their fields ("unit"). What is not known is null. The
metadata of each table ("segsim") says in JSON where the numbers come from.
"""

import datetime
import importlib
import json
import os
import pathlib
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from fastsegsim.results.summary import summarise

if TYPE_CHECKING:
    import pyarrow

    from fastsegsim.results.stored_run import Run

SCHEMA = "segsim.arrow/1"
_UNITS = {"m": "m", "s": "s", "ms": "ms", "px": "px"}
_WORDS = ("scene", "goal_class", "arm", "outcome", "stop_reason", "cause")  # Few different ones in many rows.
_UNKNOWN_BELOW_ZERO = ("images", "misplaced_clouds", "stop_views", "oracle_successes", "oracle_episodes", "source_ap50",
                       "unseen_ap50", "finetune_seed")
_OF_HELD_OUT_VIEWS = ("ap50", "ap", "held_out_threshold", "precision", "recall", "source_ap50", "unseen_ap50")
_TIMES = ("finished", "started", "ended")
_KINDS = {"b": bool, "i": int, "u": int, "f": float, "U": str}  # Of NumPy's types.
_GROUP = {"group": str, "name": str}
_RATES = {**_GROUP, "arm": str, "successes": int, "episodes": int, "success_rate": float, "low": float, "high": float,
          "interval": str, "trainings": int, "spl": float, "soft_spl": float, "sim_s": float, "path_m": float,
          "contacts": float, "invalid_pixels": float, "failed_trials": int, "excluded_trials": int}
_COMPARISONS = {**_GROUP, "before": str, "after": str, "both": int, "only_after": int, "only_before": int,
                "neither": int, "dropped_pairs": int, "difference": float, "low": float, "high": float,
                "interval": str, "p": float, "p_holm": float, "verdict": str, "difference_spl": float,
                "difference_sim_s": float, "difference_path_m": float}


def import_pyarrow(module: str = "pyarrow") -> Any:
    """A module of pyarrow. Raises ImportError that says how it is installed."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError("this needs pyarrow: pip install 'fastsegsim[results]', or pyarrow") from error


def provenance(run: "Run") -> dict[str, Any]:
    """Where the numbers come from: versions, digests and the rule of success."""
    from fastsegsim.results.stored_run import SCHEMA_VERSION

    row = run.row
    return {"schema": SCHEMA, "results_schema_version": SCHEMA_VERSION, "run": row["name"], "run_id": row["run_id"],
            "seed": row["seed"], "code_version": row["code_version"], "success_profile": row["success_profile"],
            "spec_sha256": row["spec_sha256"],
            "scenes": {scene["name"]: {"scene_sha256": scene["scene_sha256"],
                                       "episodes_sha256": scene["episodes_sha256"]} for scene in run.scenes},
            "arms": {arm["name"]: {"weights_sha256": arm["weights_sha256"]} for arm in run.arms}}


def _time(text: str) -> datetime.datetime | None:
    return datetime.datetime.fromisoformat(text.replace("Z", "+00:00")) if text else None


def _column(name: str, kind: type, values: list[Any]) -> Any:
    pa = import_pyarrow()
    if name in _TIMES:
        return pa.array([_time(value) for value in values], pa.timestamp("s", "UTC"))
    if name in _WORDS:
        return pa.array(values, pa.string()).dictionary_encode()
    if name in _UNKNOWN_BELOW_ZERO:
        values = [None if value is None or value < 0 else value for value in values]
    if kind is float:
        return pa.array([None if value is None or value != value else float(value) for value in values], pa.float64())
    if kind is int:
        return pa.array(values, pa.uint64() if name == "state_hash" else pa.int64())
    return pa.array(values, pa.bool_() if kind is bool else pa.string())


def _table(rows: Iterable[dict[str, Any]], metadata: bytes, kinds: dict[str, type]) -> "pyarrow.Table":
    """Rows with the keys of `kinds` as a table."""
    pa = import_pyarrow()
    rows = list(rows)
    arrays, fields = [], []
    for name, kind in kinds.items():
        array = _column(name, kind, [row[name] for row in rows])
        unit = _UNITS.get(name.rsplit("_", 1)[-1]) if "_" in name else None
        arrays.append(array)
        fields.append(pa.field(name, array.type, metadata={"unit": unit} if unit else None))
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata={"segsim": metadata}))


def _stored_kinds(rows: list[dict[str, Any]], *without: str) -> dict[str, type]:
    """Of rows of the database, in which nothing but `_OF_HELD_OUT_VIEWS` is null."""
    return {name: float if name in _OF_HELD_OUT_VIEWS else type(value) for name, value in rows[0].items()
            if name not in without} if rows else {}


def _arm_row(arm: dict[str, Any]) -> dict[str, Any]:
    return arm if arm["held_out_views"] else {**arm, **dict.fromkeys(_OF_HELD_OUT_VIEWS)}


def _groups(summary: dict[str, Any]) -> Iterable[tuple[str, dict[str, Any]]]:
    for group in summary["scenes"]:
        yield "scene", group
    if "all" in summary:
        yield "all", summary["all"]
    for group in summary["classes"]:
        yield "class", group


def _interval(values: dict[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    [name] = [name for name in names if name in values]
    return {"low": values[name][0], "high": values[name][1], "interval": name}


def _rate_rows(summary: dict[str, Any]) -> Iterable[dict[str, Any]]:
    for kind, group in _groups(summary):
        for arm, values in group["arms"].items():
            yield {**values, "group": kind, "name": group["name"], "arm": arm, "success_rate": values["sr"],
                   **_interval(values, ("wilson95", "hierarchical95"))}


def _comparison_rows(summary: dict[str, Any]) -> Iterable[dict[str, Any]]:
    for kind, group in _groups(summary):
        if "comparison" in group:
            values = group["comparison"]
            means = {f"difference_{name}": mean["mean"] for name, mean in values["paired"].items()}
            yield {**values, **means, "group": kind, "name": group["name"], "before": summary["before"],
                   "after": summary["after"], **_interval(values, ("newcombe95", "hierarchical95"))}


def arrow_tables(run: "Run") -> "dict[str, pyarrow.Table]":
    """Name -> table; Run.arrow() describes them."""
    pa = import_pyarrow()
    metadata = json.dumps(provenance(run)).encode()
    names = pa.array([list(run.row["provenance"].items())], pa.map_(pa.string(), pa.string()))
    summary = summarise(run)
    trials = {name: _KINDS[column.dtype.kind] for name, column in run.trials.items()}
    of_run = _table([run.row], metadata, _stored_kinds([run.row], "provenance"))
    return {"run": of_run.append_column("provenance", names),
            "scenes": _table(run.scenes, metadata, _stored_kinds(run.scenes, "run_id", "position")),
            "arms": _table(map(_arm_row, run.arms), metadata, _stored_kinds(run.arms, "run_id", "position")),
            "trials": _table(run.trial_rows(), metadata, trials),
            "rates": _table(_rate_rows(summary), metadata, _RATES),
            "comparisons": _table(_comparison_rows(summary), metadata, _COMPARISONS)}


def write_parquet(run: "Run", folder: str | os.PathLike[str]) -> list[pathlib.Path]:
    """A file for each table; each appears under its name when it is complete."""
    parquet = import_pyarrow("pyarrow.parquet")
    place = pathlib.Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    files = []
    for name, table in arrow_tables(run).items():
        files.append(place / f"{name}.parquet")
        unfinished = place / f".{name}.parquet.{os.getpid()}"
        parquet.write_table(table, unfinished)
        unfinished.replace(files[-1])
    return files
