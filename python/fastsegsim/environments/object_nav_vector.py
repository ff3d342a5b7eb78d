"""Several environments that C++ steps together."""

import os
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from fastsegsim import InputError
from fastsegsim.environments.batch import (action_space_of, as_int64, batch_of, observation_space_of, settings_of,
                                           with_names)


class ObjectNavVectorEnv(VectorEnv[dict[str, Any], Any, np.ndarray]):
    """Robots in one scene, each with episodes of its own; shuffled, environment i is as an ObjectNavEnv with the seed + i.

    num_envs: how many.
    threads: of C++ that step them; None for one on each processor. Nothing but speed depends on it. Each thread
        keeps the scene packed for drawing once.
    The other arguments are those of ObjectNavEnv.

    The step after the end of an episode begins the next one, whatever the action, with a reward of 0
    (AutoresetMode.NEXT_STEP).
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 10,
                                          "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(self, scene: str | os.PathLike[str], episodes: str | os.PathLike[str] | None = None, *,
                 num_envs: int = 1, render_mode: str | None = None, threads: int | None = None,
                 **settings: Any) -> None:
        super().__init__()
        self.settings = settings_of(settings)
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"render_mode: expected None or rgb_array, found {render_mode}")
        if render_mode is not None and "rgb" not in self.settings.images:
            raise InputError("render_mode: expected None where images lack rgb, found rgb_array")
        self._batch = batch_of(scene, episodes, self.settings, num_envs, threads)
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": 1.0 / self.settings.control_period_s}
        self.single_action_space = action_space_of(self.settings, self._batch)
        self.single_observation_space = observation_space_of(self.settings, self._batch)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.goal_classes = self._batch.goal_classes
        self.goal_class_ids = np.array(self._batch.goal_class_ids)
        self.episode_ids = self._batch.episode_ids
        self._names = (np.array(self.episode_ids, object), np.array(self.goal_classes, object))
        self._all = np.ones(num_envs, np.bool_)
        self._begun = False
        self._pictures: np.ndarray | None = None

    def commands_of(self, action: int) -> list[tuple[float, float]]:
        """What a discrete action is: metres and radians per second for each control period."""
        return self._batch.commands(action)

    @property
    def infeasible_episodes(self) -> int:
        """How many episodes of the file this robot cannot do in this scene; they are left out."""
        return self._batch.infeasible

    def reset(self, *, seed: int | Sequence[int | None] | None = None,
              options: dict[str, Any] | None = None) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode everywhere. seed: of the first one, the others have seed + 1, ...; or one for each."""
        if options:
            raise InputError(f"options: expected none, found {', '.join(map(str, options))}")
        super().reset(seed=seed if isinstance(seed, int) else None)
        if seed is None and not self._begun:
            seed = int(self.np_random.integers(2**62))
        if seed is None or isinstance(seed, (int, np.integer)):
            seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise InputError(f"seed: expected one for each of {self.num_envs} environments, found {len(seeds)}")
        begun = self._batch.reset(seeds, [-1] * self.num_envs)
        self._begun = True
        return self._named(*begun)

    def step(self, actions: Any) -> tuple[dict[str, Any], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Act everywhere, or begin the next episode where one was over."""
        observations, rewards, terminated, truncated, infos = self._batch.step(actions)
        observations, infos = self._named(observations, infos)
        return observations, rewards, terminated, truncated, infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The images that the robots took last, where render_mode is "rgb_array"."""
        return None if self._pictures is None else tuple(self._pictures.copy())

    def _named(self, observations: dict[str, Any], infos: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        if self.render_mode is not None:
            self._pictures = observations["rgb"]
        with_names(infos, *self._names, as_int64(observations)["goal"])
        # Gymnasium's way to say where an entry is there: everywhere.
        infos.update({f"_{name}": self._all.copy() for name in tuple(infos)})
        return observations, infos
