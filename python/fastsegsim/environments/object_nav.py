"""One environment."""

import os
from typing import Any, ClassVar

import gymnasium
import numpy as np

from fastsegsim import InputError
from fastsegsim.environments.batch import (ACTIONS, action_space_of, as_int64, batch_of, observation_space_of,
                                           settings_of, with_names)

__all__ = ["ACTIONS", "ENVIRONMENT_ID", "ObjectNavEnv"]

ENVIRONMENT_ID = "SegSim/ObjectNav-v0"


class ObjectNavEnv(gymnasium.Env[dict[str, Any], Any]):
    """A robot looks for an object in a reconstructed scene, as in a trial of `segsim run`.

    scene: the folder of a bundle in which a robot can drive.
    episodes: a file of `segsim episodes generate`; None makes episodes by the same rules.
    render_mode: None or "rgb_array", the image that the robot took last.
    threads: that draw; None for one on each processor. Nothing but speed depends on it.
    settings: see docs/python_environments.md.

    Raises fastsegsim.InputError, naming the file or the setting.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(self, scene: str | os.PathLike[str], episodes: str | os.PathLike[str] | None = None, *,
                 render_mode: str | None = None, threads: int | None = None, **settings: Any) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"render_mode: expected None or rgb_array, found {render_mode}")
        self.settings = settings_of(settings)
        if render_mode is not None and "rgb" not in self.settings.images:
            raise InputError("render_mode: expected None where images lack rgb, found rgb_array")
        self._batch = batch_of(scene, episodes, self.settings, 1, threads)
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": 1.0 / self.settings.control_period_s}
        self.action_space = action_space_of(self.settings, self._batch)
        self.observation_space = observation_space_of(self.settings, self._batch)
        self.goal_classes = self._batch.goal_classes
        self.goal_class_ids = np.array(self._batch.goal_class_ids)
        self.episode_ids = self._batch.episode_ids
        self._names = (np.array(self.episode_ids, object), np.array(self.goal_classes, object))
        self._begun = self._over = False
        self._picture: np.ndarray | None = None

    def commands_of(self, action: int) -> list[tuple[float, float]]:
        """What a discrete action is: metres and radians per second for each control period."""
        return self._batch.commands(action)

    @property
    def infeasible_episodes(self) -> int:
        """How many episodes of the file this robot cannot do in this scene; they are left out."""
        return self._batch.infeasible

    def reset(self, *, seed: int | None = None,
              options: dict[str, Any] | None = None) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin the next episode. options: {"episode": number or id} asks for a certain one."""
        super().reset(seed=seed)
        if seed is None and not self._begun:
            seed = int(self.np_random.integers(2**63))
        episode = self._episode_of(options or {})
        begun = self._batch.reset([seed], [episode])
        self._begun, self._over = True, False
        return self._only(*begun)

    def step(self, action: Any) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Act: see docs/python_environments.md for what actions mean."""
        if self._over:
            raise InputError("step: expected reset() after the end of an episode, found an action")
        observations, rewards, terminated, truncated, infos = self._batch.step(np.asarray(action)[None])
        self._over = bool(terminated[0] or truncated[0])
        observation, info = self._only(observations, infos)
        return observation, float(rewards[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self) -> np.ndarray | None:
        """The image that the robot took last, where render_mode is "rgb_array"."""
        return None if self._picture is None else self._picture.copy()

    def _only(self, observations: dict[str, Any], infos: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        with_names(infos, *self._names, as_int64(observations)["goal"])
        if self.render_mode is not None:
            self._picture = observations["rgb"][0]
        observation = {name: values[0] for name, values in observations.items()}
        info = {name: values[0] if values.ndim > 1 or values.dtype == object else values[0].item()
                for name, values in infos.items()}
        return observation, info

    def _episode_of(self, options: dict[str, Any]) -> int:
        """Number of the episode that is asked for; -1 for the next one."""
        unknown = sorted(set(options) - {"episode"})
        if unknown:
            raise InputError(f"options: expected episode, found {', '.join(map(str, unknown))}")
        if "episode" not in options:
            return -1
        episode = options["episode"]
        if isinstance(episode, str):
            if episode not in self.episode_ids:
                count = len(self.episode_ids)
                raise InputError(f"episode: expected the id of one of {count} episodes, found {episode}")
            return self.episode_ids.index(episode)
        if isinstance(episode, bool) or not isinstance(episode, (int, np.integer)) or episode < 0:
            raise InputError(f"episode: expected a number from 0 or an id, found {episode}")
        return int(episode)
