"""The environment's name in Gymnasium."""

import gymnasium

from fastsegsim.environments.object_nav import ENVIRONMENT_ID


def register() -> None:
    """Give the environment its name in Gymnasium; `import fastsegsim.environments` does so, and twice is no error."""
    if ENVIRONMENT_ID in gymnasium.registry:
        return
    # The episodes end themselves: their limit is simulated time.
    gymnasium.register(ENVIRONMENT_ID, entry_point="fastsegsim.environments:ObjectNavEnv",
                       vector_entry_point="fastsegsim.environments:ObjectNavVectorEnv")
