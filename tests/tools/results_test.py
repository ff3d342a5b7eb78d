#!/usr/bin/env python3
"""Of tools/results: what is refused and how that is said, what pages say, and that `check` sees every difference."""
import contextlib
import copy
import io
import json
import os
import pathlib
import shutil
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools" / "results"))

import figures  # noqa: E402
import headline  # noqa: E402
import pages  # noqa: E402
from record import BadRecord, is_held, read_record, record_text, write_record  # noqa: E402
from run_record import keep_words, run_record  # noqa: E402


def load_tool():
    import importlib.util
    spec = importlib.util.spec_from_file_location("results_tool", ROOT / "tools" / "results" / "__main__.py")
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    return tool


TOOL = load_tool()
RECORD = {"schema": "segsim.record/1", "title": "Frames", "command": "segsim bench render", "commit": "0123abc",
          "date": "2026-01-02", "machine": {"processor": "CPU", "cores": 2, "gpu": None}, "note": ["What it means."],
          "values": [{"case": "small", "name": "median", "unit": "ms", "value": 3.5, "goal": {"at_most": 4}},
                     {"case": "large", "name": "median", "unit": "ms", "value": 7.25, "goal": {"at_most": 7, "aim": 5}},
                     {"case": "large", "name": "success", "unit": "%", "value": 87.5, "count": [35, 40],
                      "interval95": [74, 95]}]}


class Files(unittest.TestCase):
    def setUp(self):
        self.root = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.root)

    def path(self, *parts):
        path = os.path.join(self.root, *parts)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        return path

    def put(self, text, *parts):
        with open(self.path(*parts), "w") as file:
            file.write(text)

    def text(self, *parts):
        with open(self.path(*parts)) as file:
            return file.read()


