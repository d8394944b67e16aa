"""Detects thin objects slightly above the floor by their edges, such as a bar or the rung of a trestle. They are too
thin for depth from images. Other images show their straight edges at the position for the true height, and not at the
position of a line on the floor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.perception.line_kernels import count_line_votes
from nvsim.perception.roles import Image

Float64 = NDArray[np.float64]
Cell = tuple[int, int]
_DOWN = 0.05  # downward component of a ray of unit depth; flatter rays meet the floor too far away


@dataclass(frozen=True)
class LineConfig:
    """longest_side  pixels, longer side of the images in which segments are detected
    shortest      pixels, least length of a segment
    shortest_line  meters, least length of a segment projected onto the floor
    heights       meters above the floor that are tested for a line, besides the floor itself
    lowest        meters; lower lines are detected, so that they explain their segments, but are no obstacle
    reach         meters, greatest horizontal distance from a camera to a line
    apart         meters, least and greatest distance between a camera and those that check its lines
    most          greatest number of cameras that check a line, spread over that distance
    tolerance     pixels, greatest distance between a segment and a line
    parallax      pixels between the line at a height and on the floor that an image needs to tell them apart
    asked         least number of images that can tell a line's height from the floor
    shown         least number of those images that show the line at its height
    share         least share of those images that show the line at its height
    on_floor      greatest share of those images that show the line on the floor instead
    cell          meters, edge of the cells in which lines of several images must agree
    level         meters, greatest difference of their heights
    places        least number of cameras, `spread` meters apart, whose lines agree in a cell
    spread        meters, see `places`
    overlap       least share of a line that agreeing cells cover, so that the line extends them
    """

    longest_side: int = 640
    shortest: float = 15.0
    shortest_line: float = 0.1
    heights: tuple[float, ...] = (0.04, 0.06, 0.08, 0.1, 0.125, 0.15, 0.18, 0.21, 0.25, 0.3, 0.35, 0.4)
    lowest: float = 0.1
    reach: float = 4.5
    apart: tuple[float, float] = (0.15, 3.5)
    most: int = 48
    tolerance: float = 1.5
    parallax: float = 3.0
    asked: int = 5
    shown: int = 4
    share: float = 0.5
    on_floor: float = 0.25
    cell: float = 0.05
    level: float = 0.04
    places: int = 5
    spread: float = 0.25
    overlap: float = 0.5


@dataclass(frozen=True, eq=False)
class RaisedLines:
    """start, end  (N, 2) meters, world, horizontal position of the ends
    height      (N,) meters above the floor
    camera      (N,) index of the camera that saw the line
    """

    start: Float64
    end: Float64
    height: Float64
    camera: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.height)


def raised_lines(
    cameras: Sequence[Camera],
    read: Callable[[int], Image],
    floors: Float64,
    config: LineConfig | None = None,
    threads: int = 1,
    progress: Callable[[], None] = lambda: None,
    usable_of: Callable[[int], NDArray[np.bool_] | None] = lambda index: None,
) -> RaisedLines:
    """Lines above the floor in the images of `cameras`. A line of a single camera can be an error; `thin_object_places`
    keeps those on which several cameras agree.

    read       gives the image (H, W, 3) uint8 RGB of a camera, of any size
    floors     (N,) meters, height of the floor below each camera, NaN to skip the camera
    usable_of  gives the valid pixels (H, W) bool of an image, None for all
    progress   is called after each camera

    Errors raised by `read` are passed on.
    """
    config = config or LineConfig()
    with ThreadPoolExecutor(threads) as pool:
        segments = list(pool.map(lambda i: _segments(read(i), config.shortest, usable_of(i)), range(len(cameras))))
        positions = np.array([c.position for c in cameras]).reshape(-1, 3)
        found = []
        for lines in pool.map(
            lambda i: _of_camera(i, cameras, positions, segments, float(floors[i]), config), range(len(cameras))
        ):
            found.append(lines)
            progress()
    rows = np.concatenate([np.zeros((0, 6)), *found])
    return RaisedLines(rows[:, 0:2], rows[:, 2:4], rows[:, 4], rows[:, 5].astype(np.int64))


def _segments(image: Image, shortest: float, usable: NDArray[np.bool_] | None) -> Float64:
    """(n, 4) x0 y0 x1 y1, pixels: straight edges by the LSD detector (von Gioi et al., 2012), with both ends and the
    middle on `usable` pixels (H, W)."""
    import cv2

    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))[0]
    if found is None:
        return np.zeros((0, 4))
    segments = found.reshape(-1, 4).astype(np.float64) + 0.5  # pixel centers are at halves
    long = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]) >= shortest
    if usable is not None:
        height, width = usable.shape
        for place in (segments[:, :2], segments[:, 2:], (segments[:, :2] + segments[:, 2:]) / 2):
            column, row = place.astype(np.int64).clip(0, (width - 1, height - 1)).T
            long &= usable[row, column]
    return np.ascontiguousarray(segments[long])


def _of_camera(
    index: int, cameras: Sequence[Camera], positions: Float64, segments: Sequence[Float64], floor: float, c: LineConfig
) -> Float64:
    """(n, 6) the lines above the floor that the segments of one camera show: start, end, height, and `index`."""
    camera, apart = cameras[index], np.linalg.norm(positions - positions[index], axis=1)
    near = np.flatnonzero((apart > c.apart[0]) & (apart < c.apart[1]))
    near = near[np.argsort(apart[near], kind="stable")]
    if len(near) > c.most:
        near = near[np.linspace(0, len(near) - 1, c.most).astype(np.int64)]
    starts, ends = _segments_above(camera, segments[index], floor, c)
    if not len(near) or not len(starts):
        return np.zeros((0, 6))
    asked, shown, on_floor = (np.zeros(starts.shape[:2], np.int64) for _ in range(3))
    for other in near.tolist():
        k, pose = cameras[other].intrinsics, np.ascontiguousarray(cameras[other].world_to_camera)
        lens = np.array([k.fx, k.fy, k.cx, k.cy, k.width, k.height], np.float64)
        count_line_votes(starts, ends, pose, lens, segments[other], c.tolerance, c.parallax, asked, shown, on_floor)
    best = np.where(asked >= c.asked, shown - on_floor, -1)[:, 1:].argmax(axis=1) + 1
    line = np.arange(len(best))
    asked, shown, on_floor = asked[line, best], shown[line, best], on_floor[line, best]
    sure = (asked >= c.asked) & (shown >= c.shown) & (shown >= c.share * asked) & (on_floor <= c.on_floor * asked)
    rows = starts[line, best, :2], ends[line, best, :2], np.array([0.0, *c.heights])[best], np.full(len(best), index)
    return np.column_stack(rows)[sure]


def _segments_above(camera: Camera, segments: Float64, floor: float, c: LineConfig) -> tuple[Float64, Float64]:
    """The starts and the ends (n, 1 + heights, 3) of the segments (m, 4) that can be near the floor. The first are on
    the floor, the others at the heights `c.heights` above it."""
    k, height = camera.intrinsics, camera.position[2] - floor
    pixels = segments.reshape(-1, 2, 2)
    local = np.concatenate([(pixels - [k.cx, k.cy]) / [k.fx, k.fy], np.ones((len(pixels), 2, 1))], axis=2)
    rays = local @ camera.rotation.T
    down = rays[..., 2] < -_DOWN
    meters = height / np.where(down, -rays[..., 2], 1.0)
    places = meters[..., None] * rays
    near = down.all(axis=1) & (np.hypot(places[..., 0], places[..., 1]) < c.reach).all(axis=1)
    near &= np.hypot(*(places[:, 1] - places[:, 0])[:, :2].T) > c.shortest_line
    if not np.isfinite(floor) or height <= max(c.heights):
        near[:] = False
    share = 1 - np.array([0.0, *c.heights]) / max(height, 1e-9)
    found = camera.position + share[:, None] * places[near][:, :, None]
    return np.ascontiguousarray(found[:, 0]), np.ascontiguousarray(found[:, 1])


def thin_object_places(lines: RaisedLines, positions: Float64, config: LineConfig | None = None) -> Float64:
    """(K, 2) meters, world: centers of the cells in which a thin object is above the floor.

    `lines` of several cameras, at `positions` (N, 3), must agree there, because a pattern of planks or tiles can
    mislead a single camera. A line that continues such cells at their height is part of that object."""
    c = config or LineConfig()
    cells = [_cells(start, end, c.cell) for start, end in zip(lines.start, lines.end, strict=True)]
    known = _heights_by_agreement(cells, lines, positions, c)
    taken = np.zeros(len(lines), bool)
    while True:
        new = []
        for i in np.flatnonzero(~taken):
            along = sum(_is_known_near(known, cell, float(lines.height[i]), c.level) for cell in cells[i])
            if along >= max(2, c.overlap * len(cells[i])):
                new.append(i)
        if not new:
            break
        for i in new:
            taken[i] = True
            for cell in cells[i]:
                known.setdefault(cell, float(lines.height[i]))
    high = [cell for cell, height in known.items() if height > c.lowest]
    return (np.array(sorted(high), np.float64).reshape(-1, 2) + 0.5) * c.cell


def _cells(start: Float64, end: Float64, edge: float) -> list[Cell]:
    count = max(2, int(2 * np.hypot(*(end - start)) / edge) + 1)
    places = start + np.linspace(0, 1, count)[:, None] * (end - start)
    return [(int(x), int(y)) for x, y in np.unique(np.floor(places / edge).astype(np.int64), axis=0)]


def _adjacent_cells(cell: Cell) -> list[Cell]:
    return [(cell[0] + x, cell[1] + y) for x in (-1, 0, 1) for y in (-1, 0, 1)]


def _is_known_near(known: dict[Cell, float], cell: Cell, height: float, level: float) -> bool:
    """Whether `cell` or a cell beside it is known at about that height."""
    return any(abs(known[at] - height) <= level + 1e-9 for at in _adjacent_cells(cell) if at in known)


def _heights_by_agreement(
    cells: list[list[Cell]], lines: RaisedLines, positions: Float64, c: LineConfig
) -> dict[Cell, float]:
    """Cell -> height, for cells in which lines from enough camera places have about one height."""
    seen: dict[Cell, list[int]] = {}
    for i, of_line in enumerate(cells):
        for cell in of_line:
            seen.setdefault(cell, []).append(i)
    found: dict[Cell, float] = {}
    for cell in seen:
        near = np.array(sorted({i for at in _adjacent_cells(cell) for i in seen.get(at, ())}))
        if len(near) < c.places:
            continue
        best = 0
        for height in np.unique(lines.height[near]):
            alike = near[np.abs(lines.height[near] - height) <= c.level + 1e-9]
            count = _count_spread_places(positions[np.unique(lines.camera[alike]), :2], c.spread)
            if count > best:
                best, at = count, float(height)
        if best >= c.places:
            found[cell] = at
    return found


def _count_spread_places(places: Float64, apart: float) -> int:
    """The number of places (n, 2), selected in order, that are more than `apart` from those selected earlier."""
    kept = np.zeros((0, 2))
    for place in places:
        if not len(kept) or np.hypot(*(kept - place).T).min() > apart:
            kept = np.vstack([kept, place])
    return len(kept)
