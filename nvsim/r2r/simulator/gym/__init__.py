"""The simulator as Gymnasium environments. Importing this module registers both; it needs the package gymnasium.

`nvsim/Graph-v0` moves from viewpoint to viewpoint. `nvsim/Walk-v0` moves in small steps through free space.
"""

from nvsim.errors import InputError

try:
    import gymnasium
except ImportError as error:
    raise InputError("The environments need the package gymnasium; install nvsim[gym].") from error

from nvsim.r2r.simulator.gym.graph import GraphEnv
from nvsim.r2r.simulator.gym.walk import WalkEnv

__all__ = ["GraphEnv", "WalkEnv"]

gymnasium.register("nvsim/Graph-v0", GraphEnv, max_episode_steps=30)
gymnasium.register("nvsim/Walk-v0", WalkEnv, max_episode_steps=500)
