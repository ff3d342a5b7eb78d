"""A run as it lies in results.sqlite: `segsim run` writes it, and this reads it without the program."""

import dataclasses
import os
import pathlib
import sqlite3
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fastsegsim._native import InputError
from fastsegsim.results import arrow_tables
from fastsegsim.results.statistics import PairedCounts
from fastsegsim.results.summary import NOT_COUNTED, summarise

if TYPE_CHECKING:
    import pandas
    import pyarrow

SCHEMA_VERSION = 8  # experiments/records/store.h

# Columns of `attribution` that a trial of an older version has no value for, and what it then has.
_UNKNOWN = {"images": -1, "misplaced_clouds": -1, "stop_views": -1, "first_true_tick": -1, "inevitable_tick": -1,
            "decisive_tick": -1, "cause": "", "log": "", "object_m": None, "planar_m": None, "shortest_object_m": None}
_BOOLEAN = ("success", "stopped")
_HEXADECIMAL = ("state_hash",)


def paired_counts(before: dict[Any, bool], after: dict[Any, bool]) -> PairedCounts:
    """The episodes of two arms, of one run or of two, that both ran: what Run.episode_successes() gives, compared."""
    pairs = [(before[key], after[key]) for key in before if key in after]
    return PairedCounts(both=pairs.count((True, True)), only_after=pairs.count((False, True)),
                        only_before=pairs.count((True, False)), neither=pairs.count((False, False)))


@dataclasses.dataclass(frozen=True)
class Run:
    """One run. Times in seconds (_s), milliseconds (_ms) or ticks, lengths in metres (_m); -1 ticks are "never"."""

    folder: pathlib.Path  #: Of the database; pictures, logs and tracks are named relative to it.
    row: dict[str, Any]  #: Of the run itself: name, title, seed, spec_text, ...; "provenance" is a dict.
    scenes: list[dict[str, Any]]
    arms: list[dict[str, Any]]
    #: A column of the trials each, all of one length, ordered by scene, episode, repetition and arm. Whole numbers are
    #: int64 (state_hash: uint64), others float64 with NaN where there is none, texts str.
    trials: dict[str, NDArray[Any]]

    def trial_rows(self) -> list[dict[str, Any]]:
        """The same, a dict for each trial."""
        names = list(self.trials)
        return [dict(zip(names, values)) for values in zip(*(column.tolist() for column in self.trials.values()))]

    def episode_successes(self, arm: str) -> dict[tuple[str, str, str], bool]:
        """(scene, episode, goal class) -> success of an arm in the episodes that enter its rate.

        An episode of several repetitions is a success if more than half of them are. Scenes count by their family, so
        that reconstructions of one scene share its name. Raises InputError if there is no such arm.
        """
        names = [row["name"] for row in self.arms]
        if arm not in names:
            raise InputError(f"arm: expected one of {', '.join(names)}, found {arm}")
        families = {row["name"]: row["family"] or row["name"] for row in self.scenes}
        t = self.trials
        counted = (t["arm"] == arm) & ~np.isin(t["outcome"], NOT_COUNTED)
        tallies: dict[tuple[str, str, str], list[int]] = {}
        columns = (t[name][counted].tolist() for name in ("scene", "episode", "goal_class", "success"))
        for scene, episode, goal_class, success in zip(*columns):
            tally = tallies.setdefault((families.get(scene, scene), episode, goal_class), [0, 0])
            tally[0] += success
            tally[1] += 1
        return {key: 2 * successes > trials for key, (successes, trials) in tallies.items()}

    def success_counts(self, arm: str) -> tuple[int, int]:
        """Successes and episodes of an arm: the rate that `segsim table` gives."""
        outcomes = self.episode_successes(arm).values()
        return sum(outcomes), len(outcomes)

    def paired_counts(self, before: str, after: str) -> PairedCounts:
        """The episodes that both arms ran, by the outcomes of the two."""
        return paired_counts(self.episode_successes(before), self.episode_successes(after))

    def table(self, before: str = "", after: str = "") -> dict[str, Any]:
        """Rates, intervals and tests: what the JSON of `segsim table` has under the same keys, to the last digit.

        before, after: arms to compare; by default those that the program compares. Several trainings of an arm count as
        there, too. Returns "before", "after", "scenes", "all" (of several scenes) and "classes"; a group has "name",
        "title", "arms" and, of two arms, "comparison".
        """
        return summarise(self, before, after)

    def arrow(self) -> "dict[str, pyarrow.Table]":
        """The run as Arrow tables: "run", "scenes", "arms", "trials", "rates", "comparisons" (docs/python_results.md).

        Null is what is not known. The metadata "segsim" of each is JSON: schema, digests, rule of success. Needs
        pyarrow.
        """
        return arrow_tables.arrow_tables(self)

    def pandas(self) -> "dict[str, pandas.DataFrame]":
        """The same as data frames. Needs pandas, too."""
        return {name: table.to_pandas() for name, table in self.arrow().items()}

    def to_parquet(self, folder: str | os.PathLike[str]) -> list[pathlib.Path]:
        """Write the tables of arrow() as `<folder>/<name>.parquet`, and return the files."""
        return arrow_tables.write_parquet(self, folder)