class Records(Files):
    def refused(self, change):
        record = copy.deepcopy(RECORD)
        change(record)
        self.put(json.dumps(record), "r.json")
        with self.assertRaises(BadRecord) as caught:
            read_record(self.path("r.json"))
        message = str(caught.exception)
        self.assertNotIn("\n", message)
        self.assertIn("r.json", message)
        return message

    def test_a_good_record_is_read_as_it_was_written(self):
        write_record(self.path("r.json"), RECORD)
        self.assertEqual(json.loads(self.text("r.json")), RECORD)
        self.assertEqual(record_text(read_record(self.path("r.json"))), self.text("r.json"))

    def test_what_is_wrong_is_said_with_its_place(self):
        for change, words in (
                (lambda r: r.pop("commit"), '"commit" (null where it was not recorded)'),
                (lambda r: r.update(held=True), 'found "held"'),
                (lambda r: r.update(commit="main"), "a hash of 7 to 40 digits or null, found \"main\""),
                (lambda r: r.update(date="yesterday"), "YYYY-MM-DD or null"),
                (lambda r: r["machine"].update(cores=0), "machine.cores"),
                (lambda r: r.update(not_recorded={"note": "It was lost."}), "a sentence for some of command, commit"),
                (lambda r: r.update(not_recorded={"machine": ""}), "not_recorded: expected a sentence"),
                (lambda r: r["values"][0].pop("unit"), "values[0]: expected \"unit\""),
                (lambda r: r["values"][1].update(value=[1]), "values[1].value: expected a number"),
                (lambda r: r["values"][0].update(held=True), "values[0]: expected the keys"),
                (lambda r: r["values"][0]["goal"].update(at_least=1), "one of at_most, at_least, is"),
                (lambda r: r["values"][0].update(value="fast"), "a goal only for a number"),
                (lambda r: r["values"][0].update(runs=[1, 2, 9]), "the median 2 of the runs, found 3.5"),
                (lambda r: r["values"][2].update(count=[3, 40]), "7.50 with the unit %, as counted"),
                (lambda r: r["values"][2].update(interval95=[95, 74]), "[low, high]"),
                (lambda r: r["values"].append(dict(r["values"][0])), "another table, case or name")):
            with self.subTest(words):
                self.assertIn(words, self.refused(change))

    def test_broken_json_is_said_with_its_line(self):
        self.put('{\n "schema": 1,,\n}', "r.json")
        with self.assertRaisesRegex(BadRecord, r"r\.json:2: "):
            read_record(self.path("r.json"))

    def test_whether_a_goal_is_held(self):
        for goal, value, held in (({"at_most": 4}, 4, True), ({"at_most": 4}, 4.1, False), ({"at_least": 4}, 4, True),
                                  ({"at_least": 4}, 3.9, False), ({"is": True}, True, True), ({"is": True}, False, False),
                                  ({"is": 0}, 1, False), ({"at_most": 4}, None, None)):
            with self.subTest(goal=goal, value=value):
                self.assertIs(is_held({"goal": goal, "value": value}), held)

    def test_a_new_measurement_keeps_words_and_goals(self):
        new = copy.deepcopy(RECORD)
        new.update(title="as the program calls it", note=[], commit="fffffff")
        old = {**RECORD, "commit": None, "not_recorded": {"commit": "It was lost."}}
        new["values"] = [{"case": "small", "name": "median", "unit": "ms", "value": 9}]
        write_record(self.path("old.json"), old)
        write_record(self.path("new.json"), new)
        with contextlib.redirect_stdout(io.StringIO()) as out:
            TOOL.take([self.path("new.json")], self.path("old.json"))
        taken = read_record(self.path("old.json"))
        self.assertEqual((taken["title"], taken["note"], taken["commit"]), ("Frames", ["What it means."], "fffffff"))
        self.assertNotIn("not_recorded", taken)
        self.assertEqual(taken["values"], [{**new["values"][0], "goal": {"at_most": 4}}])
        self.assertIn("small: median: 9 ms", out.getvalue())
        self.assertIn("large: median: gone, and its goal with it\n", out.getvalue())
        self.assertIn("large: success: gone\n", out.getvalue())
        new["values"][0]["goal"] = {"at_most": 8}
        self.assertEqual(keep_words(new, RECORD)["values"][0]["goal"], {"at_most": 8})

    def test_records_of_several_commands_are_joined(self):
        second = {**copy.deepcopy(RECORD), "command": "segsim bench render --size 1x1",
                  "values": [{"case": "tiny", "name": "median", "unit": "ms", "value": 1}]}
        for name, record in (("a.json", RECORD), ("b.json", second)):
            write_record(self.path(name), record)
        with contextlib.redirect_stdout(io.StringIO()):
            TOOL.take([self.path("a.json"), self.path("b.json")], self.path("both.json"))
        both = read_record(self.path("both.json"))
        self.assertEqual(both["command"], ["segsim bench render", "segsim bench render --size 1x1"])
        self.assertEqual(len(both["values"]), 4)
        write_record(self.path("b.json"), {**second, "commit": "fffffff"})
        with self.assertRaisesRegex(BadRecord, "b.json: commit: expected that of"):
            TOOL.take([self.path("a.json"), self.path("b.json")], self.path("both.json"))


