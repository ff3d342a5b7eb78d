#!/usr/bin/env python3
"""Trains a very small policy to find objects in one scene, and says how often it succeeds before and after.

  train_policy.py SCENE [--minutes 2] [--robots 32] [--evaluate 96] [--seed 1]

SCENE is the folder of a bundle. The policy sees the depth ahead, to the left and to the right, and where and how large
the goal is in view (from the rendered labels), and chooses stop, forward, left or right by a linear score for each;
left and right are mirror images. Its 14 weights are found by the cross-entropy method (Rubinstein 1999): draw weights,
keep the best quarter, draw around these. Every robot of a round drives with weights of its own through the same
episodes.
"""

import argparse
import sys
import time

import numpy as np

import fastsegsim
from fastsegsim import results
from fastsegsim.environments import ObjectNavVectorEnv

EVEN, ODD = 6, 2  # Features that are the same in a mirror, and those that change their sign.
WEIGHTS = 2 * EVEN + ODD
EPISODES_PER_ROUND = 3


def features_of(observations: dict[str, np.ndarray], class_ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Even [robots, EVEN] and odd [robots, ODD] ones, each about 0 to 1, or -1 to 1."""
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
    even = np.stack([ahead, 0.5 * (left + right), seen > 0, np.abs(column), share, np.ones(robots)], axis=1)
    return even, np.stack([left - right, column], axis=1)


def actions_of(observations: dict[str, np.ndarray], class_ids: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """What robots with weights [robots, WEIGHTS] do."""
    even, odd = features_of(observations, class_ids)
    stop = (even * weights[:, :EVEN]).sum(axis=1)
    forward = (even * weights[:, EVEN:2 * EVEN]).sum(axis=1)
    left = (odd * weights[:, 2 * EVEN:]).sum(axis=1)
    return np.stack([stop, forward, left, -left], axis=1).argmax(axis=1)  # In the order of ACTIONS.


def run_episodes(environment: ObjectNavVectorEnv, weights: np.ndarray, episodes: int,
                 seeds: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Returns and successes [robots, episodes] of robots with weights [robots, WEIGHTS]."""
    robots = environment.num_envs
    returns, successes = np.zeros((robots, episodes)), np.zeros((robots, episodes), bool)
    done = np.zeros(robots, int)
    observations, _ = environment.reset(seed=seeds)
    while (done < episodes).any():
        actions = actions_of(observations, environment.goal_class_ids, weights)
        observations, rewards, terminated, truncated, info = environment.step(actions)
        going = np.flatnonzero(done < episodes)
        returns[going, done[going]] += rewards[going]
        ended = going[(terminated | truncated)[going]]
        successes[ended, done[ended]] = info["success"][ended]
        done[ended] += 1
    return returns, successes


def evaluate(environment: ObjectNavVectorEnv, weights: np.ndarray, episodes: int, name: str) -> tuple[int, int]:
    """Success on episodes that training did not see."""
    each = -(-episodes // environment.num_envs)
    seeds = [10_000_000 + robot for robot in range(environment.num_envs)]
    _, successes = run_episodes(environment, weights, each, seeds)
    count, total = int(successes.sum()), successes.size
    low, high = results.wilson_interval(count, total)
    print(f"{name}: {count} of {total} episodes, {count / total:.1%} (95 % interval {low:.1%} to {high:.1%})", flush=True)
    return count, total


def train(environment: ObjectNavVectorEnv, random: np.random.Generator, minutes: float) -> np.ndarray:
    """The mean of the best weights."""
    mean, deviation = np.zeros(WEIGHTS), np.ones(WEIGHTS)
    robots, end_s = environment.num_envs, time.monotonic() + 60.0 * minutes
    best = max(2, robots // 4)
    for step in range(sys.maxsize):
        weights = mean + deviation * random.normal(size=(robots, WEIGHTS))
        seeds = [int(random.integers(1_000_000))] * robots  # The same episodes for all.
        returns, successes = run_episodes(environment, weights, EPISODES_PER_ROUND, seeds)
        chosen = weights[np.argsort(returns.mean(axis=1))[-best:]]
        # Half of the way, and never quite certain: few episodes say little.
        mean = 0.5 * mean + 0.5 * chosen.mean(axis=0)
        deviation = 0.5 * deviation + 0.5 * np.maximum(chosen.std(axis=0), 0.1)
        print(f"round {step + 1}: return {returns.mean():.2f}, success {successes.mean():.1%}", flush=True)
        if time.monotonic() >= end_s:
            return mean
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
                "images": ["depth", "semantic"], "forward_step_m": 0.5, "time_limit_s": 15.0, "success_reward": 5.0}
    training = ObjectNavVectorEnv(arguments.scene, episode_seed=1, **settings)
    unseen = ObjectNavVectorEnv(arguments.scene, episode_seed=2, **settings)
    random = np.random.default_rng(arguments.seed)
    untrained = random.normal(size=(arguments.robots, WEIGHTS))
    before = evaluate(unseen, untrained, arguments.evaluate, "before")
    mean = train(training, random, arguments.minutes)
    after = evaluate(unseen, np.broadcast_to(mean, untrained.shape), arguments.evaluate, "after")
    print(f"gain: {after[0] / after[1] - before[0] / before[1]:+.1%}")


if __name__ == "__main__":
    try:
        main()
    except fastsegsim.InputError as error:
        sys.exit(f"train_policy.py: {error}")
