"""The options of the depth stage."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from nvsim.errors import InputError


@dataclass(frozen=True)
class LabelConfig:
    """How surfaces without texture are assigned to the planes of the building. Costs are in bits of the census."""

    max_planes: int = 24
    """Largest number of planes that compete in one image."""
    farthest: float = 20.0
    """Meters from the camera beyond which planes are ignored."""
    tolerance: float = 0.02
    """Tolerance of a confirmed inverse depth, as a share of it. Differences from it are measured in this unit."""
    difference_cost: float = 6.0
    """Cost of a plane per unit of `tolerance` between it and a confirmed depth."""
    max_difference_cost: float = 30.0
    """Upper limit of the cost of a plane that differs from a confirmed depth."""
    unexplained_cost: float = 14.0
    """Cost of keeping a confirmed depth that no plane explains."""
    small_plane_cost: float = 2.0
    """Extra cost of a very small plane, because mistakes create small planes."""
    half_cost_area: float = 2.0
    """Area in square meters at which the extra cost of a plane is half of `small_plane_cost`."""
    floor_cost: float = 1.6
    """Extra cost of a plane that faces up, because false floor would count as traversable."""
    unknown_cost: float = 14.0
    """Cost of leaving a pixel without a depth."""
    usual_difference: float = 9.0
    """Usual image difference on a plane in sharp images. Larger ones raise `unexplained_cost` and `unknown_cost`."""
    window: int = 7
    """Pixels: side of the window in which images are compared."""
    change_cost: float = 80.0
    """Cost of a change of plane between two pixels."""
    edge_step: float = 3.0
    """Gray levels: a step of this size in the image halves the cost of a change of plane."""


_STORED_LABELS = {
    "max_planes": "most",
    "tolerance": "share",
    "difference_cost": "differ",
    "max_difference_cost": "worst",
    "unexplained_cost": "own",
    "small_plane_cost": "tiny",
    "half_cost_area": "large",
    "floor_cost": "floor",
    "unknown_cost": "unknown",
    "usual_difference": "good",
    "change_cost": "change",
    "edge_step": "fall",
}
_STORED = {
    "tolerance": "share",
    "min_observations": "seen",
    "max_difference": "apart",
    "refining_sources": "refining",
    "labeling_sources": "labelling",
    "small_change_cost": "small",
    "large_change_cost": "large",
    "edge_step": "fall",
    "min_deviation": "finest",
    "compared_maps": "others",
    "tolerance_offset": "plane",
    "max_uncertainty": "certain",
    "checked_observations": "firm",
    "checking_maps": "witnesses",
}
"""The names of fields in the keys that projects store."""


@dataclass(frozen=True)
class DepthConfig:
    """How depth is estimated from images with camera poses. Class variables are constants, without an option."""

    longest_side: int = 400
    """Pixels: images are shrunk so that neither side exceeds it."""
    planes: int = 96
    """Number of depths tested at every pixel, evenly spaced in inverse depth. Multiples of 16 are fastest."""
    nearest: float = 0.5
    """Meters: smallest depth that is tested."""
    farthest: float = 20.0
    """Meters: largest depth that is tested."""
    baseline: float = 0.35
    """Meters between two cameras that measure depth best."""
    sources: int = 6
    """Number of neighboring images that each frame is compared with."""
    steps: int = 1
    """Number of refinement steps."""
    noise: float = 2.0
    """Standard deviation of the gray values."""
    margin: float = 0.02
    """Least margin of the best depth over the next best, as a share of cost. Otherwise the depth is unknown."""
    views: int = 3
    """Number of depth maps that must agree on a depth."""
    tolerance: float = 0.03
    """Depth maps agree within this share of the inverse depth, plus `tolerance_offset`."""
    voxel: float = 0.03
    """Meters: edge of the cells in which the point cloud is fused."""
    min_observations: int = 3
    """Least number of observations of a cell of the point cloud."""
    max_difference: float = 0.05
    """A depth is removed if it differs from a cell with enough observations by more than this share."""
    seen_through: float = 0.1
    """A depth is removed if more than this share of the votes of other depth maps see through it."""
    threads: int = 2
    """Number of frames processed at the same time."""

    refining_sources: ClassVar[int] = 6
    """Number of these images that refine the depth between two tested depths."""
    labeling_sources: ClassVar[int] = 6
    """Number of neighboring images that decide which plane of the building a pixel shows."""
    threshold: ClassVar[float] = 1.5
    """Gray levels by which a pixel is clearly brighter or darker than another."""
    small_change_cost: ClassVar[int] = 20
    """Cost of a depth change by one tested depth between two pixels, in bits of the census."""
    large_change_cost: ClassVar[float] = 150.0
    """Cost of any greater depth change between two pixels, in bits of the census."""
    edge_step: ClassVar[float] = 4.0
    """Gray levels: a step of this size in the image halves the cost of a greater depth change."""
    window: ClassVar[int] = 9
    """Pixels: side of the window in which depth between the tested depths is refined."""
    min_deviation: ClassVar[float] = 0.001
    """Lower limit of the standard deviation of inverse depth, in 1 / meter: the accuracy of poses and lenses."""
    compared_maps: ClassVar[int] = 8
    """Number of depth maps that each depth map is compared with."""
    tolerance_offset: ClassVar[float] = 0.003
    """Tolerance that is added to `tolerance`, in 1 / meter."""
    max_uncertainty: ClassVar[float] = 0.01
    """Largest relative uncertainty of a depth that planes have to follow."""
    checked_observations: ClassVar[int] = 10
    """Cells with at least this many observations that no map sees through are compared with the depth of all images."""
    checking_maps: ClassVar[int] = 12
    """Number of depth maps from all around that check whether a depth is seen through."""
    labels: ClassVar[LabelConfig] = LabelConfig()

    def __post_init__(self) -> None:
        for what, fine in (
            ("longest_side must be at least 32 pixels", self.longest_side >= 32),
            ("planes must be 8 to 1000", 8 <= self.planes <= 1000),
            ("nearest must be above 0 and below farthest", 0 < self.nearest < self.farthest < 1e4),
            ("baseline and voxel must be above 0", 0 < self.baseline < 1e4 and 1e-4 < self.voxel < 1e3),
            ("sources, views, min_observations and threads must be at least 1",
             min(self.sources, self.views, self.min_observations, self.threads) >= 1),
            ("noise must be above 0", self.noise > 0),
            ("max_difference must be above 0, seen_through must be 0 to 1",
             self.max_difference > 0 and 0 <= self.seen_through <= 1),
            ("steps must be 0 to 100", 0 <= self.steps <= 100),
        ):  # fmt: skip
            if not fine:
                raise InputError(f"Depth configuration: {what}; change it and try again.")

    @property
    def key(self) -> dict[str, dict[str, Any]]:
        """The values that identify a result: the options, except for the number of threads, and the constants. Projects
        store the key, so names that have changed since have their first names in it."""
        names = (name for name in type(self).__annotations__ if name not in ("threads", "labels"))
        values = {_STORED.get(name, name): getattr(self, name) for name in names}
        labels = {_STORED_LABELS.get(name, name): value for name, value in asdict(self.labels).items()}
        return {DepthConfig.__name__: values | {"threads": DepthConfig.threads, "labels": labels}}