class Pages(Files):
    def setUp(self):
        super().setUp()
        write_record(self.path("results", "speed", "frames.json"), RECORD)
        self.put('{"schema": "segsim.subject/1", "title": "Speed", "note": ["Of frames."], "records": ["frames"]}',
                 "results", "speed", "index.json")
        self.put('{"subjects": ["speed"], "limits": ["It is slow."]}', "results", "index.json")
        self.put("docs/a.md: 8 ms\n", "results", "specified_figures.txt")
        self.put("# First\n", "README.md")
        self.put("Before.\n\n<!-- record: speed/frames -->\n<!-- end of record -->\n\nThe limit is 8 ms.\n", "docs", "a.md")
        self.quiet(TOOL.write)

    def quiet(self, function):
        with contextlib.redirect_stdout(io.StringIO()):
            function(self.root)

    def faults(self):
        try:
            TOOL.check(self.root)
        except SystemExit as stop:
            return str(stop.code)
        return ""

    def test_a_percentage_needs_a_record_too_and_a_quoted_record_must_have_it(self):
        self.put("It turns 9 % further.\n", "docs", "b.md")
        self.assertIn("docs/b.md:1: 9 %: a figure without a record", self.faults())
        allowed = self.text("results", "specified_figures.txt")
        self.put(allowed + "docs/b.md: 9 %\n", "results", "specified_figures.txt")
        self.assertEqual(self.faults(), "")
        self.put(allowed + "docs/b.md: 9 % (speed/frames)\n", "results", "specified_figures.txt")
        self.assertIn("docs/b.md: 9 %: expected a record results/speed/frames.json that has this number", self.faults())
        self.put(allowed + "docs/b.md: 9 % (speed/none)\n", "results", "specified_figures.txt")
        self.assertIn("expected a record results/speed/none.json", self.faults())
        self.put("It succeeds in 87.5 % of all cases.\n", "docs", "b.md")
        self.put(allowed + "docs/b.md: 87.5 % (speed/frames)\n", "results", "specified_figures.txt")
        self.assertEqual(self.faults(), "")

    def test_a_record_of_what_nobody_can_check_out_is_named(self):
        def recorded(commit):
            write_record(self.path("results", "speed", "frames.json"), {**RECORD, "commit": commit})
            self.quiet(TOOL.write)
            return self.faults()

        self.assertIn("frames.json: commit: expected one of this history", recorded("0123abc-dirty"))
        self.assertEqual(recorded("0123abc"), "")  # No history to look in.
        for arguments in (["init", "-q"], ["add", "-A"],
                          ["-c", "user.name=n", "-c", "user.email=n@e", "commit", "-q", "-m", "first"]):
            self.assertEqual(TOOL.git(self.root, *arguments).returncode, 0)
        self.assertIn("with nothing changed after it, found 0123abc", recorded("0123abc"))
        self.assertEqual(recorded(TOOL.git(self.root, "rev-parse", "--short", "HEAD").stdout.strip()), "")

    def test_what_was_not_recorded_needs_a_sentence(self):
        def found(**change):
            write_record(self.path("results", "speed", "frames.json"), {**RECORD, **change})
            self.quiet(TOOL.write)
            return self.faults()

        place = "results/speed/frames.json: not_recorded: expected a sentence for each of "
        cores_alone = {"processor": None, "cores": 2, "gpu": None}
        for change, lacking in (({"command": None}, "command"), ({"commit": None}, "commit"), ({"date": None}, "date"),
                                ({"machine": cores_alone}, "machine")):
            with self.subTest(lacking):
                self.assertEqual(found(**change), f"{place}['{lacking}'], found []")
                self.assertEqual(found(**change, not_recorded={lacking: "It was lost."}), "")
        self.assertEqual(found(not_recorded={"commit": "It was lost."}), f"{place}[], found ['commit']")
        self.assertEqual(found(machine={**cores_alone, "gpu": "GPU"}), "")
        columns = [{"case": "large", "name": name, "unit": "", "value": "A"} for name in ("commit", "machine")]
        self.assertEqual(found(commit=None, machine=cores_alone, values=RECORD["values"] + columns), "")
        self.assertIn("Commits in the table; 2026-01-02; machines in the table, 2 cores.",
                      self.text("docs", "results", "speed.md"))

    def test_what_was_written_is_accepted_and_written_again_alike(self):
        before = self.text("docs", "results", "speed.md")
        self.quiet(TOOL.write)
        self.assertEqual(self.text("docs", "results", "speed.md"), before)
        self.assertEqual(self.faults(), "")

    def test_pages_say_what_was_measured_and_whether_goals_are_held(self):
        page = self.text("docs", "results", "speed.md")
        self.assertIn("| small | 3.5 | at most 4: held |  |", page)
        self.assertIn("| large | 7.25 | at most 7 (aim: 5): **missed**, aim missed | 35/40 = 88 % [74, 95] |", page)
        self.assertIn("Commit 0123abc; 2026-01-02; CPU, 2 cores.", page)
        self.assertIn("1 held, 1 missed", self.text("docs", "goals.md"))
        self.assertIn("| Frames | large: median | 7.25 ms | at most 7 ms (aim: 5) | **missed**, aim missed |",
                      self.text("docs", "goals.md"))
        self.assertIn("| small | 3.5 |", self.text("docs", "a.md"))
        self.assertIn("- It is slow.", self.text("docs", "results.md"))

    def test_every_page_that_departs_from_its_records_is_named(self):
        for page in ("docs/results/speed.md", "docs/goals.md", "docs/results.md", "docs/a.md"):
            with self.subTest(page):
                text = self.text(page)
                self.put(text.replace("7", "6").replace("slow", "fast"), page)
                self.assertIn(f"{page}: not what its records say", self.faults())
                self.put(text, page)
        record = copy.deepcopy(RECORD)
        record["values"][0]["value"] = 3.6
        write_record(self.path("results", "speed", "frames.json"), record)
        for page in ("docs/results/speed.md", "docs/goals.md", "docs/a.md"):
            self.assertIn(page, self.faults())

    def test_what_was_not_recorded_is_said(self):
        record = {**RECORD, "commit": None, "date": None, "command": None,
                  "machine": {"processor": None, "cores": None, "gpu": None}}
        text = pages.record_section(record, 2)
        self.assertIn("Commit not recorded; date not recorded; machine not recorded.", text)
        self.assertIn("The command was not recorded.", text)
        text = pages.record_section({**record, "not_recorded": {"command": "It was lost.", "date": "Nobody knew."}}, 2)
        self.assertIn("The command was not recorded. It was lost. Nobody knew.", " ".join(text.split()))

    def test_a_record_that_no_index_names_is_refused(self):
        write_record(self.path("results", "speed", "other.json"), RECORD)
        with self.assertRaisesRegex(BadRecord, "every record of the folder once: frames, other"):
            TOOL.check(self.root)

    def test_an_unknown_marker_is_refused(self):
        self.put("<!-- record: speed/none -->\n<!-- end of record -->\n", "docs", "b.md")
        with self.assertRaisesRegex(BadRecord, "docs/b.md: expected a record of results/, found speed/none"):
            TOOL.check(self.root)

    def test_a_page_without_a_subject_is_named(self):
        self.put("x", "docs", "results", "old.md")
        self.assertIn("docs/results/old.md", self.faults())

    def test_figures_without_a_record_are_found(self):
        self.put("It takes 3.1 ms, or 1 250 images/s and 26.4 dB.\nPQ 80.1 is good.\n\n    sleep 5 ms\n\n`9 ms` is a key.\n",
                 "docs", "b.md")
        self.assertEqual([line.split(": a figure")[0] for line in self.faults().split("\n")],
                         ["docs/b.md:1: 3.1 ms", "docs/b.md:1: 1 250 images/s", "docs/b.md:1: 26.4 dB",
                          "docs/b.md:2: PQ 80.1"])
        self.assertEqual(list(figures.figures_without_record(self.root, ["docs/a.md"])), [])


