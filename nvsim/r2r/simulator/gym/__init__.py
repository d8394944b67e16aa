"""The simulator as Gymnasium environments. To import this registers both; it needs the package gymnasium.

`nvsim/Graph-v0` goes from viewpoint to viewpoint, `nvsim/Walk-v0` in small steps over the ground that the evidence
shows free.
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
