#!/usr/bin/env python3
"""Compares two detectors on the episodes that both searched in: rates, their difference, and whether it may be chance.

  compare_runs.py RUN [OTHER_RUN] [--before before] [--after after]

RUN is the work folder of `segsim run`. With OTHER_RUN the arm --after is that of the other run, which must have
searched in the same episodes by the same rule of success.
"""

import argparse
import sys

import fastsegsim
from fastsegsim import results

Successes = dict[tuple[str, str, str], bool]


def check_comparable(first: results.Run, second: results.Run) -> None:
    """Episodes of one name are the same ones only in the same scenes, and successes only by one rule."""
    rules = [run.row["success_profile"] for run in (first, second)]
    if rules[0] != rules[1]:
        raise fastsegsim.InputError(f"success rule: expected \"{rules[0]}\", found \"{rules[1]}\"")
    digests = {scene["name"]: scene["episodes_sha256"] for scene in first.scenes}
    for scene in second.scenes:
        if digests.get(scene["name"], scene["episodes_sha256"]) != scene["episodes_sha256"]:
            raise fastsegsim.InputError(f"scene {scene['name']}: expected the same episodes, found others")


def rate(name: str, found: Successes) -> str:
    successes, episodes = sum(found.values()), len(found)
    low, high = results.wilson_interval(successes, episodes)
    share = successes / max(1, episodes)
    return f"{name:12} {successes}/{episodes} = {share:.1%} (95 % interval {low:.1%} to {high:.1%})"


def difference(before: Successes, after: Successes) -> str:
    counts = results.paired_counts(before, after)
    found = results.newcombe_paired_difference(counts)
    p = results.mcnemar_exact_p(counts.only_after, counts.only_before)
    return (f"{found.difference:+.1%} (95 % interval {found.interval.low:+.1%} to {found.interval.high:+.1%}), "
            f"+{counts.only_after} -{counts.only_before} of {sum(counts)} pairs, p = {p:.3f}: "
            f"{results.verdict(counts)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run")
    parser.add_argument("other_run", nargs="?")
    parser.add_argument("--before", default="before")
    parser.add_argument("--after", default="after")
    arguments = parser.parse_args()

    first = results.load_run(arguments.run)
    second = results.load_run(arguments.other_run) if arguments.other_run else first
    check_comparable(first, second)
    before, after = first.episode_successes(arguments.before), second.episode_successes(arguments.after)
    print(rate(arguments.before, before))
    print(rate(arguments.after, after))
    print(f"{'difference':12} {difference(before, after)}")
    print("by goal, for a first look (each p is that of one goal alone)")
    for goal in sorted({key[2] for key in before.keys() & after.keys()}):
        of_goal = [{key: found[key] for key in found if key[2] == goal} for found in (before, after)]
        print(f"  {goal:16} {difference(*of_goal)}")


if __name__ == "__main__":
    try:
        main()
    except fastsegsim.InputError as error:
        sys.exit(f"compare_runs.py: {error}")
