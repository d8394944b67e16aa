"""The agents without a network, by the names that the commands use."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from nvsim.graph.types import NavGraph
from nvsim.r2r.agents.chance import PaperRandomAgent, RandomAgent
from nvsim.r2r.agents.running import Agent
from nvsim.r2r.agents.shortest import ShortestAgent

Name = Literal["shortest", "random", "random-paper"]


def agent_of(name: Name, graphs: Mapping[str, NavGraph], seed: int) -> Agent:
    """Returns the agent with this name.

    graphs   scan id -> graph
    """
    if name == "shortest":
        return ShortestAgent(graphs)
    return RandomAgent(seed) if name == "random" else PaperRandomAgent(seed)
