"""From viewpoint to viewpoint: an action is a neighbour, as it is for the agents that choose among candidates."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from gymnasium import spaces

from nvsim.r2r.simulator.gym.episode import EpisodeEnv, Observation


class GraphEnv(EpisodeEnv):
    """Action 0 stops; action k goes to the k-th of the navigable locations, nearest to the middle of the image first,
    and looks the way it went. One that there is none of leaves all as it is.

    Observations have `candidates` (most, 3) float32 as well: radians to the right and above, metres; all 0 beyond those
    there are. `info["action_mask"]` (most + 1,) int8 says which actions there are. most: neighbours at most.
    """

    def __init__(self, *arguments: Any, most: int = 15, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._most = most
        self.action_space = spaces.Discrete(most + 1)
        candidates = spaces.Box(-np.inf, np.inf, (most, 3), np.float32)
        self.observation_space = cast(spaces.Space[Observation], spaces.Dict({**self._parts, "candidates": candidates}))

    def _act(self, action: int) -> dict[str, Any]:
        locations = self.state.navigableLocations
        if action >= min(len(locations), self._most + 1):
            return {"invalid": True}
        turn = locations[action].rel_heading
        self.simulator.makeAction([action], [turn], [0.0])
        return {"invalid": False}

    def _seen(self) -> Observation:
        found = np.zeros((self._most, 3), np.float32)
        for row, place in zip(found, self.state.navigableLocations[1:]):
            row[:] = place.rel_heading, place.rel_elevation, place.rel_distance
        return super()._seen() | {"candidates": found}

    def _told(self) -> dict[str, Any]:
        mask = np.arange(self._most + 1) < len(self.state.navigableLocations)
        return super()._told() | {"action_mask": mask.astype(np.int8)}
