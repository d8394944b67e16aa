"""Thin things that stand a little above the floor, a bar or the rung of a trestle, found by their edges: too thin for
the depth of images, their straight edges are seen again in other images where they would be at their height, and not
where a line on the floor would be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.perception.line_kernels import ask
from nvsim.perception.roles import Image

Float64 = NDArray[np.float64]
Cell = tuple[int, int]
_DOWN = 0.05  # of a ray of unit depth; a flatter one meets the floor too far away to tell


@dataclass(frozen=True)
class LineConfig:
    """longest_side  pixels of the images that segments are looked for in
    shortest      pixels of a segment, and
    shortest_line  metres of what it would be on the floor
    heights       metres above the floor that a line may be at, beside the floor itself
    lowest        metres; lower ones are seen, so that nothing is taken for them, and stepped over
    reach         metres from a camera to a line, seen from above
    apart         metres from a camera to those that are asked about its lines, from and to
    most          cameras that are asked, spread over that distance
    tolerance     pixels that a segment may lie beside a line
    parallax      pixels by which an image must tell a height from the floor
    asked, shown  images that must be able to tell, and that must show the line at its height,
    share         the share of the former that must do so, and
    on_floor      the share that may show it on the floor instead
    cell          metres: edge of the cells in which lines of several images agree
    level         metres by which their heights may differ
    places        cameras, `spread` metres apart, whose lines must agree in a cell,
    overlap       and the share of another line that such cells must cover for it to go on with them
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
    """start, end  (N, 2) metres, world, seen from above
    height      (N,) metres above the floor
    camera      (N,) which saw it
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
    """Of what the `cameras` see: `read` gives the image (H, W, 3) uint8 RGB of one, of its own size, and `floors` (N,)
    is the height of the floor beneath each, NaN for those to be left out; `usable_of` gives the pixels (H, W) of an
    image that count, None for all. `progress` is called after each camera.
    Whether such a line is a thing, only several of them say: see `standing_places`. What `read` raises is passed on."""
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
    """(n, 4) x0 y0 x1 y1, pixels: straight edges, by the detector of von Gioi et al. (LSD, 2012), of which both ends
    and the middle are `usable`."""
    import cv2

    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))[0]
    if found is None:
        return np.zeros((0, 4))
    segments = found.reshape(-1, 4).astype(np.float64) + 0.5  # pixel centres lie at halves
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
    """(n, 6) the lines that a camera's segments are, above the floor: start, end, height and `index`."""
    camera, apart = cameras[index], np.linalg.norm(positions - positions[index], axis=1)
    near = np.flatnonzero((apart > c.apart[0]) & (apart < c.apart[1]))
    near = near[np.argsort(apart[near], kind="stable")]
    if len(near) > c.most:
        near = near[np.linspace(0, len(near) - 1, c.most).astype(np.int64)]
    starts, ends = _above(camera, segments[index], floor, c)
    if not len(near) or not len(starts):
        return np.zeros((0, 6))
    asked, shown, on_floor = (np.zeros(starts.shape[:2], np.int64) for _ in range(3))
    for other in near.tolist():
        k, pose = cameras[other].intrinsics, np.ascontiguousarray(cameras[other].world_to_camera)
        lens = np.array([k.fx, k.fy, k.cx, k.cy, k.width, k.height], np.float64)
        ask(starts, ends, pose, lens, segments[other], c.tolerance, c.parallax, asked, shown, on_floor)
    best = np.where(asked >= c.asked, shown - on_floor, -1)[:, 1:].argmax(axis=1) + 1
    line = np.arange(len(best))
    asked, shown, on_floor = asked[line, best], shown[line, best], on_floor[line, best]
    sure = (asked >= c.asked) & (shown >= c.shown) & (shown >= c.share * asked) & (on_floor <= c.on_floor * asked)
    rows = starts[line, best, :2], ends[line, best, :2], np.array([0.0, *c.heights])[best], np.full(len(best), index)
    return np.column_stack(rows)[sure]


