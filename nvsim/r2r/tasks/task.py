"""One item of an `R2R_<split>.json`: a path that an agent is told to follow."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Task:
    """path_id       unique over all splits and scans
    scan          scan id
    path          viewpoint ids from the start to the goal
    heading       radians at the start, 0 is +y, positive turns right
    instructions  what an agent is told; each is an episode of its own
    distance      metres of the path, None where the file does not say it (R2R's test split)
    """

    path_id: int
    scan: str
    path: tuple[str, ...]
    heading: float
    instructions: tuple[str, ...] = ()
    distance: float | None = None

    @property
    def instr_ids(self) -> tuple[str, ...]:
        """The id of every episode, PATHID_0, PATHID_1 and so on. A path without instructions is one episode, so that
        agents which read none can go."""
        return tuple(f"{self.path_id}_{k}" for k in range(max(1, len(self.instructions))))


@dataclass(frozen=True)
class JoinedTask(Task):
    """Two paths of a split one after the other, with the shortest path between them: no shortest path itself.

    first_path_id, second_path_id   of the two
    shortest_path                   viewpoint ids of the shortest path from the start to the goal
    shortest_path_distance          its metres

    Source: R4R, Jain et al. 2019, Stay on the Path, section 4.
    """

    first_path_id: int = 0
    second_path_id: int = 0
    shortest_path: tuple[str, ...] = ()
    shortest_path_distance: float = 0.0
