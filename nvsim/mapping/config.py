"""The configuration of the map builder: thresholds, the robot, the lattice, the limits."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Literal

from nvsim.errors import InputError
from nvsim.mapping.families import chosen

WIDEST = 0.9  # metres across that the evidence of a corridor covers

_RANGES = {  # the search ends within these, and there is something to see
    "tau_dist": (0.2, 100.0),
    "merge_radius": (0.05, 100.0),
    "max_distance": (0.0, 1e6),
    "max_viewpoints": (1, 1_000_000),
    "cover_distance": (0.1, 1e6),
    "lattice_offset": (-360.0, 360.0),
    "jitter": (0.0, 1.0),
    "reach": (0.2, 100.0),
    "stretch": (1.0, 100.0),
    "around": (0.0, 1e6),
    "view_size": (32, 4096),
    "panorama_width": (32, 8192),
    "robot_radius": (0.0, WIDEST / 2),
    "margin": (0.0, WIDEST / 2),
}


@dataclass(frozen=True)
class MappingConfig:
    """The corridor of a step is accepted when the mean over it passes (the paper's rule) and, under `rule` "worst",
    when every row and every cell of it passes as well."""

    rule: Literal["mean", "worst"] = "worst"
    """mean: the paper's mean over the corridor alone. worst: every row and cell must pass too."""
    criteria: tuple[str, ...] = ("alpha", "normal")
    """What must pass, joined by commas: alpha, normal, network-normal, depth, slice. Known floor is asked for whatever
    stands here."""
    normals_model: str = ""
    """Criterion network-normal: the installed model that sees normals (nvsim models); the first if none is named."""
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
    tau_network_normal: float = 0.85
    """Criterion network-normal: the mean upward component of the normals that a network sees in the rendered views must
    exceed this (tau_normal)."""
    row_network_normal: float = 0.6
    """Rule worst: the same for the mean of every row."""
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
    """Radius of the robot in meters."""
    margin: float = 0.05
    """Metres that are kept free on either side of the robot as well, because edges of rendered things are soft. The
    corridor is twice the sum of both wide and ends the sum beyond the step; a door of 0.8 m lets it pass."""
    merge_radius: float = 1.0
    """Metres; a step that ends this near to an existing viewpoint leads to it."""
    checked_merges: bool = True
    """The corridor to an existing viewpoint that does not stand exactly where the step ends must pass as well."""
    standing: bool = True
    """A start needs free, known floor under it."""
    start: str = ""
    """Where the search begins: the name of a frame, or X,Y in metres; left out, the place of the trajectory with the
    most room around it, or its first frame when there is one start alone."""
    starts: Literal["cover", "one"] = "cover"
    """cover: the search begins again wherever the trajectory is not covered, or the graph does not follow it."""
    isolated: bool = False
    """Viewpoints without an edge are kept."""
    max_distance: float = 4.0
    """Metres; no viewpoint is farther than this from the trajectory, seen from above; 0 for any distance."""
    max_viewpoints: int = 20_000
    """The search stops here and says so: under loose thresholds it leaves the building through a hole in a wall."""
    cover_distance: float = 1.5
    """Metres; a place of the trajectory without a viewpoint this near, in line, starts another search."""
    lattice_offset: float = 7.5
    """Degrees that the eight directions are turned by, so that none lies between two of R2R's 30-degree views."""
    jitter: float = 0.15
    """Metres, at most, between where a step ends and the lattice, the same in every run: steps of one length leave
    shortest paths tied, which tells an agent apart from its teacher without either being wrong."""
    settle: bool = True
    """What the search found is thinned, joined and filled up; otherwise its lattices stay as they are."""
    reach: float = 3.5
    """Settling: metres of the longest edge."""
    stretch: float = 1.2
    """Settling: two viewpoints with a free way are joined unless the graph's way is at most this many times as long."""
    around: float = 3.0
    """Without a scan: no edge where the trajectory leads this many times as far around, and 4 m farther at least, nor
    off it between parts that are so far apart along it, for photographs alone do not show glass; 0 keeps them."""
    view_size: int = 192
    """Pixels of the square views, 100 degrees wide and pitched 45 degrees down, that the corridors are read from."""
    views: Literal["pitched", "panorama"] = "pitched"
    """pitched: eight square views, one for each direction. panorama: one equirectangular image (the paper's)."""
    panorama_width: int = 512
    """Pixels across the panorama, which is half as high; 512 show the floor about as fine as pitched views of 192."""
    second_opinion: bool = True
    """Ask the model of another submap too where it was trained on the same place; an edge needs both."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "criteria", chosen(self.criteria))
        if not 0 <= self.half_width <= WIDEST / 2:
            raise InputError(
                f"The corridor of a robot of {self.robot_radius} m radius with {self.margin} m margin is not between 0 "
                f"and {WIDEST} m wide, which is what the evidence can hold; change --robot-radius or --margin."
            )
        for name, (least, most) in _RANGES.items():
            if not least <= getattr(self, name) <= most:
                option = f"--{name.replace('_', '-')}"
                raise InputError(f"{option} {getattr(self, name)} is out of range; give {least:.12g} to {most:.12g}.")
        for name, value in vars(self).items():
            if isinstance(value, float) and not math.isfinite(value):
                raise InputError(f"--{name.replace('_', '-')} {value} is no number; give a finite one.")

    @property
    def key(self) -> dict[str, dict[str, object]]:
        """What a map's key holds of it. An option that came later counts where it is used only, so that what was built
        before stays current."""
        unasked = [family for family in ("network-normal", "depth", "slice") if family not in self.criteria]
        later = tuple(f"_{family.replace('-', '_')}" for family in unasked)
        values = {name: value for name, value in asdict(self).items() if not name.endswith(later)}
        if self.views == "pitched":
            del values["views"], values["panorama_width"]
        if self.criteria == MappingConfig.criteria:
            del values["criteria"]
        del values["normals_model"]  # the stage knows which one that is
        del values["around"]  # the stage knows whether there is a scan
        del values["second_opinion"]  # the stage knows whether there is another submap to ask
        return {MappingConfig.__name__: values}

    @property
    def half_width(self) -> float:
        """Metres from the middle of a corridor to its side."""
        return self.robot_radius + self.margin

    @staticmethod
    def paper() -> MappingConfig:
        """The paper's Algorithm 1: the means decide, by the closest submap alone, one way, from one start, however far
        from the trajectory, and a step that ends near an existing viewpoint leads to it.

        The paper does not say how near that is. A lattice of eight directions with steps of one length is dense in the
        plane, so that an exact match would never end; a metre gives as many viewpoints to the area as the paper has
        (2,095 on about 6,000 m2, of which part is free).
        """
        return MappingConfig(
            rule="mean",
            both_ways=False,
            margin=0.0,
            support=0.0,
            checked_merges=False,
            standing=False,
            starts="one",
            isolated=True,
            max_distance=0.0,
            lattice_offset=0.0,
            jitter=0.0,
            settle=False,
            second_opinion=False,
            around=0.0,
            views="panorama",
        )
