"""Tables of a run: as the program's JSON, and as Arrow."""

import json

import numpy as np
import pytest

from fastsegsim import results
from test_results import change, database  # noqa: F401 (a fixture)


def assert_in(mine, theirs, path=""):
    """All of `mine` is in the program's table, to the last digit."""
    if isinstance(mine, dict):
        for key, value in mine.items():
            assert key in theirs, f"{path}/{key}"
            assert_in(value, theirs[key], f"{path}/{key}")
    elif isinstance(mine, list):
        assert len(mine) == len(theirs), path
        for k, (one, other) in enumerate(zip(mine, theirs)):
            assert_in(one, other, f"{path}[{k}]")
    else:
        assert mine == theirs, path


def copy_rows(file, table, where, **changed):
    """Copies rows of a table with other values."""
    import sqlite3

    with sqlite3.connect(file) as connection:
        names = [row[1] for row in connection.execute(f"PRAGMA table_info({table})") if row[1] != "trial_id"]
        chosen = ", ".join(changed.get(name, name) for name in names)
        connection.execute(f"INSERT INTO {table} ({', '.join(names)}) SELECT {chosen} FROM {table} WHERE {where}")
    connection.close()


def make_harder(file):
    """Repetitions, trials that count in no rate, missing pairs, and values that differ from trial to trial."""
    change(file, "UPDATE trial SET spl = success * (1.0 / (1 + trial_id)), soft_spl = 0.3 / trial_id, "
           "sim_s = 20.1 + 1.7 * trial_id, path_m = 3.3 * (trial_id % 7) + 0.1, contacts = trial_id % 3, "
           "invalid_pixel_fraction = 0.001 * trial_id")
    copy_rows(file, "trial", "trial_id IN (2, 6, 7)", repetition="1", success="1 - success", sim_s="sim_s / 3")
    change(file, "UPDATE trial SET outcome = 'error' WHERE trial_id = 4",
           "UPDATE trial SET outcome = 'infeasible' WHERE trial_id = 5", "DELETE FROM trial WHERE trial_id = 8",
           "UPDATE trial SET goal_class = 'chair' WHERE trial_id > 12")


def add_scenes(file, scenes):
    for k in range(2, scenes + 1):
        copy_rows(file, "scene", "name = 'room'", name=f"'room{k}'", title=f"'Room {k}'", position=str(k), family="''")
        copy_rows(file, "trial", f"scene = 'room' AND trial_id % {k} != 0", scene=f"'room{k}'",
                  episode=f"'room{k}' || substr(episode, 5)", success=f"(success + trial_id % {k} + 1) % 2")


def add_trainings(file, trainings):
    change(file, "UPDATE arm SET finetune_seed = 1, weights_sha256 = 'aa' WHERE name = 'after'")
    for k in range(2, trainings + 1):
        copy_rows(file, "arm", "name = 'after'", name=f"'after.s{k}'", family="'after'", finetune_seed=str(k),
                  position=f"position + {k}")
        copy_rows(file, "trial", "arm = 'after'", arm=f"'after.s{k}'", success=f"(trial_id * {k} / 5) % 2",
                  spl=f"spl / {k}")


@pytest.mark.parametrize("scenes, trainings", [(1, 1), (2, 1), (6, 1), (1, 3), (6, 4)])
def test_a_table_is_the_programs_to_the_last_digit(database, segsim, scenes, trainings):  # noqa: F811
    make_harder(database)
    add_scenes(database, scenes)
    add_trainings(database, trainings)
    theirs = json.loads(segsim("table", database, "--format", "json"))
    mine = results.load_run(database).table()
    assert len(mine["scenes"]) == scenes and ("all" in mine) == (scenes > 1)
    assert ("hierarchical95" in mine["scenes"][0]["comparison"]) == (trainings > 1)
    assert_in(mine, theirs)
    swapped = results.load_run(database).table("after", "before")
    assert_in(swapped, json.loads(segsim("table", database, "--format", "json", "--before", "after",
                                         "--after", "before")))


def test_a_run_of_one_arm_has_no_comparison(database):  # noqa: F811
    change(database, "DELETE FROM trial WHERE arm = 'after'", "DELETE FROM arm WHERE name = 'after'")
    run = results.load_run(database)
    assert "comparison" not in run.table()["scenes"][0]
    with pytest.raises(ValueError, match="arm: expected one of before, found oracle"):
        run.table("before", "oracle")
    tables = pytest.importorskip("pyarrow") and run.arrow()
    assert tables["comparisons"].num_rows == 0 and "verdict" in tables["comparisons"].column_names