def arm(successes, episodes, trainings=1):
    profile = {"sr": successes / episodes, "spl": 0.5}
    interval = "hierarchical95" if trainings > 1 else "wilson95"
    return {"successes": successes, "episodes": episodes, "sr": successes / episodes, interval: [0.25, 0.75], "spl": 0.5,
            "soft_spl": 0.5, "sim_s": 30.25, "path_m": 12, "contacts": 0, "invalid_pixels": 0.001,
            "outcomes": {"timeout": episodes - successes, "success": successes}, "causes": {"stuck": episodes - successes},
            "perception": {"frames": 200, "visible_frames": 0, "detected_frames": 0, "saw_goal": 1, "never_detected": 0,
                           "false_detections": 3, "false_objects_per_trial": 0.5},
            "profiles": {"segsim-object": profile, "habitat-hm3d": profile}}


def detector(seed):
    return {"weights_sha256": f"{seed}" * 64, "tuning_views": {"near_starts": seed},
            "held_out": {"views": 9, "ap50": 0.1 * seed, "ap": 0.1, "precision": 0.5, "recall": 0.5, "score_threshold": 0.2}}


def run_table():
    paired = {"mean": 0.25, "hierarchical95": [0.1, 0.4], "p_trainings": 0.01}
    comparison = {"only_after": 5, "only_before": 1, "difference": 0.4, "hierarchical95": [0.1, 0.7], "p_trainings": 0.0123,
                  "p_holm": 0.5, "paired": {"spl": paired, "sim_s": paired, "path_m": paired}}
    group = {"title": "Flat 9", "comparison": comparison,
             "arms": {"before": arm(4, 10), "after": arm(16, 20, 2), "oracle": arm(10, 10)}}
    training = {"before": "before", "episodes": 10, "only_before": 1}
    return {"title": "A run", "before": "before", "after": "after", "oracle": "oracle", "scenes": [group], "classes": [group],
            "training_rate_sd": 0.05, "stop_region": {"radius_m": 0.5, "successes": 16, "near_views": 9, "mean_views": 3.14159},
            "trainings": [{**training, "arm": "after", "seed": 2, "successes": 7, "sr": 0.7, "only_after": 4},
                          {**training, "arm": "after.s3", "seed": 3, "successes": 9, "sr": 0.9, "only_after": 6}],
            "provenance": {"arms": {"before": detector(1), "after": detector(2), "after.s3": detector(3)},
                           "code_version": "0.1.0 (0123abc)", "ended": "2026-01-02T03:04:05Z", "host": "name, AMD EPYC",
                           "success_profile": "segsim-object: near", "spec_sha256": "ab" * 32}}


