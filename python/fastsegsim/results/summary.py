"""The rates and comparisons of `segsim table`, from the trials: the same keys and the same numbers as its JSON.

Left out is what a table says beyond them: causes, perception, other success rules, leakage and notes.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fastsegsim._native import InputError
from fastsegsim.results.statistics import (Interval, PairedCounts, PairedDifference, bootstrap_mean,
                                           clopper_pearson_interval, cluster_bootstrap_mean, holm_correction,
                                           mcnemar_exact_p, mcnemar_mid_p, newcombe_paired_difference, sign_flip_p,
                                           verdict, wilson_interval)
from fastsegsim.results.training_statistics import (SeededValues, hierarchical_interval, hierarchical_rate_interval,
                                                    training_test)

if TYPE_CHECKING:
    from fastsegsim.results.stored_run import Run

NOT_COUNTED = ("error", "infeasible", "trivial")  # Outcomes that enter no rate.
_MEANS = ("spl", "soft_spl", "sim_s", "path_m")  # Of an episode: over its repetitions.
_TRIAL_MEANS = {"sim_s": "sim_s", "path_m": "path_m", "contacts": "contacts",
                "invalid_pixels": "invalid_pixel_fraction"}
_PAIRED = ("spl", "sim_s", "path_m")


@dataclasses.dataclass
class _Cell:
    """What one row of arms made of one episode."""

    trials: list[dict[str, Any]] = dataclasses.field(default_factory=list)

    def finish(self) -> None:
        counted = [t for t in self.trials if t["outcome"] not in NOT_COUNTED]
        self.usable = len(counted)
        self.success = 2 * sum(t["success"] for t in counted) > self.usable
        self.means = {name: sum(t[name] for t in counted) / max(1, self.usable) for name in _MEANS}


class _Episode(NamedTuple):
    scene: str
    goal_class: str
    cells: list[_Cell]  # By row of arms.


class _Pair(NamedTuple):
    before: int  # Rows of arms.
    after: int
    reconstruction: int
    training: int


class _Seeded:
    """Values by training, scene and episode."""

    def __init__(self) -> None:
        self.rows: list[tuple[int, int, int, int, float]] = []

    def values(self) -> SeededValues:
        return SeededValues(*(zip(*self.rows) if self.rows else [[]] * 5))

    def numbers(self) -> list[float]:
        return [row[4] for row in self.rows]


class _Inputs:
    """The trials of a run by episode and row of arms."""

    def __init__(self, run: "Run") -> None:
        self.arms = run.arms
        self.families: dict[str, list[int]] = {}
        for row, arm in enumerate(run.arms):
            self.families.setdefault(arm["family"] or arm["name"], []).append(row)
        self.scenes: dict[str, str] = {}  # Family -> title, in the order of the run.
        family_of = {}
        for scene in run.scenes:
            family_of[scene["name"]] = scene["family"] or scene["name"]
            self.scenes.setdefault(family_of[scene["name"]], scene["title"])
        rows = {arm["name"]: row for row, arm in enumerate(run.arms)}
        positions = {family: k for k, family in enumerate(self.scenes)}
        found: dict[tuple, _Episode] = {}
        for trial in run.trial_rows():
            if trial["arm"] not in rows:
                continue
            scene = family_of.get(trial["scene"], "")
            key = (trial["episode"].encode(), positions.get(scene, len(positions)), trial["goal_class"].encode())
            episode = found.setdefault(key, _Episode(scene, trial["goal_class"], [_Cell() for _ in run.arms]))
            episode.cells[rows[trial["arm"]]].trials.append(trial)
        self.episodes = [found[key] for key in sorted(found)]  # Sums have the order of the program's.
        self.scene_positions = positions
        for episode in self.episodes:
            for cell in episode.cells:
                cell.finish()

    def training_number(self, family: list[int], row: int) -> int:
        """Of a row among those of its arm in the same reconstruction."""
        mine = self.arms[row]["reconstruction"]
        return sum(self.arms[other]["reconstruction"] == mine for other in family[:family.index(row)])

    def pairs(self, before: str, after: str) -> list[_Pair]:
        """Rows that are compared: of one reconstruction, and where both arms have trainings of one seed."""
        first, second = self.families[before], self.families[after]
        pairs = []
        for reconstruction in sorted({self.arms[row]["reconstruction"] for row in second}):
            of_first = [r for r in first if self.arms[r]["reconstruction"] == reconstruction]
            of_second = [r for r in second if self.arms[r]["reconstruction"] == reconstruction]
            training = 0
            for a in of_first:
                for b in of_second:
                    same_seed = self.arms[a]["finetune_seed"] == self.arms[b]["finetune_seed"]
                    if len(of_first) > 1 and len(of_second) > 1 and not same_seed:
                        continue
                    pairs.append(_Pair(a, b, reconstruction, training))
                    training += 1
        if not pairs:
            raise InputError(f"arms {before} and {after}: expected trainings of the same reconstructions and seeds, "
                             "found none")
        return pairs

    def compared_arms(self, before: str, after: str) -> tuple[str, str]:
        """The names of two arms; where none are given those that a table compares, or empty ones."""
        for name in filter(None, (before, after)):
            names = [arm["name"] for arm in self.arms]
            if name not in self.families and name in names:
                self.families[name] = [names.index(name)]  # One training of an arm.
            if name not in self.families:
                raise InputError(f"arm: expected one of {', '.join(names)}, found {name}")
        chosen = [f for f, rows in self.families.items() if self.arms[rows[0]]["detector"] != "oracle"][:2]
        if "before" in self.families and "after" in self.families:
            chosen = ["before", "after"]
        default = chosen if len(chosen) == 2 else ["", ""]
        return before or default[0], after or default[1]


def _interval(found: Sequence[Any]) -> list[float]:
    return [float(found[0]), float(found[1])]


def _arm_summary(inputs: _Inputs, family: list[int], episodes: list[_Episode]) -> dict[str, Any]:
    successes = count = 0
    sums = dict.fromkeys(("spl", "soft_spl"), 0.0)
    trial_sums = dict.fromkeys(_TRIAL_MEANS, 0.0)
    usable = failed = excluded = 0
    outcomes: dict[str, int] = {}
    seeded = _Seeded()
    for k, episode in enumerate(episodes):
        for row in family:
            cell = episode.cells[row]
            if cell.usable:
                count += 1
                successes += cell.success
                for name in sums:
                    sums[name] += cell.means[name]
                seeded.rows.append((inputs.arms[row]["reconstruction"], inputs.training_number(family, row),
                                    inputs.scene_positions.get(episode.scene, -1), k, float(cell.success)))
            for trial in cell.trials:
                outcomes[trial["outcome"]] = outcomes.get(trial["outcome"], 0) + 1
                if trial["outcome"] in NOT_COUNTED:
                    failed += trial["outcome"] == "error"
                    excluded += trial["outcome"] != "error"
                    continue
                usable += 1
                for name, column in _TRIAL_MEANS.items():
                    trial_sums[name] += trial[column]
    found: dict[str, Any] = {"successes": successes, "episodes": count, "sr": successes / count if count else 0.0,
                             "trainings": len(family)}
    if len(family) > 1:
        found["hierarchical95"] = _interval(hierarchical_rate_interval(seeded.values())[1:])
    else:
        found["wilson95"] = _interval(wilson_interval(successes, count))
        found["clopper_pearson95"] = _interval(clopper_pearson_interval(successes, count))
    found.update({name: total / max(1, count) for name, total in sums.items()})
    found.update({name: total / max(1, usable) for name, total in trial_sums.items()})
    by_count = sorted(sorted(outcomes.items()), key=lambda item: -item[1])
    return {**found, "failed_trials": failed, "excluded_trials": excluded, "outcomes": dict(by_count)}


def _paired_mean(values: _Seeded, several: bool) -> dict[str, Any]:
    if several:
        mean = hierarchical_interval(values.values())
        p = training_test(values.values()).p
        return {"mean": mean.mean, "hierarchical95": _interval(mean[1:]), "p_trainings": p}
    mean = bootstrap_mean(values.numbers())
    return {"mean": mean.mean, "bootstrap95": _interval(mean[1:]), "p_sign_flip": sign_flip_p(values.numbers())}


def _compare(inputs: _Inputs, pairs: list[_Pair], episodes: list[_Episode]) -> dict[str, Any]:
    tally = {(True, True): 0, (False, True): 0, (True, False): 0, (False, False): 0}
    dropped = 0
    success, means = _Seeded(), {name: _Seeded() for name in _PAIRED}
    for k, episode in enumerate(episodes):
        for pair in pairs:
            before, after = episode.cells[pair.before], episode.cells[pair.after]
            if not before.usable or not after.usable:
                dropped += 1
                continue
            tally[before.success, after.success] += 1
            place = (pair.reconstruction, pair.training, inputs.scene_positions.get(episode.scene, -1), k)
            success.rows.append((*place, float(after.success) - float(before.success)))
            for name, values in means.items():
                values.rows.append((*place, after.means[name] - before.means[name]))
    counts = PairedCounts(tally[True, True], tally[False, True], tally[True, False], tally[False, False])
    several = len(pairs) > 1
    found: dict[str, Any] = {**counts._asdict(), "dropped_pairs": dropped}
    if several:
        mean, test = hierarchical_interval(success.values()), training_test(success.values())
        ends = np.clip([mean.low, mean.high], -1.0, 1.0)
        difference = PairedDifference(np.float64(mean.mean), Interval(*ends))
        p = test.p
        found |= {"difference": mean.mean, "p": p, "hierarchical95": _interval(difference.interval), "p_trainings": p,
                  "degrees_of_freedom": test.degrees_of_freedom, "training_sd": test.training_sd,
                  "episode_sd": test.episode_sd, "p_holm": p}
    else:
        difference = newcombe_paired_difference(counts)
        p = float(mcnemar_exact_p(counts.only_after, counts.only_before))
        found |= {"difference": float(difference.difference), "p": p, "newcombe95": _interval(difference.interval),
                  "p_mcnemar_exact": p, "p_mcnemar_mid": float(mcnemar_mid_p(counts.only_after, counts.only_before)),
                  "p_holm": p}
    paired = {name: _paired_mean(values, several) for name, values in means.items()}
    if not several:
        found["p_spl_sign_flip"] = paired["spl"]["p_sign_flip"]
    return {**found, "paired": paired, "verdict": verdict(counts, p, difference)}


def summarise(run: "Run", before: str = "", after: str = "") -> dict[str, Any]:
    """Rates, intervals and tests of a run: what the JSON of `segsim table` has under the same keys.

    before, after: arms to compare; by default those that the table compares. Returns "before", "after", "scenes", "all"
    (of several scenes) and "classes"; a group has "name", "title", "arms" and, of two arms, "comparison".
    """
    inputs = _Inputs(run)
    before, after = inputs.compared_arms(before, after)
    pairs = inputs.pairs(before, after) if before and after else []

    def group(name: str, title: str, belongs: Callable[[_Episode], bool]) -> dict[str, Any]:
        episodes = [episode for episode in inputs.episodes if belongs(episode)]
        found = {"name": name, "title": title, "arms": {family: _arm_summary(inputs, rows, episodes)
                                                        for family, rows in inputs.families.items()}}
        if pairs:
            found["comparison"] = _compare(inputs, pairs, episodes)
        return found

    scenes = [group(name, title, lambda e: e.scene == name) for name, title in inputs.scenes.items()]
    found: dict[str, Any] = {"before": before, "after": after, "scenes": scenes}
    if len(scenes) > 1:
        found["all"] = group("all", "All scenes", lambda _: True)
        if len(pairs) == 1:
            counts = [scene["comparison"] for scene in scenes]
            mean = cluster_bootstrap_mean(
                [float(c["only_after"] - c["only_before"]) for c in counts],
                [c["both"] + c["only_after"] + c["only_before"] + c["neither"] for c in counts])
            found["all"]["comparison"]["over_scenes"] = {"difference": mean.mean,
                                                         "cluster_bootstrap95": _interval(mean[1:])}
    names = sorted({goal for goal in np.unique(run.trials["goal_class"]).tolist()}, key=str.encode)
    found["classes"] = [group(name, name, lambda e: e.goal_class == name) for name in names]
    if pairs and names:
        corrected = holm_correction([g["comparison"]["p"] for g in found["classes"]])
        for g, p in zip(found["classes"], corrected.tolist()):
            g["comparison"]["p_holm"] = p
    return found