def test_arrow_tables_have_types_units_and_provenance(database):  # noqa: F811
    pa = pytest.importorskip("pyarrow")
    change(database, "UPDATE trial SET state_hash = 'fedcba9876543210', distance_to_goal_m = 1.5 WHERE trial_id = 1",
           "UPDATE run SET spec_sha256 = 'abc'")
    run = results.load_run(database)
    tables = run.arrow()
    assert list(tables) == ["run", "scenes", "arms", "trials", "rates", "comparisons"]
    trials = tables["trials"]
    assert trials.column_names == list(run.trials) and trials.num_rows == 20
    types = {field.name: field.type for field in trials.schema}
    assert types["success"] == pa.bool_() and types["ticks"] == pa.int64() and types["state_hash"] == pa.uint64()
    assert types["spl"] == types["distance_to_goal_m"] == pa.float64() and types["finished"] == pa.timestamp("s", "UTC")
    assert pa.types.is_dictionary(types["arm"]) and types["episode"] == pa.string()
    # What is not known is null; the rest comes as it was stored.
    assert trials["distance_to_goal_m"].null_count == 19 and trials["images"].null_count == 20
    assert trials["state_hash"][0].as_py() == 0xFEDCBA9876543210
    assert trials["arm"].to_pylist()[:2] == ["before", "after"]
    assert trials.schema.field("path_m").metadata == {b"unit": b"m"} and trials.schema.field("ticks").metadata is None
    assert tables["arms"].schema.field("unseen_ap50").type == pa.float64()
    for table in tables.values():
        said = json.loads(table.schema.metadata[b"segsim"])
        assert (said["schema"], said["results_schema_version"], said["spec_sha256"]) == ("segsim.arrow/1", 8, "abc")
        assert said["success_profile"] == run.row["success_profile"] and list(said["scenes"]) == ["room"]


def test_rates_are_those_of_the_table(database):  # noqa: F811
    pytest.importorskip("pyarrow")
    make_harder(database)
    run = results.load_run(database)
    scene = run.table()["scenes"][0]
    tables = run.arrow()
    first = tables["rates"].to_pylist()[0]
    assert (first["group"], first["name"], first["arm"]) == ("scene", "room", "before")
    assert [first["low"], first["high"]] == scene["arms"]["before"]["wilson95"] and first["interval"] == "wilson95"
    compared = tables["comparisons"].to_pylist()[0]
    assert compared["p"] == scene["comparison"]["p_mcnemar_exact"] and compared["after"] == "after"
    assert compared["difference_spl"] == scene["comparison"]["paired"]["spl"]["mean"]


def test_parquet_files_hold_the_tables(database, tmp_path):  # noqa: F811
    parquet = pytest.importorskip("pyarrow.parquet")
    run = results.load_run(database)
    files = run.to_parquet(tmp_path / "tables")
    assert sorted(tmp_path.joinpath("tables").iterdir()) == sorted(files)
    for file in files:
        table = run.arrow()[file.stem]
        read = parquet.read_table(file)
        assert read.to_pylist() == table.to_pylist() and read.column_names == table.column_names
        assert read.schema.metadata[b"segsim"] == table.schema.metadata[b"segsim"]


def test_data_frames_have_the_columns(database):  # noqa: F811
    pytest.importorskip("pandas")
    frames = results.load_run(database).pandas()
    by_arm = frames["trials"].groupby("arm", observed=True)["success"].sum()
    assert by_arm["after"] - by_arm["before"] == 6


def test_hierarchical_functions_take_columns():
    successes = np.array([1, 0, 1, 1, 1, 0])
    values = results.SeededValues([1] * 6, [0, 0, 0, 1, 1, 1], [0] * 6, [0, 1, 2, 0, 1, 2], successes)
    rate = results.hierarchical_rate_interval(values)
    assert rate.mean == pytest.approx(4 / 6) and 0 < rate.low < rate.mean < rate.high < 1
    assert results.hierarchical_interval(values).mean == pytest.approx(4 / 6)
    assert results.training_test(values).p <= 1.0
    one = results.SeededValues([1] * 4, [0] * 4, [0] * 4, range(4), [1, 1, 1, 0])
    np.testing.assert_allclose(results.hierarchical_rate_interval(one)[1:], results.wilson_interval(3, 4), rtol=1e-12)
    for wrong in (results.SeededValues([1], [0], [0], [0], [1, 0]),
                  results.SeededValues([1, 1], [0, 0], [0, 0], [0, 0], [1, 0])):
        with pytest.raises(ValueError, match="SeededValues: expected"):
            results.training_test(wrong)
