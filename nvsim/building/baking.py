"""Baked light: a texture of the radiance of every face of the building, with coarser copies (a mip chain).

Lamps are ceiling panels with inverse-square fall-off and shadows. The rest of the light is a constant, dimmed by the
share of the half space above a point that is obstructed (ambient occlusion). This also gives contact shadows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.building.painting import Image, paint_face, paint_floor
from nvsim.building.plan import HEIGHT, Plan, Storey
from nvsim.building.raycast import Solids, normal, trace
from nvsim.building.solids import BOTTOM, TOP, Box, Paint
from nvsim.kernels import njit, prange

LEVELS = 6
FloorPainter = Callable[[Plan, float, np.random.Generator], tuple[Image, NDArray[np.float32]]]
FacePainter = Callable[[Paint, tuple[float, float], float, float, float, np.random.Generator], Image]
CeilingPainter = Callable[[Plan, float, np.random.Generator], Image]
_FLOOR_TEXEL, _WALL_TEXEL, _FINE_TEXEL, _CEILING_TEXEL, _LIGHT_TEXEL = 0.01, 0.015, 0.0125, 0.04, 0.1
_LARGE = 1500.0  # square meters
_AMBIENT = 0.8
_LAMP = 0.3  # half the side of a lamp panel, meters


class Textures(NamedTuple):
    """Radiance of every surface (6 per box, then floor and ceiling of each storey). Texels are row-major from the lower
    corner.

    A surface that is never visible (hidden, or glass) has one black texel.
    """

    texels: NDArray[np.uint8]  # (N, 3) RGB
    chain: NDArray[np.int64]  # (S, LEVELS, 3): first texel, rows and columns of each level
    place: NDArray[np.float64]  # (S, 5) meters: lower corner and extent along the surface's two axes, texel at level 0
    gloss: NDArray[np.float32]  # (S, rows, columns) of the floors, with cells of `gloss_texel` meters
    gloss_texel: float


def lamp_places(storey: Storey) -> NDArray[np.float64]:
    """(L, 3) meters: one lamp per about 7 square meters of room, slightly below the ceiling. A flight of stairs has
    none, because it has no ceiling."""
    places = []
    for room in storey.plan.rooms:
        for r in room.rects if room.kind != "flight" else ():
            w, d = r.x1 - r.x0, r.y1 - r.y0
            across, up = max(1, round(w / 2.8)), max(1, round(d / 2.8))
            for i in range(across):
                for j in range(up):
                    x, y = r.x0 + (i + 0.5) * w / across, r.y0 + (j + 0.5) * d / up
                    places.append((x, y, storey.floor + HEIGHT - 0.02))
    return np.array(places)


def white_ceiling(plan: Plan, texel: float, rng: np.random.Generator) -> Image:
    """(rows, columns, 3) float32, 0 to 1: the albedo of the ceiling of `plan`, `texel` meters per texel."""
    rows, columns = round(plan.extent.y1 / texel), round(plan.extent.x1 / texel)
    return np.full((rows, columns, 3), (0.80, 0.80, 0.78), np.float32)


class Painters(NamedTuple):
    """Functions that paint floors, faces of boxes, and ceilings: see `painting.paint_floor`, `painting.paint_face`, and
    `white_ceiling`."""

    floor: FloorPainter = paint_floor
    face: FacePainter = paint_face
    ceiling: CeilingPainter = white_ceiling


def bake(
    storeys: tuple[Storey, ...],
    boxes: list[Box],
    solids: Solids,
    rng: np.random.Generator,
    painters: Painters = Painters(),  # noqa: B008  (a tuple cannot change)
) -> Textures:
    """Paints and lights every surface of the `boxes` and `storeys`."""
    texel = _floor_texel(storeys)
    places = _places(storeys, boxes, texel)
    lamps = [lamp_places(s) for s in storeys]
    light = _light(places, solids, np.concatenate(lamps))
    ground = 6 * len(boxes)
    gain = np.float32(0.92 / float(np.mean(light[ground])))

    def light_surface(albedo: Image, surface: int, boost: float = 1.0) -> Image:
        shade = _compress_highlights(light[surface] * np.float32(gain * boost))
        return np.asarray(albedo * _interpolate_light(shade, *albedo.shape[:2])[..., None], np.float32)

    # Painted, lit, and converted to bytes one by one, because a large building in floating point exceeds the memory.
    levels, glosses = [], []
    for k, storey in enumerate(storeys):
        floor, gloss = painters.floor(storey.plan, texel, rng)
        # Lamps are level with the ceiling and do not light it: it gets the light reflected by the floor
        ceiling = light_surface(painters.ceiling(storey.plan, _CEILING_TEXEL, rng), ground + 2 * k + 1, 1.45)
        for x, y, _ in lamps[k]:
            r0, r1, c0, c1 = (round(v / _CEILING_TEXEL) for v in (y - _LAMP, y + _LAMP, x - _LAMP, x + _LAMP))
            ceiling[r0:r1, c0:c1] = 0.97
        levels += [_mips(light_surface(floor, ground + 2 * k)), _mips(ceiling)]
        glosses.append(gloss)
    faces = []
    for surface, place in enumerate(places[:ground]):
        box = boxes[surface // 6]
        albedo = _albedo(box, surface % 6, place, _base(box, storeys), rng, painters.face)
        faces.append([np.zeros((1, 1, 3), np.uint8)] if albedo is None else _mips(light_surface(albedo, surface)))
    return _pack_textures(faces + levels, places, np.stack(glosses), texel)


def _floor_texel(storeys: tuple[Storey, ...]) -> float:
    """Meters; twice as large for a large building."""
    return _FLOOR_TEXEL * (2 if storeys[0].plan.extent.area > _LARGE else 1)


def _compress_highlights(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Light with highlights compressed above 0.9, so that a pale wall beside a lamp keeps its shading."""
    over = np.maximum(light - 0.9, 0)
    return np.asarray(np.minimum(light, 0.9) + 0.25 * (1 - np.exp(-over / 0.25)), np.float32)


