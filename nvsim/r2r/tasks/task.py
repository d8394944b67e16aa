"""One item of an `R2R_<split>.json`: a path with instructions that an agent must follow."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Task:
    """A path and its instructions.

    path_id       unique over all splits and scans
    scan          scan id
    path          viewpoint ids from the start to the goal
    heading       radians at the start, 0 is +y, positive turns right
    instructions  texts for an agent; each is a separate episode
    distance      length of the path in meters, None if the file has none (R2R's test split)
    """

    path_id: int
    scan: str
    path: tuple[str, ...]
    heading: float
    instructions: tuple[str, ...] = ()
    distance: float | None = None

    @property
    def instr_ids(self) -> tuple[str, ...]:
        """The ids of the episodes, PATHID_0, PATHID_1 and so on.

        A path without instructions has one episode, for agents that read no instructions.
        """
        return tuple(f"{self.path_id}_{k}" for k in range(max(1, len(self.instructions))))


@dataclass(frozen=True)
class JoinedTask(Task):
    """Two paths of a split with the shortest path between them. The whole is usually not a shortest path.

    first_path_id, second_path_id   ids of the two paths
    shortest_path                   viewpoint ids of the shortest path from the start to the goal
    shortest_path_distance          its length in meters

    Source: R4R, Jain et al. 2019, Stay on the Path, section 4.
    """

    first_path_id: int = 0
    second_path_id: int = 0
    shortest_path: tuple[str, ...] = ()
    shortest_path_distance: float = 0.0
