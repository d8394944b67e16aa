"""The configuration of the map builder: thresholds, the robot, the lattice, and limits."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Literal

from nvsim.errors import InputError
from nvsim.mapping.families import MEANS, parse_families

WIDEST = 0.9  # meters: width that the evidence of a corridor covers

_ROWS = ("row_alpha", "cell_alpha", "row_normal", "row_network_normal", "row_depth", "row_slice", "cell_slice")
"""Thresholds of rule worst that are in the keys of earlier maps of rule mean."""

_RANGES = {  # valid ranges: the search ends, and views are large enough to read
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
    "photographed": (0.0, 1.0),
    "robot_radius": (0.0, WIDEST / 2),
    "margin": (0.0, WIDEST / 2),
}


@dataclass(frozen=True)
class MappingConfig:
    """Settings of the map builder. A corridor is accepted if its means pass (the paper's rule). Under `rule` "worst",
    every row and every cell of it must pass as well."""

    rule: Literal["mean", "worst"] = "worst"
    """mean: the paper's mean over the corridor alone. worst: every row and cell must pass as well."""
    criteria: tuple[str, ...] = ("alpha", "normal")
    """Criteria that must pass, separated by commas: alpha, normal, network-normal, depth, slice. Known floor is always
    required."""
    normals_model: str = ""
    """Criterion network-normal: the installed model that predicts normals (nvsim models). By default the first one."""
    tau_alpha: float = 0.95
    """The mean accumulated alpha over the corridor must stay below this (tau_alpha)."""
    tau_normal: float = 0.85
    """The mean upward normal component over the corridor must exceed this (tau_normal)."""
    tau_dist: float = 2.5
    """Meters of every step, including diagonals (tau_dist)."""
    row_alpha: float = 0.2
    """Rule worst: the mean alpha of every row, as wide as the robot and 0.1 m deep, must stay below this."""
    cell_alpha: float = 0.5
    """Rule worst: the alpha of every cell of 0.05 x 0.1 m must stay below this."""
    row_normal: float = 0.6
    """Rule worst: the mean upward normal component of every row must exceed this."""
    tau_network_normal: float = 0.85
    """Criterion network-normal: the mean upward component of the normals that a network predicts for the rendered views
    must exceed this (tau_normal)."""
    row_network_normal: float = 0.6
    """Rule worst: the mean upward component of these normals in every row must exceed this."""
    tau_depth: float = 0.95
    """Criterion depth: the share of the distance to the floor that the rendered depth reaches. Its mean over the
    corridor must exceed this."""
    row_depth: float = 0.9
    """Rule worst: the mean of this share in every row must exceed this."""
    tau_slice: float = 0.05
    """Criterion slice: the share of the corridor that Gaussians cover, seen from above, between 0.1 m above the floor
    and the camera. It must stay below this."""
    row_slice: float = 0.2
    """Rule worst: this share of every row must stay below this."""
    cell_slice: float = 0.5
    """Rule worst: this share of every cell must stay below this."""
    support: float = 0.85
    """Share of every row that a floor mask or the point cloud must show as floor. Unknown floor is not traversable."""
    both_ways: bool = True
    """An edge needs a free corridor in both directions, because a table top hides the floor behind it from one side
    only. --no-both-ways accepts one free direction."""
    robot_radius: float = 0.25
    """Meters, the radius of the robot."""
    margin: float = 0.05
    """Meters that are kept free on either side of the robot, because edges of rendered objects are soft. The corridor
    is twice the sum of radius and margin wide, and ends this sum beyond the step. A door of 0.8 m is wide enough."""
    merge_radius: float = 1.0
    """Meters; a step that ends this close to an existing viewpoint leads to that viewpoint."""
    checked_merges: bool = True
    """The corridor to an existing viewpoint that is not exactly at the end of a step must be free as well.
    --no-checked-merges skips this check."""
    standing: bool = True
    """A start needs free, known floor under it; under rule worst, every viewpoint does. --no-standing skips this
    check."""
    start: str = ""
    """Position where the search begins: the name of a frame, or X,Y in meters. By default the position of the
    trajectory with the most room around it, or its first frame if there is only one start."""
    starts: Literal["cover", "one"] = "cover"
    """cover: the search starts again wherever the trajectory is not covered, or the graph does not follow it. one:
    there is a single start."""
    isolated: bool = False
    """Keep viewpoints without an edge."""
    max_distance: float = 4.0
    """Meters; maximum distance of viewpoints from the trajectory, seen from above. 0 for any distance."""
    max_viewpoints: int = 20_000
    """Maximum number of viewpoints. The search stops there and reports it: with loose thresholds, it leaves the
    building through a hole in a wall."""
    cover_distance: float = 1.5
    """Meters; a position of the trajectory without a viewpoint this close, in line, starts another search."""
    lattice_offset: float = 7.5
    """Degrees by which the eight directions are rotated, so that none is between two of R2R's 30-degree views."""
    jitter: float = 0.15
    """Meters, maximum shift of the end of a step from the lattice, equal in every run. Steps of one length give
    shortest paths of equal length. An agent and its teacher then differ although both are right."""
    settle: bool = True
    """Thin, join and fill the graph that the search found. --no-settle keeps the lattices of the search."""
    reach: float = 3.5
    """Settling: maximum length of an edge in meters."""
    stretch: float = 1.2
    """Settling: two viewpoints with a free path are joined unless their path in the graph is at most this many times as
    long."""
    around: float = 3.0
    """Without a LiDAR scan: ratio of the path along the trajectory to the edge. An edge with a greater ratio, and at
    least 4 m of detour, is removed if it crosses an opening of a wall, or if no images look across, because photographs
    do not show glass. Edges beside a door that the trajectory uses are removed as well. 0 keeps these edges."""
    view_size: int = 192
    """Pixels per side of the square views from which corridors are read. They are 100 degrees wide and pitched 45
    degrees down."""
    views: Literal["pitched", "panorama"] = "pitched"
    """pitched: eight square views, one for each direction. panorama: one equirectangular image (as in the paper)."""
    panorama_width: int = 512
    """Pixels across the panorama, which is half as high. 512 pixels show the floor about as finely as pitched views of
    192."""
    second_opinion: bool = True
    """Use the model of another submap as well if it was trained at that place; an edge needs both. --no-second-opinion
    uses one model."""
    photographed: float = 0.6
    """Share of the directions around a viewpoint that must show surfaces which training images show. Viewpoints below
    it stay in the graph and are reported. 0 reports none."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "criteria", parse_families(self.criteria))
        if not 0 <= self.half_width <= WIDEST / 2:
            raise InputError(
                f"The corridor of a robot of {self.robot_radius} m radius with {self.margin} m margin is not between 0 "
                f"and {WIDEST} m wide, the limits of the evidence; change --robot-radius or --margin."
            )
        for name, (least, most) in _RANGES.items():
            if not least <= getattr(self, name) <= most:
                option = f"--{name.replace('_', '-')}"
                raise InputError(f"{option} {getattr(self, name)} is out of range; give {least:.12g} to {most:.12g}.")
        for name, value in vars(self).items():
            if isinstance(value, float) and not math.isfinite(value):
                raise InputError(f"--{name.replace('_', '-')} {value} is not finite; give a finite number.")

    @property
    def key(self) -> dict[str, dict[str, object]]:
        """The settings that identify a map. An option that was added later only counts if it is used, so that earlier
        maps stay valid."""
        unasked = [family for family in ("network-normal", "depth", "slice") if family not in self.criteria]
        later = tuple(f"_{family.replace('-', '_')}" for family in unasked)
        values = {name: value for name, value in asdict(self).items() if not name.endswith(later)}
        if self.rule == "mean":
            from nvsim.mapping.criteria import CRITERIA

            unused = {criterion.field for criterion in CRITERIA}.difference(MEANS, _ROWS)
            values = {name: value for name, value in values.items() if name not in unused}
        if self.views == "pitched":
            del values["views"], values["panorama_width"]
        if self.criteria == MappingConfig.criteria:
            del values["criteria"]
        if self.photographed == MappingConfig.photographed:
            del values["photographed"]
        del values["normals_model"]  # the stage adds the model
        del values["around"]  # the stage knows whether there is a LiDAR scan
        del values["second_opinion"]  # the stage knows whether there is another submap
        return {MappingConfig.__name__: values}

    @property
    def half_width(self) -> float:
        """Meters from the middle of a corridor to its side."""
        return self.robot_radius + self.margin

    @staticmethod
    def paper() -> MappingConfig:
        """Return the settings of the paper's Algorithm 1. Means decide, only the closest submap is used, one free
        direction suffices, and there is one start. The distance from the trajectory is unlimited. A step that ends near
        an existing viewpoint leads to it.

        The paper does not define "near". Steps of one length in eight directions fill the plane densely, so that exact
        matches would never end the search. One meter gives as many viewpoints per area as in the paper (2,095 on about
        6,000 m2, of which a part is free).
        """
        return MappingConfig(
            rule="mean",
            criteria=("alpha", "normal"),
            tau_alpha=0.95,
            tau_normal=0.85,
            tau_dist=2.5,
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
