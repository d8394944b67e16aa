"""The configuration of the map builder: thresholds, the robot, the lattice, the limits."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

from nvsim.errors import InputError
from nvsim.mapping.families import chosen

WIDEST = 0.9  # metres across that the evidence of a corridor covers


@dataclass(frozen=True)
class MappingConfig:
    """The corridor of a step is accepted when the mean over it passes (the paper's rule) and, under `rule` "worst",
    when every row and every cell of it passes as well."""

    rule: Literal["mean", "worst"] = "worst"
    """mean: the paper's mean over the corridor alone. worst: every row and cell must pass too."""
    criteria: tuple[str, ...] = ("alpha", "normal")
    """What must pass, joined by commas: alpha, normal, depth, slice. Known floor is asked for whatever stands here."""
    tau_alpha: float = 0.95
    """Mean accumulated alpha over the corridor must stay below this (tau_alpha)."""
    tau_normal: float = 0.85
    """Mean upward normal component over the corridor must exceed this (tau_normal)."""
    tau_dist: float = 2.5
    """Metres of every step, diagonals included (tau_dist)."""
    row_alpha: float = 0.2
    """Rule worst: the mean alpha of every robot-wide row, 0.1 m deep, must stay below this."""
    cell_alpha: float = 0.5
    """Rule worst: the alpha of every cell of 0.05 x 0.1 m must stay below this."""
    row_normal: float = 0.6
    """Rule worst: the mean upward normal component of every row must exceed this."""
    tau_depth: float = 0.95
    """Criterion depth: the mean share of the way to the floor that the rendered depth reaches must exceed this."""
    row_depth: float = 0.9
    """Rule worst: the same for the mean of every row."""
    tau_slice: float = 0.05
    """Criterion slice: what Gaussians between 0.1 m above the floor and the camera cover of the corridor, seen from
    above, must stay below this share."""
    row_slice: float = 0.2
    """Rule worst: the same for every row."""
    cell_slice: float = 0.5
    """Rule worst: the same for every cell."""
    support: float = 0.85
    """Share of every row that a floor mask or the cloud must know as floor; what is not known is not walked."""
    both_ways: bool = True
    """An edge needs the corridor back as well: a table top hides the floor behind it from one side only."""
    robot_radius: float = 0.25
    """Metres."""
    margin: float = 0.05
    """Metres that are kept free on either side of the robot as well, because edges of rendered things are soft. The
    corridor is twice the sum of both wide and ends the sum beyond the step; a door of 0.8 m lets it pass."""
    merge_radius: float = 1.0
    """Metres; a step that ends this near to an existing viewpoint joins it when the corridor to it passes."""
    max_distance: float = 4.0
    """Metres; no viewpoint is farther than this from the trajectory, seen from above."""
    max_viewpoints: int = 1500
    """The search stops here and says so."""
    cover_distance: float = 1.5
    """Metres; a place of the trajectory without a viewpoint this near, in line, starts another search."""
    lattice_offset: float = 7.5
    """Degrees that the eight directions are turned by, so that none lies between two of R2R's 30-degree views."""
    view_size: int = 192
    """Pixels of the square views, 100 degrees wide and pitched 45 degrees down, that the corridors are read from."""

    second_opinion: bool = True
    """Ask the model of another submap too where it was trained on the same place; an edge needs both."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "criteria", chosen(self.criteria))
        if not 0 <= self.half_width <= WIDEST / 2:
            raise InputError(
                f"The corridor of a robot of {self.robot_radius} m radius with {self.margin} m margin is not between 0 "
                f"and {WIDEST} m wide, which is what the evidence can hold; change --robot-radius or --margin."
            )

    @property
    def key(self) -> dict[str, dict[str, object]]:
        """What a map's key holds of it. An option that came later counts where it is used only, so that what was built
        before stays current."""
        later = tuple(f"_{family}" for family in ("depth", "slice") if family not in self.criteria)
        values = {name: value for name, value in asdict(self).items() if not name.endswith(later)}
        if self.criteria == MappingConfig.criteria:
            del values["criteria"]
        del values["second_opinion"]  # the stage knows whether there is another submap to ask
        return {MappingConfig.__name__: values}

    @property
    def half_width(self) -> float:
        """Metres from the middle of a corridor to its side."""
        return self.robot_radius + self.margin

    @staticmethod
    def paper() -> MappingConfig:
        """The paper's decision: the means, one way, by the closest submap alone."""
        return MappingConfig(rule="mean", both_ways=False, margin=0.0, support=0.5, second_opinion=False)
