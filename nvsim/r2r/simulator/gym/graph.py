"""An environment that moves from viewpoint to viewpoint: an action selects a neighbor, as in candidate-based agents."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from gymnasium import spaces

from nvsim.r2r.simulator.gym.episode import EpisodeEnv, Observation


class GraphEnv(EpisodeEnv):
    """Action 0 stops. Action k moves to the k-th navigable location, sorted by the angle from the image center.

    The agent then faces the direction of the move. An action without a location changes nothing.

    Observations also have `candidates` (most, 3) float32: radians to the right, radians up, and meters; unused rows are
    0. `info["action_mask"]` (most + 1,) int8 marks the available actions. most: largest number of neighbors.
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

    def _info(self) -> dict[str, Any]:
        mask = np.arange(self._most + 1) < len(self.state.navigableLocations)
        return super()._info() | {"action_mask": mask.astype(np.int8)}
