"""What the depth stage can be told."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class LabelConfig:
    """Costs in bits of the census.

    most      planes that compete in one image
    farthest  metres
    share     of the inverse depth by which a confirmed depth may be off, the unit of what it costs to differ
    differ    what that unit costs
    worst     a confirmed depth costs no plane more
    own       to keep a confirmed depth that no plane explains
    unknown   to leave a pixel without a depth
    window    pixels: images are compared in windows of this side
    change    price of a change of plane
    fall      grey levels: a step in the image by so much halves it
    """

    most: int = 24
    farthest: float = 20.0
    share: float = 0.02
    differ: float = 6.0
    worst: float = 30.0
    own: float = 20.0
    unknown: float = 14.0
    window: int = 7
    change: float = 40.0
    fall: float = 3.0


@dataclass(frozen=True)
class DepthConfig:
    """longest_side  pixels: images are shrunk so that neither side exceeds it
    planes        of the sweep, even in inverse depth
    nearest       metres: nothing nearer to a camera is looked for
    farthest      metres: nor beyond
    baseline      metres between two cameras that see depth best
    sources       neighbouring images that a frame is compared with
    threshold     grey levels by which a pixel is clearly brighter or darker than another
    small, large  price of a change of depth by one plane, and by more, in bits of the census
    fall          grey levels: a step in the image by so much halves the price of a step in depth
    window        pixels: standard deviation of the window in which depth between planes is found
    steps         of that
    noise         of the grey values, standard deviation
    margin        share by which the best depth is better than the next
    others        depth maps that one is compared with
    views         of them have to agree
    share, plane  they agree within this share of the inverse depth and this much, 1 / metres
    voxel         metres: edge of the cells in which the cloud is fused
    seen          a cell counts that was seen so often
    threads       frames in hand at the same time
    labels        how bare surfaces are given to the planes of the building
    """

    longest_side: int = 400
    planes: int = 144
    nearest: float = 0.5
    farthest: float = 20.0
    baseline: float = 0.6
    sources: int = 4
    threshold: float = 1.5
    small: int = 4
    large: float = 60.0
    fall: float = 4.0
    window: float = 2.0
    steps: int = 1
    noise: float = 2.0
    margin: float = 0.02
    others: int = 8
    views: int = 2
    share: float = 0.03
    plane: float = 0.003
    voxel: float = 0.03
    seen: int = 3
    threads: int = 2
    labels: LabelConfig = field(default_factory=LabelConfig)
