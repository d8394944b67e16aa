"""Renders frames of the building: color with reflections and people, exact depth, and the surface in every pixel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nvsim.building.baking import LEVELS, Textures
from nvsim.building.raycast import NOTHING, Solids, normal, trace
from nvsim.geometry.camera import Camera
from nvsim.kernels import njit, prange

_PROBES = 5  # texture samples along the longer axis of a pixel's footprint
_COARSE = 4  # reflections are computed for blocks of this many pixels, which also blurs them


class View(NamedTuple):
    """A rendered frame.

    color    (H, W, 3) float32, 0 to 1
    depth    (H, W) float32, meters along the optical axis, of the surface behind glass
    surface  (H, W) int32, see `raycast.Solids`
    """

    color: NDArray[np.float32]
    depth: NDArray[np.float32]
    surface: NDArray[np.int32]


def render(
    camera: Camera,
    solids: Solids,
    textures: Textures,
    people: NDArray[np.float64],
    clothes: NDArray[np.float64],
) -> View:
    """Renders one frame; people (P, 5) are capsules as in `raycast.trace`, clothes (P, 3) their colors, 0 to 1."""
    k = camera.intrinsics
    lens = np.array([k.fx, k.fy, k.cx, k.cy])
    pose = np.ascontiguousarray(camera.camera_to_world)
    coarse = k.height // _COARSE + 2, k.width // _COARSE + 2
    mirrored = _mirror(pose, lens, *coarse, solids, textures, people, clothes)
    view = View(
        np.empty((k.height, k.width, 3), np.float32),
        np.empty((k.height, k.width), np.float32),
        np.empty((k.height, k.width), np.int32),
    )
    _first_pass(pose, lens, solids, textures, people, clothes, mirrored, *view)
    _smooth_edges(pose, lens, solids, textures, people, clothes, mirrored, *view)
    return view


@njit(cache=True, error_model="numpy")
def _filter_samples(texels, base, rows, columns, u, v, step_u, step_v, probes):  # type: ignore[no-untyped-def]
    """The mean of `probes` bilinear samples of one level, in steps about (u, v); coordinates are 0 to 1."""
    red, green, blue = 0.0, 0.0, 0.0
    for k in range(probes):
        s = k + 0.5 * (1 - probes)
        fx = min(max((u + s * step_u) * columns - 0.5, 0.0), columns - 1.0)
        fy = min(max((v + s * step_v) * rows - 0.5, 0.0), rows - 1.0)
        column, row = int(fx), int(fy)
        fx, fy = fx - column, fy - row
        p = base + row * columns + column
        q = p + (columns if row + 1 < rows else 0)
        r = 1 if column + 1 < columns else 0
        a, b, c, d = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
        red += a * texels[p, 0] + b * texels[p + r, 0] + c * texels[q, 0] + d * texels[q + r, 0]
        green += a * texels[p, 1] + b * texels[p + r, 1] + c * texels[q, 1] + d * texels[q + r, 1]
        blue += a * texels[p, 2] + b * texels[p + r, 2] + c * texels[q, 2] + d * texels[q + r, 2]
    share = 1.0 / (255.0 * probes)
    return red * share, green * share, blue * share


@njit(cache=True, error_model="numpy")
def radiance(x, y, z, dx, dy, dz, t, surface, spread, solids, textures, people, clothes):  # type: ignore[no-untyped-def]
    """The color of the surface point that a ray hits after t meters; `spread` is the width of the ray per meter."""
    boxes = solids.lo.shape[0]
    if surface == NOTHING:
        return 0.0, 0.0, 0.0
    built = 6 * boxes + 2 * solids.levels.shape[0]
    if surface >= built:
        p = surface - built
        middle = min(max(z, people[p, 2]), people[p, 3])
        nx, ny, nz = (x - people[p, 0]) / people[p, 4], (y - people[p, 1]) / people[p, 4], (z - middle) / people[p, 4]
        lit = 0.62 + 0.22 * nz + 0.10 * nx + 0.06 * ny
        return clothes[p, 0] * lit, clothes[p, 1] * lit, clothes[p, 2] * lit
    nx, ny, nz = normal(surface, boxes)
    if abs(nx) > 0.5:
        a, b, da, db = y, z, dy, dz
    elif abs(ny) > 0.5:
        a, b, da, db = x, z, dx, dz
    else:
        a, b, da, db = x, y, dx, dy
    facing = max(abs(nx * dx + ny * dy + nz * dz), 0.02)
    u = (a - textures.place[surface, 0]) / textures.place[surface, 2]
    v = (b - textures.place[surface, 1]) / textures.place[surface, 3]
    short = t * spread
    long = short / facing
    probes = min(max(int(long / short + 0.5), 1), _PROBES)
    # The footprint is a strip along the ray's trace on the surface; each probe covers its share of it
    level = np.log2(max(max(short, long / probes) / textures.place[surface, 4], 1e-6))
    level = min(max(level, 0.0), LEVELS - 1.001)
    lowest = int(level)
    length = np.sqrt(da * da + db * db) + 1e-9
    step_u = long * da / length / textures.place[surface, 2] / probes
    step_v = long * db / length / textures.place[surface, 3] / probes
    share = level - lowest
    c = textures.chain
    r0, g0, b0 = _filter_samples(
        textures.texels, c[surface, lowest, 0], c[surface, lowest, 1], c[surface, lowest, 2],
        u, v, step_u, step_v, probes,
    )  # fmt: skip
    if share < 0.02:
        return r0, g0, b0
    lowest += 1
    r1, g1, b1 = _filter_samples(
        textures.texels, c[surface, lowest, 0], c[surface, lowest, 1], c[surface, lowest, 2],
        u, v, step_u, step_v, probes,
    )  # fmt: skip
    return r0 + share * (r1 - r0), g0 + share * (g1 - g0), b0 + share * (b1 - b0)


@njit(cache=True, error_model="numpy")
def _ray(px, py, pose, lens):  # type: ignore[no-untyped-def]
    """The unit direction through a pixel position and its component along the optical axis."""
    a, b = (px - lens[2]) / lens[0], (py - lens[3]) / lens[1]
    scale = 1.0 / np.sqrt(a * a + b * b + 1.0)
    dx = (pose[0, 0] * a + pose[0, 1] * b + pose[0, 2]) * scale
    dy = (pose[1, 0] * a + pose[1, 1] * b + pose[1, 2]) * scale
    dz = (pose[2, 0] * a + pose[2, 1] * b + pose[2, 2]) * scale
    return dx, dy, dz, scale


@njit(cache=True, error_model="numpy")
def _storey(z, solids):  # type: ignore[no-untyped-def]
    """The storey that contains a height."""
    k = 0
    while k + 1 < solids.levels.shape[0] and z > solids.levels[k + 1, 0]:
        k += 1
    return k


@njit(cache=True, error_model="numpy")
def _mirrored_at(mirrored, px, py):  # type: ignore[no-untyped-def]
    """The coarse mirror image at a pixel position, bilinear."""
    fx = min(max(px / _COARSE + 0.5, 0.0), mirrored.shape[1] - 1.001)
    fy = min(max(py / _COARSE + 0.5, 0.0), mirrored.shape[0] - 1.001)
    c, q = int(fx), int(fy)
    fx, fy = fx - c, fy - q
    w00, w01, w10, w11 = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
    c1, q1, m = c + 1, q + 1, mirrored
    r = w00 * m[q, c, 0] + w01 * m[q, c1, 0] + w10 * m[q1, c, 0] + w11 * m[q1, c1, 0]
    g = w00 * m[q, c, 1] + w01 * m[q, c1, 1] + w10 * m[q1, c, 1] + w11 * m[q1, c1, 1]
    b = w00 * m[q, c, 2] + w01 * m[q, c1, 2] + w10 * m[q1, c, 2] + w11 * m[q1, c1, 2]
    return r, g, b


@njit(cache=True, error_model="numpy")
def _pane_faces_x(x, y, z, solids):  # type: ignore[no-untyped-def]
    """Whether the glass at a point is thin along x."""
    for k in solids.panes:
        if (
            solids.lo[k, 0] - 1e-3 < x < solids.hi[k, 0] + 1e-3
            and solids.lo[k, 1] - 1e-3 < y < solids.hi[k, 1] + 1e-3
            and solids.lo[k, 2] - 1e-3 < z < solids.hi[k, 2] + 1e-3
        ):
            return solids.hi[k, 0] - solids.lo[k, 0] < solids.hi[k, 1] - solids.lo[k, 1]
    return True


@njit(cache=True, error_model="numpy")
def _in_the_pane(x, y, z, dx, dy, dz, distance, spread, solids, textures, people, clothes):  # type: ignore[no-untyped-def]
    """The share of light that glass reflects at a point that a ray hits after `distance` meters, and its color."""
    along_x = _pane_faces_x(x, y, z, solids)
    cosine = abs(dx) if along_x else abs(dy)
    share = 0.04 + 0.5 * (1.0 - cosine) ** 5
    mx, my = (-dx, dy) if along_x else (dx, -dy)
    t, surface, _ = trace(x + 0.03 * mx, y + 0.03 * my, z, mx, my, dz, solids, people)
    r, g, b = radiance(
        x + t * mx, y + t * my, z + t * dz, mx, my, dz, distance + t, surface, 3 * spread,
        solids, textures, people, clothes,
    )  # fmt: skip
    return share, r, g, b


@njit(cache=True, error_model="numpy")
def _trace_pixel(px, py, pose, lens, spread, solids, textures, people, clothes, mirrored):  # type: ignore[no-untyped-def]
    """Color, depth, and surface at a pixel position. The color includes the gloss of the floor and glass in front."""
    ox, oy, oz = pose[0, 3], pose[1, 3], pose[2, 3]
    dx, dy, dz, scale = _ray(px, py, pose, lens)
    t, surface, glass = trace(ox, oy, oz, dx, dy, dz, solids, people)
    x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
    r, g, b = radiance(x, y, z, dx, dy, dz, t, surface, spread, solids, textures, people, clothes)
    storey = _storey(oz, solids)
    if surface == 6 * solids.lo.shape[0] + 2 * storey:
        row = min(max(int(y / textures.gloss_texel), 0), textures.gloss.shape[1] - 1)
        column = min(max(int(x / textures.gloss_texel), 0), textures.gloss.shape[2] - 1)
        gloss = textures.gloss[storey, row, column]
        if gloss > 0:
            # Schlick's approximation for a dull varnish
            share = gloss * (0.03 + 0.45 * (1.0 + dz) ** 5)
            mr, mg, mb = _mirrored_at(mirrored, px, py)
            r, g, b = r + share * (mr - r), g + share * (mg - g), b + share * (mb - b)
    if glass < t:
        r, g, b = 0.93 * r, 0.96 * g, 0.95 * b
        share, r2, g2, b2 = _in_the_pane(
            ox + glass * dx,
            oy + glass * dy,
            oz + glass * dz,
            dx,
            dy,
            dz,
            glass,
            spread,
            solids,
            textures,
            people,
            clothes,
        )
        r, g, b = r + share * (r2 - r), g + share * (g2 - g), b + share * (b2 - b)
    return r, g, b, t * scale, surface


@njit(cache=True, parallel=True, error_model="numpy")
def _mirror(pose, lens, rows, columns, solids, textures, people, clothes):  # type: ignore[no-untyped-def]
    """(rows, columns, 3): the reflection in a mirror on the camera's floor, in coarse pixels, with a margin of one."""
    out = np.zeros((rows, columns, 3), np.float32)
    floor = solids.levels[_storey(pose[2, 3], solids), 0]
    spread = 2.0 * _COARSE / lens[0]
    for row in prange(rows):
        for column in range(columns):
            dx, dy, dz, _ = _ray((column - 0.5) * _COARSE, (row - 0.5) * _COARSE, pose, lens)
            if dz > -0.01:
                continue
            t = (floor - pose[2, 3]) / dz
            x, y = pose[0, 3] + t * dx, pose[1, 3] + t * dy
            s, surface, _ = trace(x, y, floor + 0.001, dx, dy, -dz, solids, people)
            out[row, column] = radiance(
                x + s * dx,
                y + s * dy,
                floor - s * dz,
                dx,
                dy,
                -dz,
                t + s,
                surface,
                spread,
                solids,
                textures,
                people,
                clothes,
            )
    return out