class Runs(Files):
    def setUp(self):
        super().setUp()
        self.put(json.dumps(run_table()), "table.json")
        digests = {"experiment": "flat", "machine": {"kernels": "reproducible"}, "confirmed_on": ["AMD EPYC"],
                   "stages": [{"stage": "weights", "subject": "arm-after", "sha256": "11" * 32},
                              {"stage": "trials", "subject": "all", "sha256": "cd" * 32}]}
        self.put(json.dumps(digests), "digests.json")
        self.put(json.dumps(digests), "experiments", "specs", "digests", "flat.json")
        write_record(self.path("run.json"), run_record(self.root, "segsim run flat.yaml"))
        self.record = read_record(self.path("run.json"))

    def value(self, table, case, name):
        return next(v for v in self.record["values"] if (v.get("table"), v.get("case"), v["name"]) == (table, case, name))

    def test_figures_are_those_of_the_table(self):
        self.assertEqual(self.record["commit"], "0123abc")
        self.assertEqual(self.record["machine"]["processor"], "AMD EPYC")
        after = self.value("Success", "Flat 9", "after")
        self.assertEqual((after["count"], after["interval95"]), ([16, 20], [25, 75]))
        self.assertEqual(float(self.value("Success", "Flat 9", "p")["value"]), 0.012)
        self.assertEqual(float(self.value("By goal class", "Flat 9", "p (Holm)")["value"]), 0.5)
        leakage = [float(v["value"]) for v in self.record["values"] if v.get("table") == "Leakage by view"]
        self.assertEqual(leakage, [9, 16, 3.14])
        self.assertEqual(self.value("Why trials failed", "Flat 9, before", "stuck")["value"], 6)
        self.assertEqual(self.value("How the trials went", "Flat 9, after", "outcomes")["value"], "success 16, timeout 4")
        self.assertEqual(self.record["facts"]["SHA-256 of all trials"], "cd" * 32)

    def test_the_first_page_says_what_came_out(self):
        text = headline.headline_text(self.root, [self.record])
        self.assertIn("| Flat 9 | 40 % [25, 75] | **80 % [25, 75]** | +40 [+10, +70] | 0.012 | 100 % | 40 %, 80 %, 100 % |", text)
        words = " ".join(text.split())
        self.assertIn("7, 9 of 10 episodes succeed, before 4: 2 of 2 trainings are better, the median gain is +40 points", words)
        self.assertIn("goes from 10 to 20 ... 30 (median 25). `flat.yaml` as shipped makes those with seed 2: 7 of 10 "
                      "episodes. 5 training views lie near a start", words)
        self.assertIn("trials cdcdcdcdcdcd (found on: AMD EPYC)", words)


class Numbers(unittest.TestCase):
    def test_numbers_are_shown_as_recorded(self):
        for number, unit, text in ((18000, "", "18 000"), (1517, "", "1517"), (0.659, "ms", "0.659"), (30.0, "", "30.0"),
                                   (7e-06, "", "7.0e-6"), (40.75, "%", "40.8"), (0.5522956, "", "0.5523"), (-0.3, "", "-0.3")):
            with self.subTest(number=number):
                self.assertEqual(pages.number_text(number, unit), text)


if __name__ == "__main__":
    unittest.main()