class _FaceRectangle(NamedTuple):
    """A surface as a rectangle: its lower corner, the two axes along it, its extent, and the texel size; meters."""

    corner: tuple[float, float, float]
    axes: tuple[int, int]
    extent: tuple[float, float]
    texel: float
    hidden: bool = False


def _base(box: Box, storeys: tuple[Storey, ...]) -> float:
    """The floor of the storey that contains a box, meters; painted heights are above it."""
    return max(s.floor for s in storeys if s.floor <= box.lo[2] or s is storeys[0])


def _places(storeys: tuple[Storey, ...], boxes: list[Box], floor_texel: float) -> list[_FaceRectangle]:
    places = []
    floors, ceilings = [s.floor for s in storeys], [s.floor + HEIGHT for s in storeys]
    for box in boxes:
        for face in range(6):
            axis = face // 2
            u, v = [k for k in range(3) if k != axis]
            corner = list(box.lo)
            corner[axis] = box.lo[axis] if face % 2 == 0 else box.hi[axis]
            extent = (box.hi[u] - box.lo[u], box.hi[v] - box.lo[v])
            texel = _WALL_TEXEL if box.hi[2] in ceilings else _FINE_TEXEL
            buried = (face == BOTTOM and box.lo[2] in floors) or (face == TOP and box.hi[2] in ceilings)
            hidden = box.glass or buried
            places.append(_FaceRectangle((corner[0], corner[1], corner[2]), (u, v), extent, texel, hidden))
    size = (storeys[0].plan.extent.x1, storeys[0].plan.extent.y1)
    for floor, ceiling in zip(floors, ceilings):
        places.append(_FaceRectangle((0.0, 0.0, floor), (0, 1), size, floor_texel))
        places.append(_FaceRectangle((0.0, 0.0, ceiling), (0, 1), size, _CEILING_TEXEL))
    return places


def _albedo(
    box: Box, face: int, place: _FaceRectangle, base: float, rng: np.random.Generator, paint: FacePainter
) -> Image | None:
    if place.hidden:
        return None
    at = place.corner[place.axes[0]], place.corner[place.axes[1]] - (base if place.axes[1] == 2 else 0.0)
    return paint(box.face_paint(face), at, place.extent[0], place.extent[1], place.texel, rng)


def _light(places: list[_FaceRectangle], solids: Solids, lamps: NDArray[np.float64]) -> list[NDArray[np.float32]]:
    """Relative irradiance on a coarse raster of every surface."""
    shapes = [
        (1 + max(1, round(p.extent[1] / _LIGHT_TEXEL)), 1 + max(1, round(p.extent[0] / _LIGHT_TEXEL))) for p in places
    ]
    points, surfaces = [], []
    for s, (place, (rows, columns)) in enumerate(zip(places, shapes)):
        if place.hidden:
            continue
        p = np.empty((rows, columns, 3))
        p[...] = place.corner
        p[..., place.axes[0]] += _nodes(place.extent[0], columns)[None, :]
        p[..., place.axes[1]] += _nodes(place.extent[1], rows)[:, None]
        points.append(p.reshape(-1, 3))
        surfaces.append(np.full(rows * columns, s, np.int32))
    flat = _irradiance(np.concatenate(points), np.concatenate(surfaces), solids, lamps, _hemisphere())
    out, at = [], 0
    for place, (rows, columns) in zip(places, shapes):
        count = 0 if place.hidden else rows * columns
        out.append(_blurred_inside(flat[at : at + count].reshape(rows, columns)) if count else flat[:0])
        at += count
    return out


