import json
import pathlib
import shutil
import sqlite3
import subprocess
import sys

import numpy as np
import pytest

import fastsegsim
from conftest import program_of
from fastsegsim import results


@pytest.fixture
def database(tmp_path):
    """Ten episodes in two arms, as C++ writes them: "after" gains seven and loses one."""
    file = tmp_path / "results.sqlite"
    subprocess.run([program_of("SEGSIM_SMALL_RESULTS"), file], check=True)
    return file


def change(file, *statements):
    with sqlite3.connect(file) as connection:
        for statement in statements:
            connection.execute(statement)
    connection.close()


def test_trials_are_columns_in_order(database):
    run = results.load_run(database.parent)
    assert (run.row["name"], run.row["planned_trials"], run.folder) == ("demo", 20, database.parent)
    assert [scene["name"] for scene in run.scenes] == ["room"]
    assert [arm["name"] for arm in run.arms] == ["before", "after"]
    trials = run.trials
    assert {len(column) for column in trials.values()} == {20}
    assert trials["arm"].tolist() == ["before", "after"] * 10
    assert trials["episode"][::2].tolist() == [f"room/couch/{k}" for k in range(10)]
    assert trials["success"].dtype == np.bool_ and trials["ticks"].dtype == np.int64
    assert trials["spl"].dtype == np.float64 and trials["state_hash"].dtype == np.uint64
    # No trial of this run was watched: what is not known has the values that C++ reads.
    assert np.all(np.isnan(trials["distance_to_goal_m"])) and np.all(trials["images"] == -1)
    assert set(trials["cause"]) == {""}
    rows = run.trial_rows()
    assert len(rows) == 20 and rows[1]["arm"] == "after" and rows[1]["success"] is True


def test_values_come_as_they_were_stored(database):
    change(database,
           "UPDATE trial SET state_hash = 'fedcba9876543210', spl = 0.25, distance_to_goal_m = 1.5 WHERE trial_id = 1",
           "INSERT INTO attribution VALUES "
           "(1, 'gave_up', 5, 4, 10, 7, 6, 2, 3, 1, 0, 1, 55, 0.5, NULL, 2.5, 0, 0, 0, 12, -1, 3, 'logs/1')")
    first = results.load_run(database).trial_rows()[0]
    assert (first["state_hash"], first["spl"], first["distance_to_goal_m"]) == (0xFEDCBA9876543210, 0.25, 1.5)
    assert (first["cause"], first["visible_frames"], first["stopped"], first["object_m"]) == ("gave_up", 10, True, 0.5)
    assert np.isnan(first["planar_m"]) and first["stop_views"] == 3


def test_figures_are_those_of_the_programs_table(database, segsim):
    # Three repetitions of an episode of which two fail, trials that count in no rate, and a pair that is not whole.
    with sqlite3.connect(database) as connection:
        names = [row[1] for row in connection.execute("PRAGMA table_info(trial)")]
    connection.close()
    columns = [name for name in names if name != "trial_id"]
    for repetition in (1, 2):
        values = {"repetition": str(repetition), "success": "0", "outcome": "'timeout'"}
        chosen = ", ".join(values.get(name, name) for name in columns)
        change(database, f"INSERT INTO trial ({', '.join(columns)}) SELECT {chosen} FROM trial WHERE trial_id = 2")
    change(database, "UPDATE trial SET outcome = 'error' WHERE trial_id = 4",
           "UPDATE trial SET outcome = 'infeasible' WHERE trial_id = 5",
           "DELETE FROM trial WHERE trial_id = 8")
    table = json.loads(segsim("table", database, "--format", "json"))
    run = results.load_run(database)
    [scene] = table["scenes"]
    for arm in ("before", "after"):
        successes, episodes = run.success_counts(arm)
        assert (successes, episodes) == (scene["arms"][arm]["successes"], scene["arms"][arm]["episodes"])
        interval = results.wilson_interval(successes, episodes)
        np.testing.assert_allclose(interval, scene["arms"][arm]["wilson95"], rtol=1e-9)
    counts = run.paired_counts("before", "after")
    compared = scene["comparison"]
    expected = {"both": compared["both"], "only_after": compared["only_after"], "only_before": compared["only_before"],
                "neither": compared["neither"]}
    assert counts._asdict() == expected
    assert sum(counts) == 7
    assert results.mcnemar_exact_p(counts.only_after, counts.only_before) == pytest.approx(compared["p_mcnemar_exact"])
    assert results.mcnemar_mid_p(counts.only_after, counts.only_before) == pytest.approx(compared["p_mcnemar_mid"])
    difference = results.newcombe_paired_difference(counts)
    assert difference.difference == pytest.approx(compared["difference"])
    np.testing.assert_allclose(difference.interval, compared["newcombe95"], rtol=1e-9)


def test_the_example_compares_arms_and_runs(database, tmp_path):
    program = pathlib.Path(__file__).resolve().parents[2] / "python/examples/compare_runs.py"

    def compare(*arguments):
        return subprocess.run([sys.executable, program, *map(str, arguments)], capture_output=True, text=True,
                              check=False)

    lines = compare(database).stdout.splitlines()
    counts = results.load_run(database).paired_counts("before", "after")
    successes, _ = results.load_run(database).success_counts("after")
    assert lines[0].startswith("before ") and f"{successes}/10 = " in lines[1]
    assert f"+{counts.only_after} -{counts.only_before} of 10 pairs, p = 0.070" in lines[2] and "couch" in lines[4]
    other = tmp_path / "other.sqlite"
    shutil.copy(database, other)
    assert compare(database, other, "--after", "before").stdout.splitlines()[2].split()[1] == "+0.0%"
    change(other, "UPDATE scene SET episodes_sha256 = 'cc'")
    assert "scene room: expected the same episodes, found others" in compare(database, other).stderr
    change(other, "UPDATE run SET success_profile = 'barn'")
    assert "success rule: expected" in compare(database, other).stderr


def test_runs_are_chosen_by_number(database):
    assert results.load_run(database, 1).row["run_id"] == 1
    with pytest.raises(fastsegsim.InputError, match="run_id: expected 1 to 1, found 2"):
        results.load_run(database, 2)
    with pytest.raises(fastsegsim.InputError, match="arm: expected one of before, after, found oracle"):
        results.load_run(database).success_counts("oracle")


def test_the_file_is_not_changed(database):
    before = database.read_bytes()
    results.load_run(database)
    assert database.read_bytes() == before


def test_the_module_itself_loads_a_run(database):
    loaded = fastsegsim.results(database)
    assert isinstance(loaded, results.Run)
    assert loaded.episode_successes("after") == results.load_run(database).episode_successes("after")


def test_what_is_no_database_of_results_is_refused(tmp_path, database):
    with pytest.raises(fastsegsim.InputError, match="none.sqlite: expected a results database, found none"):
        results.load_run(tmp_path / "none.sqlite")
    text = tmp_path / "text.sqlite"
    text.write_text("Not a database, but long enough to be taken for the header of one." * 20)
    with pytest.raises(fastsegsim.InputError, match="text.sqlite: expected a results database"):
        results.load_run(text)
    other = tmp_path / "other.sqlite"
    change(other, "CREATE TABLE t (x)")
    with pytest.raises(fastsegsim.InputError, match="found another SQLite database"):
        results.load_run(other)
    change(database, "UPDATE meta SET schema_version = 6")
    with pytest.raises(fastsegsim.InputError, match="expected schema version 8, found version 6 .* up to date"):
        results.load_run(database)
