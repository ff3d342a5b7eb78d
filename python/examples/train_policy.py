#!/usr/bin/env python3
"""Trains a very small policy to find objects in one scene, and says how often it succeeds before and after.

  train_policy.py SCENE [--minutes 2] [--robots 32] [--evaluate 96] [--seed 1]

SCENE is the folder of a bundle. The policy sees the depth ahead, to the left and to the right, and where and how large
the goal is in view (from the rendered labels), and chooses stop, forward, left or right by a linear score for each. Its
eight weights are found by a cross-entropy method (Rubinstein 1999) with memory: half of the robots drive on with the
weights that earned most so far, the others with new ones that are drawn around the best. Every robot of a round drives
with weights of its own through the same episodes.
"""

import argparse
import sys
import time

import numpy as np

import fastsegsim
from fastsegsim import results
from fastsegsim.environments import ObjectNavVectorEnv

WEIGHTS = 8
# What weights are drawn around at first, and how widely: STOP where the goal fills a share of the image.
PRIOR, WIDTH = np.array([0.5, 0, 0, 0, 0, 0, 0, 0]), np.array([0.25, 1, 1, 1, 1, 1, 1, 1])
STEPS_PER_ROUND = 120


def actions_of(observations: dict[str, np.ndarray], class_ids: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """What robots with weights [robots, WEIGHTS] do."""
    depth = observations["depth"]
    robots, height, width = depth.shape
    band = depth[:, height // 3:, :]
    band = np.where(band > 0, band, 6.0)  # 0 is out of the camera's range.
    third = width // 3
    sectors = (band[:, :, :third], band[:, :, third:width - third], band[:, :, width - third:])
    left, ahead, right = (np.clip(sector.min(axis=(1, 2)) / 2.0, 0.0, 1.0) for sector in sectors)
    goal = observations["semantic"] == class_ids[observations["goal"]][:, None, None]
    seen = goal.sum(axis=(1, 2))
    column = (goal * np.linspace(-1.0, 1.0, width)).sum(axis=(1, 2)) / np.maximum(seen, 1)
    share = np.sqrt(seen / (height * width))
    w, one = weights.T, np.ones(robots)
    stop = 10.0 * (share - w[0]) + w[1] * ahead
    forward = w[2] * ahead + w[3] * (seen > 0) + w[4] * one
    turn = w[5] * column + w[6] * (left - right)  # To the left; to the right in a mirror.
    return np.stack([stop, forward, turn + w[7], -turn], axis=1).argmax(axis=1)  # Numbers of the actions.


def run_episodes(environment: ObjectNavVectorEnv, weights: np.ndarray, episodes: int, seeds: list[int]) -> np.ndarray:
    """Successes [robots, episodes] of robots with weights [robots, WEIGHTS]."""
    successes = np.zeros((environment.num_envs, episodes), bool)
    done = np.zeros(environment.num_envs, int)
    observations, _ = environment.reset(seed=seeds)
    while (done < episodes).any():
        actions = actions_of(observations, environment.goal_class_ids, weights)
        observations, _, terminated, truncated, info = environment.step(actions)
        ended = np.flatnonzero((terminated | truncated) & (done < episodes))
        successes[ended, done[ended]] = info["success"][ended]
        done[ended] += 1
    return successes


def run_steps(environment: ObjectNavVectorEnv, weights: np.ndarray, seeds: list[int]) -> tuple[np.ndarray, float]:
    """What robots earn an episode [robots] in the steps of a round, and the share of all episodes that succeeded."""
    earned, ends, successes = np.zeros(environment.num_envs), np.zeros(environment.num_envs), 0
    observations, _ = environment.reset(seed=seeds)
    for _ in range(STEPS_PER_ROUND):
        actions = actions_of(observations, environment.goal_class_ids, weights)
        observations, rewards, terminated, truncated, info = environment.step(actions)
        earned += rewards
        ends += terminated | truncated
        successes += int((terminated & info["success"]).sum())
    return earned / np.maximum(ends, 1), successes / max(ends.sum(), 1)


def evaluate(environment: ObjectNavVectorEnv, weights: np.ndarray, episodes: int, name: str) -> tuple[int, int]:
    """Success on episodes that training did not see."""
    each = -(-episodes // environment.num_envs)
    seeds = [10_000_000 + robot for robot in range(environment.num_envs)]
    successes = run_episodes(environment, weights, each, seeds)
    count, total = int(successes.sum()), successes.size
    low, high = results.wilson_interval(count, total)
    print(f"{name}: {count} of {total} episodes, {count / total:.1%} (95 % interval {low:.1%} to {high:.1%})",
          flush=True)
    return count, total


def train(environment: ObjectNavVectorEnv, random: np.random.Generator, minutes: float) -> np.ndarray:
    """The weights that earned most."""
    robots, end_s = environment.num_envs, time.monotonic() + 60.0 * minutes
    half, best = robots // 2, max(2, robots // 8)
    mean, deviation = PRIOR, WIDTH
    kept, earned, rounds = np.empty((0, WEIGHTS)), np.empty(0), np.empty(0)  # Of the weights that drive on.
    for step in range(sys.maxsize):
        drawn = mean + deviation * random.normal(size=(robots - len(kept), WEIGHTS))
        kept = np.concatenate([kept, drawn])
        earned, rounds = (np.concatenate([old, np.zeros(len(drawn))]) for old in (earned, rounds))
        seeds = [int(random.integers(1_000_000))] * robots  # The same episodes for all.
        now, success = run_steps(environment, kept, seeds)
        earned += now - now.mean()  # Some rounds have easier episodes than others.
        rounds += 1
        # One lucky round says little: it counts as if half a round had earned nothing.
        order = np.argsort(-earned / (rounds + 0.5))[:half]
        kept, earned, rounds = kept[order], earned[order], rounds[order]
        mean, deviation = kept[:best].mean(axis=0), np.maximum(kept[:best].std(axis=0), 0.2 * WIDTH)
        print(f"round {step + 1}: earned {now.mean():.2f}, success {success:.1%}", flush=True)
        if time.monotonic() >= end_s:
            return kept[0]
    raise AssertionError


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--minutes", type=float, default=2.0)
    parser.add_argument("--robots", type=int, default=32)
    parser.add_argument("--evaluate", type=int, default=96)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()

    # Small images, long steps and little time: what such a policy needs, and no more.
    settings = {"num_envs": arguments.robots, "size": (32, 24), "horizontal_fov_rad": 1.5, "visible_pixels": 8,
                "images": ["depth", "semantic"], "forward_step_m": 0.5, "time_limit_s": 10.0, "success_reward": 5.0,
                "min_start_m": 1.0, "allow_visible_start": True}
    training = ObjectNavVectorEnv(arguments.scene, episode_seed=1, **settings)
    unseen = ObjectNavVectorEnv(arguments.scene, episode_seed=2, **settings)
    random = np.random.default_rng(arguments.seed)
    untrained = PRIOR + WIDTH * random.normal(size=(arguments.robots, WEIGHTS))
    before = evaluate(unseen, untrained, arguments.evaluate, "before")
    trained = train(training, random, arguments.minutes)
    after = evaluate(unseen, np.broadcast_to(trained, untrained.shape), arguments.evaluate, "after")
    print(f"gain: {after[0] / after[1] - before[0] / before[1]:+.1%}")


if __name__ == "__main__":
    try:
        main()
    except fastsegsim.InputError as error:
        sys.exit(f"train_policy.py: {error}")