def load_run(path: str | os.PathLike[str], run_id: int = 0) -> Run:
    """Read one run.

    path: work folder of `segsim run`, or a results database. It is only read, also while a run writes to it.
    run_id: number of the run; 0 is the last.
    Raises InputError if there is no database or no such run, or if its version is another one.
    """
    file = pathlib.Path(path)
    if file.is_dir():
        file = file / "results.sqlite"
    if not file.exists():
        raise InputError(f"{file}: expected a results database, found none")
    try:
        connection = sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro", uri=True)
        try:
            connection.row_factory = sqlite3.Row
            connection.execute("BEGIN")  # All that follows sees one state.
            _check_version(connection, file)
            return _read_run(connection, file, run_id)
        finally:
            connection.close()
    except sqlite3.DatabaseError as error:
        raise InputError(f"{file}: expected a results database, found {error}") from error


def _check_version(connection: sqlite3.Connection, file: pathlib.Path) -> None:
    if not connection.execute("SELECT COUNT(*) FROM sqlite_master WHERE name = 'meta'").fetchone()[0]:
        raise InputError(f"{file}: expected a results database of segsim, found another SQLite database")
    version = connection.execute("SELECT schema_version FROM meta").fetchone()[0]
    if version != SCHEMA_VERSION:
        help_text = " (`segsim table` brings it up to date)" if version < SCHEMA_VERSION else ""
        raise InputError(f"{file}: expected schema version {SCHEMA_VERSION}, found version {version}{help_text}")


def _read_run(connection: sqlite3.Connection, file: pathlib.Path, run_id: int) -> Run:
    rows = _rows(connection, "SELECT * FROM run ORDER BY run_id")
    if not rows:
        raise InputError(f"{file}: expected a run, found none")
    chosen = [row for row in rows if row["run_id"] == run_id] if run_id else rows[-1:]
    if not chosen:
        raise InputError(f"run_id: expected 1 to {rows[-1]['run_id']}, found {run_id}")
    row = chosen[0]
    of_run = (row["run_id"],)
    provenance = connection.execute("SELECT name, value FROM provenance WHERE run_id = ?", of_run)
    row["provenance"] = {name: value for name, value in provenance}
    scenes = _rows(connection, "SELECT * FROM scene WHERE run_id = ? ORDER BY position", of_run)
    arms = _rows(connection, "SELECT * FROM arm WHERE run_id = ? ORDER BY position", of_run)
    return Run(file.parent, row, scenes, arms, _trials(connection, of_run, scenes, arms))


def _rows(connection: sqlite3.Connection, sql: str, values: tuple[Any, ...] = ()) -> list[dict[str, Any]]:
    return [dict(row) for row in connection.execute(sql, values)]


def _trials(connection: sqlite3.Connection, of_run: tuple[Any, ...], scenes: list[dict[str, Any]],
            arms: list[dict[str, Any]]) -> dict[str, NDArray[Any]]:
    types = {row["name"]: row["type"] for table in ("trial", "attribution")
             for row in connection.execute(f"PRAGMA table_info({table})")}
    del types["run_id"]
    names = list(types)
    sql = f"SELECT {', '.join(names)} FROM trial LEFT JOIN attribution USING (trial_id) WHERE run_id = ?"
    rows = connection.execute(sql, of_run).fetchall()
    scene_positions = {scene["name"]: k for k, scene in enumerate(scenes)}
    arm_positions = {arm["name"]: k for k, arm in enumerate(arms)}
    rows.sort(key=lambda t: (scene_positions.get(t["scene"], -1), t["episode"].encode(), t["repetition"],
                             arm_positions.get(t["arm"], -1), t["trial_id"]))
    return {name: _column(name, types[name], [row[name] for row in rows]) for name in names}


def _column(name: str, sql_type: str, values: list[Any]) -> NDArray[Any]:
    if name in _HEXADECIMAL:
        return np.array([int(value, 16) for value in values], np.uint64)
    if sql_type == "REAL":
        return np.array(values, np.float64)  # None becomes NaN.
    unknown = _UNKNOWN.get(name, 0 if sql_type == "INTEGER" else "")
    known = [unknown if value is None else value for value in values]
    if name in _BOOLEAN:
        return np.array(known, np.bool_)
    return np.array(known, np.int64 if sql_type == "INTEGER" else np.str_)