@njit(cache=True, parallel=True, error_model="numpy")
def _first_pass(pose, lens, solids, textures, people, clothes, mirrored, color, depth, surface):  # type: ignore[no-untyped-def]
    for row in prange(depth.shape[0]):
        for column in range(depth.shape[1]):
            r, g, b, t, hit = _trace_pixel(
                column + 0.5, row + 0.5, pose, lens, 1.0 / lens[0], solids, textures, people, clothes, mirrored
            )
            color[row, column, 0], color[row, column, 1], color[row, column, 2] = r, g, b
            depth[row, column], surface[row, column] = t, hit


@njit(cache=True, parallel=True, error_model="numpy")
def _smooth_edges(pose, lens, solids, textures, people, clothes, mirrored, color, depth, surface):  # type: ignore[no-untyped-def]
    """Averages 2 x 2 rays in the pixels with another surface in a neighboring pixel."""
    rows, columns = depth.shape
    for row in prange(rows):
        for column in range(columns):
            here = surface[row, column]
            if (
                here == surface[row, max(column - 1, 0)]
                and here == surface[row, min(column + 1, columns - 1)]
                and here == surface[max(row - 1, 0), column]
                and here == surface[min(row + 1, rows - 1), column]
            ):
                continue
            red, green, blue = 0.0, 0.0, 0.0
            for k in range(4):
                r, g, b, _, _ = _trace_pixel(
                    column + 0.25 + 0.5 * (k % 2), row + 0.25 + 0.5 * (k // 2), pose, lens, 1.0 / lens[0],
                    solids, textures, people, clothes, mirrored,
                )  # fmt: skip
                red, green, blue = red + r, green + g, blue + b
            color[row, column, 0] = red / 4
            color[row, column, 1] = green / 4
            color[row, column, 2] = blue / 4
