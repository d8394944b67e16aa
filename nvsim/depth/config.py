"""What the depth stage can be told."""

from __future__ import annotations

from dataclasses import dataclass, field

from nvsim.errors import InputError


@dataclass(frozen=True)
class LabelConfig:
    """How bare surfaces are given to the planes of the building. Costs are in bits of the census."""

    most: int = 24
    """Planes that compete in one image."""
    farthest: float = 20.0
    """Metres: planes are not looked for beyond."""
    share: float = 0.02
    """Share of the inverse depth by which a confirmed depth may be off: the unit of what it costs to differ."""
    differ: float = 6.0
    """What a plane costs for each such unit between it and a confirmed depth,"""
    worst: float = 30.0
    """and at most."""
    own: float = 14.0
    """What it costs to keep a confirmed depth that no plane explains."""
    tiny: float = 2.0
    """What the smallest of planes costs more: mistakes make small ones,"""
    large: float = 2.0
    """and the square metres of one that costs half as much more."""
    floor: float = 1.6
    """What a plane that faces up costs more: nobody may be led to where it is not."""
    unknown: float = 14.0
    """What it costs to leave a pixel without a depth."""
    good: float = 9.0
    """What images that show the same plane differ by where they are sharp; where it is more, depths cost more too."""
    window: int = 7
    """Pixels: images are compared in windows of this side."""
    change: float = 80.0
    """Price of a change of plane between two pixels."""
    fall: float = 3.0
    """Grey levels: a step in the image by so much halves that price."""


@dataclass(frozen=True)
class DepthConfig:
    """How depth is estimated from posed images."""

    longest_side: int = 400
    """Pixels: images are shrunk so that neither side exceeds it."""
    planes: int = 96
    """Depths that are tried at every pixel, even in inverse depth; a multiple of 16 is fastest."""
    nearest: float = 0.5
    """Metres: nothing nearer to a camera is looked for,"""
    farthest: float = 20.0
    """nor anything beyond."""
    baseline: float = 0.35
    """Metres between two cameras that see depth best."""
    sources: int = 6
    """Neighbouring images that a frame is compared with,"""
    refining: int = 6
    """and those of them that say where between two planes a pixel lies,"""
    labelling: int = 6
    """and which plane of the building it shows."""
    threshold: float = 1.5
    """Grey levels by which a pixel is clearly brighter or darker than another."""
    small: int = 20
    """Price of a change of depth by one plane between two pixels, in bits of the census,"""
    large: float = 150.0
    """and of a greater one."""
    fall: float = 4.0
    """Grey levels: a step in the image by so much halves the price of a step in depth."""
    window: int = 9
    """Pixels: side of the window in which depth between planes is found."""
    steps: int = 1
    """How often that is done."""
    noise: float = 2.0
    """Standard deviation of the grey values."""
    margin: float = 0.02
    """Share by which the best depth is better than the next, or it is no depth."""
    finest: float = 0.001
    """1 / metres: standard deviation of what is known best; poses and lenses are not better."""
    others: int = 8
    """Depth maps that one is compared with,"""
    views: int = 3
    """of which so many have to agree."""
    share: float = 0.03
    """They agree within this share of the inverse depth"""
    plane: float = 0.003
    """and this much more, 1 / metres."""
    certain: float = 0.01
    """Share of its depth by which a pixel may be off, by what the images know about it, for planes to follow it."""
    voxel: float = 0.03
    """Metres: edge of the cells in which the cloud is fused."""
    seen: int = 3
    """A cell counts that was seen so often."""
    firm: int = 10
    """A cell that was seen so often, through which no map sees, says what stands in every image;"""
    apart: float = 0.05
    """a depth that differs from it by more than this share of itself is none,"""
    witnesses: int = 12
    """and nor is one through which some of so many maps from all around see:"""
    seen_through: float = 0.1
    """more than this share of what these say."""
    threads: int = 2
    """Frames in hand at the same time."""
    labels: LabelConfig = field(default_factory=LabelConfig)

    def __post_init__(self) -> None:
        for what, fine in (
            ("longest_side must be at least 32 pixels", self.longest_side >= 32),
            ("planes must be 8 to 1000", 8 <= self.planes <= 1000),
            ("nearest must lie above 0 and below farthest", 0 < self.nearest < self.farthest < 1e4),
            ("baseline and voxel must lie above 0", 0 < self.baseline < 1e4 and 1e-4 < self.voxel < 1e3),
            ("sources, refining, labelling, others, views, seen and threads must be at least 1",
             min(self.sources, self.refining, self.labelling, self.others, self.views, self.seen, self.threads) >= 1),
            ("small and large must be 0 to 1000", 0 <= self.small <= 1000 and 0 <= self.large <= 1000),
            ("firm must be at least 1, witnesses at least 0", self.firm >= 1 and self.witnesses >= 0),
            ("apart must lie above 0, seen_through be 0 to 1", self.apart > 0 and 0 <= self.seen_through <= 1),
            ("fall, window, noise, finest and certain must lie above 0",
             min(self.fall, self.window, self.noise, self.finest, self.certain) > 0),
            ("steps must be 0 to 100", 0 <= self.steps <= 100),
        ):  # fmt: skip
            if not fine:
                raise InputError(f"Depth configuration: {what}; change it and try again.")
