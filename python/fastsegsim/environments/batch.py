"""What one environment and several have in common: settings, spaces, and the C++ that steps them."""

import os
import pathlib
from typing import Any

import numpy as np
from gymnasium import spaces

from fastsegsim import InputError
from fastsegsim._environments import EnvironmentBatch, EnvironmentSettings, outcomes

#: Names of the discrete actions; their numbers are Habitat's.
ACTIONS = ("stop", "forward", "left", "right")
LARGEST_ID = 65535  # Of classes and instances.


def settings_of(named: dict[str, Any]) -> EnvironmentSettings:
    """The settings with these names and values; the others have their defaults."""
    settings = EnvironmentSettings()
    names = sorted(name for name in vars(EnvironmentSettings) if not name.startswith("_"))
    for name, value in named.items():
        if name not in names:
            raise InputError(f"settings: expected {', '.join(names)}, found {name}")
        try:
            setattr(settings, name, value)
        except TypeError as error:
            default = getattr(EnvironmentSettings(), name)
            raise InputError(f"{name}: expected a value like {default!r}, found {value!r}") from error
    return settings


def batch_of(scene: str | os.PathLike[str], episodes: str | os.PathLike[str] | None, settings: EnvironmentSettings,
             count: int, threads: int | None) -> EnvironmentBatch:
    """Environments in C++; threads=None is one for every processor that this process may use."""
    cores = len(os.sched_getaffinity(0))
    return EnvironmentBatch(pathlib.Path(scene), None if episodes is None else pathlib.Path(episodes), settings, count,
                            cores if threads is None else threads)


def action_space_of(settings: EnvironmentSettings, batch: EnvironmentBatch) -> spaces.Space[Any]:
    if settings.action == "discrete":
        return spaces.Discrete(len(ACTIONS))
    most = np.array([*batch.speed_limits, 1.0], np.float32)
    return spaces.Box(-most, most, dtype=np.float32)


def observation_space_of(settings: EnvironmentSettings, batch: EnvironmentBatch) -> spaces.Dict:
    width, height = settings.size
    largest_m = np.float32(settings.depth_range_m)
    images = {
        "rgb": spaces.Box(0, 255, (height, width, 3), np.uint8),
        "depth": spaces.Box(np.float32(0), largest_m, (height, width), np.float32),
        "semantic": spaces.Box(0, LARGEST_ID, (height, width), np.uint16),
        "instance": spaces.Box(0, LARGEST_ID, (height, width), np.uint16),
    }
    chosen: dict[str, spaces.Space[Any]] = {name: images[name] for name in settings.images}
    chosen["pose"] = spaces.Box(-np.inf, np.inf, (3,), np.float32)
    chosen["goal"] = spaces.Discrete(len(batch.goal_classes))
    return spaces.Dict(chosen)


def with_names(info: dict[str, Any], ids: np.ndarray, classes: np.ndarray, goals: np.ndarray) -> dict[str, Any]:
    """Numbers of episodes, goals and outcomes as words, too; an episode that goes on has the outcome ""."""
    words = np.array([*outcomes, ""], object)  # The number of the last one is -1.
    info["outcome"] = words[info["outcome"]]
    info["episode_id"] = ids[info["episode_number"]]
    info["goal"] = classes[goals]
    return info


def as_int64(observations: dict[str, Any]) -> dict[str, Any]:
    """The same with the type that Gymnasium wants of a Discrete space: C++'s is another one of 64 bits."""
    observations["goal"] = observations["goal"].view(np.int64)
    return observations