def _nodes(length: float, count: int) -> NDArray[np.float64]:
    """(count,) positions from edge to edge, so that two pieces of one wall agree at their common edge. The ends are
    slightly inside, because a point exactly in a corner gets no light."""
    return np.clip(np.linspace(0.0, length, count), min(0.02, length / 4), length - min(0.02, length / 4))


def _blurred_inside(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Softer shadows; the border stays, so that neighboring faces still agree."""
    soft = light.copy()
    soft[1:-1, 1:-1] = cv2.blur(light, (3, 3))[1:-1, 1:-1]
    return soft


def _interpolate_light(light: NDArray[np.float32], rows: int, columns: int) -> NDArray[np.float32]:
    """(rows, columns) interpolated from values at nodes that extend from edge to edge."""
    x = ((np.arange(columns) + 0.5) * ((light.shape[1] - 1) / columns)).astype(np.float32)
    y = ((np.arange(rows) + 0.5) * ((light.shape[0] - 1) / rows)).astype(np.float32)
    x, y = np.meshgrid(x, y)
    return np.asarray(cv2.remap(light, x, y, cv2.INTER_LINEAR), np.float32)


def _hemisphere() -> NDArray[np.float64]:
    """(24, 3) directions about +z on a spiral, with density proportional to the cosine."""
    k = np.arange(24)
    radius, angle = np.sqrt((k + 0.5) / 24), k * np.pi * (3 - np.sqrt(5))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)])


@njit(cache=True, parallel=True, error_model="numpy")
def _irradiance(points, surfaces, solids, lamps, hemisphere):  # type: ignore[no-untyped-def]
    """(N,) float32: ambient light with occlusion within 1.5 m, and the lamps."""
    boxes = solids.lo.shape[0]
    nobody = np.empty((0, 5))
    out = np.empty(points.shape[0], np.float32)
    for i in prange(points.shape[0]):
        nx, ny, nz = normal(surfaces[i], boxes)
        x, y, z = points[i, 0] + 0.01 * nx, points[i, 1] + 0.01 * ny, points[i, 2] + 0.01 * nz
        open_sky = 0.0
        for k in range(hemisphere.shape[0]):
            a, b, c = hemisphere[k, 0], hemisphere[k, 1], hemisphere[k, 2]
            if abs(nx) > 0.5:
                dx, dy, dz = c * nx, a, b
            elif abs(ny) > 0.5:
                dx, dy, dz = a, c * ny, b
            else:
                dx, dy, dz = a, b, c * nz
            t, _, _ = trace(x, y, z, dx, dy, dz, solids, nobody)
            open_sky += min(t / 1.5, 1.0)
        total = _AMBIENT * (0.3 + 0.7 * open_sky / hemisphere.shape[0])
        for k in range(lamps.shape[0]):
            dx, dy, dz = lamps[k, 0] - x, lamps[k, 1] - y, lamps[k, 2] - z
            square = dx * dx + dy * dy + dz * dz
            if square > 36.0 or dz <= 0:
                continue
            d = np.sqrt(square)
            dx, dy, dz = dx / d, dy / d, dz / d
            facing = dx * nx + dy * ny + dz * nz
            if facing <= 0:
                continue
            t, _, _ = trace(x, y, z, dx, dy, dz, solids, nobody)
            if t >= d - 1e-3:
                fade = 1.0 - square / 36.0
                total += 1.9 * facing * dz / max(square, 0.3) * fade * fade
        out[i] = total
    return out


def _mips(radiance: Image) -> list[NDArray[np.uint8]]:
    chain: list[NDArray[Any]] = [radiance]
    while len(chain) < LEVELS and min(chain[-1].shape[:2]) >= 4:
        rows, columns = chain[-1].shape[:2]
        chain.append(cv2.resize(chain[-1], (columns // 2, rows // 2), interpolation=cv2.INTER_AREA))
    return [np.rint(np.clip(c, 0, 1) * 255).astype(np.uint8) for c in chain]


def _pack_textures(
    chains: list[list[NDArray[np.uint8]]], places: list[_FaceRectangle], gloss: NDArray[np.float32], gloss_texel: float
) -> Textures:
    table = np.zeros((len(chains), LEVELS, 3), np.int64)
    flat, at = [], 0
    for s, chain in enumerate(chains):
        for level in range(LEVELS):
            if level < len(chain):
                table[s, level:] = (at, *chain[level].shape[:2])
                flat.append(chain[level].reshape(-1, 3))
                at += len(flat[-1])
    place = np.array([(p.corner[p.axes[0]], p.corner[p.axes[1]], *p.extent, p.texel) for p in places])
    return Textures(np.concatenate(flat), table, place, gloss, gloss_texel)