def _above(camera: Camera, segments: Float64, floor: float, c: LineConfig) -> tuple[Float64, Float64]:
    """(n, 1 + heights, 3) where the segments (m, 4) that may be near the floor begin, and where they end, if they lie
    on it and if they are as high above it as `c.heights` says."""
    k, height = camera.intrinsics, camera.position[2] - floor
    pixels = segments.reshape(-1, 2, 2)
    local = np.concatenate([(pixels - [k.cx, k.cy]) / [k.fx, k.fy], np.ones((len(pixels), 2, 1))], axis=2)
    rays = local @ camera.rotation.T
    down = rays[..., 2] < -_DOWN
    metres = height / np.where(down, -rays[..., 2], 1.0)
    places = metres[..., None] * rays
    near = down.all(axis=1) & (np.hypot(places[..., 0], places[..., 1]) < c.reach).all(axis=1)
    near &= np.hypot(*(places[:, 1] - places[:, 0])[:, :2].T) > c.shortest_line
    if not np.isfinite(floor) or height <= max(c.heights):
        near[:] = False
    share = 1 - np.array([0.0, *c.heights]) / max(height, 1e-9)
    found = camera.position + share[:, None] * places[near][:, :, None]
    return np.ascontiguousarray(found[:, 0]), np.ascontiguousarray(found[:, 1])


def standing_places(lines: RaisedLines, positions: Float64, config: LineConfig | None = None) -> Float64:
    """(K, 2) metres, world: the middles of cells in which something thin stands above the floor. `lines` of several
    cameras, at `positions` (N, 3), must agree there, for the pattern of a floor of planks or tiles can pass for a
    single one; a line that goes on with such cells, at their height, belongs to the same thing."""
    c = config or LineConfig()
    cells = [_cells(start, end, c.cell) for start, end in zip(lines.start, lines.end, strict=True)]
    known = _agreed(cells, lines, positions, c)
    taken = np.zeros(len(lines), bool)
    while True:
        new = []
        for i in np.flatnonzero(~taken):
            along = sum(_has(known, cell, float(lines.height[i]), c.level) for cell in cells[i])
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


def _around(cell: Cell) -> list[Cell]:
    return [(cell[0] + x, cell[1] + y) for x in (-1, 0, 1) for y in (-1, 0, 1)]


def _has(known: dict[Cell, float], cell: Cell, height: float, level: float) -> bool:
    """Whether a cell beside `cell`, or it itself, is known at about that height."""
    return any(abs(known[at] - height) <= level + 1e-9 for at in _around(cell) if at in known)


def _agreed(cells: list[list[Cell]], lines: RaisedLines, positions: Float64, c: LineConfig) -> dict[Cell, float]:
    """cell -> height, where lines seen from enough places are at about one height."""
    seen: dict[Cell, list[int]] = {}
    for i, of_line in enumerate(cells):
        for cell in of_line:
            seen.setdefault(cell, []).append(i)
    found: dict[Cell, float] = {}
    for cell in seen:
        near = np.array(sorted({i for at in _around(cell) for i in seen.get(at, ())}))
        if len(near) < c.places:
            continue
        best = 0
        for height in np.unique(lines.height[near]):
            alike = near[np.abs(lines.height[near] - height) <= c.level + 1e-9]
            count = _spread(positions[np.unique(lines.camera[alike]), :2], c.spread)
            if count > best:
                best, at = count, float(height)
        if best >= c.places:
            found[cell] = at
    return found


def _spread(places: Float64, apart: float) -> int:
    """How many of the places (n, 2), taken in order, are that far apart from those taken before."""
    kept = np.zeros((0, 2))
    for place in places:
        if not len(kept) or np.hypot(*(kept - place).T).min() > apart:
            kept = np.vstack([kept, place])
    return len(kept)
