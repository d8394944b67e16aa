"""An environment that moves in small steps through the free space of a project."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, cast

from gymnasium import spaces

from nvsim.r2r.simulator.errors import InvalidValue
from nvsim.r2r.simulator.gym.episode import EpisodeEnv, Observation


class WalkEnv(EpisodeEnv):
    """Actions: 0 stops, 1 moves ahead by `forward` meters, 2 and 3 turn left and right by `turn` degrees.

    A step outside known free space does not move the agent, and `info["refused"]` has the reason. `dataset` is a
    project.
    """

    def __init__(
        self,
        dataset: str | Path = "project.nvsim",
        *arguments: Any,
        forward: float = 0.25,
        turn: float = 15.0,
        **named: Any,
    ) -> None:
        super().__init__(dataset, *arguments, **named)
        self._forward, self._turn = forward, math.radians(turn)
        self.action_space = spaces.Discrete(4)
        self.observation_space = cast(spaces.Space[Observation], spaces.Dict(self._parts))

    def _act(self, action: int) -> dict[str, Any]:
        if action > 1:
            self.simulator.makeAction([0], [self._turn if action == 3 else -self._turn], [0.0])
            return {"refused": ""}
        state = self.state
        x = state.location.x + self._forward * math.sin(state.heading)
        y = state.location.y + self._forward * math.cos(state.heading)
        try:
            self.simulator.move_to(x, y, straight=True, locations=False)
        except InvalidValue as refusal:
            return {"refused": str(refusal)}
        return {"refused": ""}
