"""Environments for learning to find objects, as Gymnasium has them: one, or several that are stepped together.

    import gymnasium
    import fastsegsim.environments  # Registers SegSim/ObjectNav-v0.

    environment = gymnasium.make("SegSim/ObjectNav-v0", scene="out/flat/scenes/flat-3")

docs/python_environments.md explains observations, actions, rewards and settings.
"""

import importlib.util
import pathlib

if importlib.util.find_spec("gymnasium") is None:
    raise ImportError("fastsegsim.environments needs Gymnasium: pip install gymnasium", name="gymnasium")
try:
    import fastsegsim._environments  # noqa: F401
except ModuleNotFoundError as error:
    _missing = pathlib.Path(__file__).parents[1] / "environments_missing.txt"
    if not _missing.exists():
        raise
    raise ImportError("this fastsegsim was built without environments, for want of: "
                      f"{_missing.read_text().strip()}; install them, and the package once more",
                      name="fastsegsim._environments") from error

from fastsegsim.environments.object_nav import ACTIONS, ENVIRONMENT_ID, ObjectNavEnv
from fastsegsim.environments.object_nav_vector import ObjectNavVectorEnv
from fastsegsim.environments.registration import register

__all__ = ["ACTIONS", "ENVIRONMENT_ID", "ObjectNavEnv", "ObjectNavVectorEnv", "register"]

register()
