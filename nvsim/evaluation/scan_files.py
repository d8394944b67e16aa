"""Check the files of an exported scan, and the directions of its strips, independently of the export.

The sampler is written from the layout's table of faces and does not use `nvsim.geometry.directions`, so that each can
test the other. It samples a strip as Matterport3DSimulator does: bilinearly on the nearest cube face, without
blending across borders. Source: Matterport3DSimulator, MatterSim.cpp, with whose images the result was compared.
"""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import decode
from nvsim.errors import InputError, value_text
from nvsim.files.opening import is_regular, read_bytes
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.directions import HEIGHT, NAMES, WIDTH, face_axes
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.rotation import rotation_angle
from nvsim.graph.connectivity import SUFFIX, read_connectivity, read_scans, truncated_last_name
from nvsim.graph.types import NavGraph
from nvsim.r2r.observations.export import GRAPH, PLANS, UNSEEN
from nvsim.r2r.observations.layout import ScanPlaces, jpeg
from nvsim.r2r.observations.record import FinishedPart, part_of, read_manifest
from nvsim.r2r.observations.skybox import focal_of, read_depth, skybox_of
from nvsim.r2r.observations.surround import draw_surround
from nvsim.splats import harmonics
from nvsim.splats.types import Background, Gaussians, SubmapModel


class ScanFiles:
    """An exported scan on disk, and its defects.

    settings   settings of the export
    graph      content of the connectivity file
    """

    def __init__(self, places: ScanPlaces) -> None:
        """Raises InputError if there is no finished export, or its manifest or connectivity file cannot be read."""
        if places.journal.exists():
            raise InputError(f"The export of {places.folder} is not finished; run the same `nvsim export scan` again.")
        manifest = read_manifest(places.manifest)
        if not manifest:
            raise InputError(f"{places.folder} has no manifest.json; name the folder of `nvsim export scan`.")
        self.places = places
        self.settings: dict[str, Any] = manifest.get("settings", {})
        try:
            self.parts: dict[str, FinishedPart] = {name: part_of(data) for name, data in manifest["parts"].items()}
            self.size, self.quality = int(self.settings["size"]), int(self.settings["quality"])
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise InputError(f"{places.manifest} is damaged; export the scan again.") from error
        self.graph: NavGraph = read_connectivity(places.connectivity)

    @property
    def viewpoints(self) -> list[str]:
        """Ids of the exported viewpoints."""
        return [name for name in self.parts if name not in (GRAPH, PLANS, UNSEEN)]

    def problems(self) -> list[str]:
        """One sentence per defect."""
        found = []
        listed = self.places.scans
        names = read_scans(listed) if listed.is_file() else []
        cut = truncated_last_name(listed) if names else None
        if cut is not None:
            found.append(f"The last line of {listed}, {value_text(cut)}, is incomplete; run `nvsim export scan` again.")
        for name in names:
            if name != cut and not is_regular(self.places.graphs / f"{name}{SUFFIX}"):
                found.append(
                    f"{listed} lists {value_text(name)} without its connectivity file, so simulators stop there."
                )
        if self.places.scan not in names:
            found.append(f"{listed} does not list {self.places.scan}; run `nvsim export scan` again.")
        drawn = set(self.viewpoints)
        for v in self.graph.viewpoints.values():
            if v.included and v.id not in drawn:
                found.append(f"Viewpoint {v.id} is in the graph but has no images.")
        for part in self.parts.values():
            found += filter(None, (self._file_problem(name, *known) for name, known in part.files.items()))
        return found + [problem for id in self.viewpoints for problem in self._unreadable(id)]

    def strip(self, viewpoint: str) -> NDArray[np.uint8]:
        """(S, 6 S, 3) uint8, the strip of a viewpoint. Raises InputError if it has another size or cannot be read."""
        return decode(self.places.skyboxes.strip(viewpoint), (6 * self.size, self.size))

    def _file_problem(self, name: str, size: int, digest: str) -> str | None:
        path = self.places.root / name
        try:
            data = read_bytes(path)
        except InputError as error:
            return str(error)
        if len(data) != size or hashlib.sha256(data).hexdigest() != digest:
            return f"{path} does not match the manifest."
        return None

    def _unreadable(self, id: str) -> list[str]:
        def strip() -> None:
            self.strip(id)

        def depth() -> None:
            if read_depth(self.places, id).shape[0] != self.size:
                raise InputError(f"{self.places.skyboxes.depth(id)} has faces of another size than {self.size}.")

        def views() -> None:
            for path in self.places.view_paths(id) if self.settings.get("views") else ():
                decode(path, (WIDTH, HEIGHT))

        def faces() -> None:
            for path in self.places.skyboxes.faces(id) if self.settings.get("faces") else ():
                decode(path, (self.size, self.size))

        found = []
        for read in (strip, depth, views, faces):
            try:
                read()
            except InputError as error:
                found.append(str(error))
        return found


def scans_in(root: Path) -> list[ScanPlaces]:
    """The scans in an export folder that NVSim wrote. Raises InputError if there are none."""
    manifests = sorted(root.glob("*/manifest.json")) + sorted(root.glob("*/.unfinished.jsonl"))
    names = list(dict.fromkeys(path.parent.name for path in manifests))
    if not names:
        raise InputError(f"{root} contains no scan that NVSim wrote; name the folder of `nvsim export scan`.")
    return [ScanPlaces(root, name) for name in names]


UP, BACK, LEFT, FRONT, RIGHT, DOWN = range(6)
_HERE = np.array([1.0, -2.0, 1.5])
_SIDE = 160  # pixels of the compared views, which are 80 degrees wide
# Headings and elevations in degrees of the centers of the faces, in order. The pose has heading 0, which is +y.
_MIDDLES = {"up": (0, 90), "back": (180, 0), "left": (270, 0), "front": (0, 0), "right": (90, 0), "down": (0, -90)}


def place_on_strip(ways: NDArray[np.floating]) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """The face (...), and the position on it, right and down, each -1 to 1, of world directions (..., 3). The pose is
    level and faces +y."""
    wx, wy, wz = np.moveaxis(np.asarray(ways, np.float64), -1, 0)
    x, y, z = wx, -wz, wy  # right, down, ahead
    size = np.stack([abs(x), abs(y), abs(z)])
    axis, most = size.argmax(axis=0), np.maximum(size.max(axis=0), 1e-300)
    face = np.select(
        [(axis == 2) & (z > 0), axis == 2, (axis == 0) & (x > 0), axis == 0, y < 0],
        [FRONT, BACK, RIGHT, LEFT, UP],
        DOWN,
    )
    right = np.select([face == FRONT, face == RIGHT, face == LEFT], [x, -z, z], -x) / most
    down = np.select([face == UP, face == DOWN], [-z, z], y) / most
    return face, right, down


def sample_strip(strip: NDArray[np.generic], ways: NDArray[np.floating]) -> NDArray[np.float32]:
    """(..., 3) float32 colors of a strip (S, 6 S, 3) along world directions (..., 3), bilinear, clamped to each
    face."""
    side = strip.shape[0]
    face, right, down = place_on_strip(ways)
    column, row = ((1 + right) / 2 * side - 0.5).clip(0, side - 1), ((1 + down) / 2 * side - 0.5).clip(0, side - 1)
    c0, r0 = (np.minimum(v.astype(np.int64), side - 2) for v in (column, row))
    fc, fr = (column - c0)[..., None].astype(np.float32), (row - r0)[..., None].astype(np.float32)
    left = face * side + c0
    top = strip[r0, left] * (1 - fc) + strip[r0, left + 1] * fc
    bottom = strip[r0 + 1, left] * (1 - fc) + strip[r0 + 1, left + 1] * fc
    return np.asarray(top * (1 - fr) + bottom * fr, np.float32)


def pixels_along(side: int, ways: NDArray[np.floating]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column (...) of the pixels that directions (..., 3) hit, in a strip with faces of `side` pixels."""
    face, right, down = place_on_strip(ways)
    column, row = (np.floor((1 + v) / 2 * side).clip(0, side - 1).astype(np.int64) for v in (right, down))
    return row, face * side + column


def seam_steps(strip: NDArray[np.uint8]) -> tuple[float, float]:
    """Mean gray step (of the mean of three channels) across the 24 borders of a strip (S, 6 S, 3) uint8, and between
    pixels next to them on both sides."""
    side = strip.shape[0]
    gray = strip.astype(np.float32).mean(axis=2)
    # Pixels inside a border, at it, and beyond it on the next face, found by the rays through their positions.
    inner, last, beyond, after = (gray[pixels_along(side, _rays(side, i))] for i in (-1.5, -0.5, 0.5, 1.5))
    beside = (np.abs(last - inner).mean() + np.abs(after - beyond).mean()) / 2
    return float(np.abs(beyond - last).mean()), float(beside)


def _rays(side: int, offset: float) -> NDArray[np.float64]:
    """(6, 4, S, 3) world directions along each border, `offset` pixels outside it, for a pose that faces +y."""
    along = (np.arange(side) + 0.5) / side * 2 - 1
    out = np.full(side, 1 + 2 * offset / side)
    if offset > 0:  # outside the border is the next face, whose pixels are evenly spaced on its own plane
        out, along = np.full(side, 1 / (1 - 2 * offset / side)), along / (1 - 2 * offset / side)
    edges = [(-out, along), (out, along), (along, -out), (along, out)]
    local = np.stack([np.stack([u, v, np.ones(side)], axis=-1) for u, v in edges])
    return np.asarray(local[None] @ (camera_pose(np.zeros(3), 0.0)[:3, :3] @ face_axes()).swapaxes(-1, -2)[:, None])


def direction_model() -> SubmapModel:
    """A model without Gaussians whose background color along a direction (x, y, z) is half the direction plus 0.5."""
    first = harmonics.basis(np.eye(3), 1)[:, 1:]  # (3, 3) the functions of degree 1 along x, y and z
    rest = np.zeros((24, 3), np.float32)
    rest[:3] = 0.5 * np.linalg.inv(first)
    f = np.float32
    weights = {
        "embed.0.weight": np.zeros((1, 27), f),
        "embed.0.bias": np.zeros(1, f),
        "trunk.0.weight": np.zeros((1, 1), f),
        "trunk.0.bias": np.zeros(1, f),
        "base.weight": np.zeros((3, 1), f),
        "base.bias": np.full(3, 0.5 / harmonics.DC, f),
        "rest.weight": np.zeros((72, 1), f),
        "rest.bias": rest.reshape(-1),
    }
    return SubmapModel(Gaussians.empty(), Background(weights), None, FloorSurface.flat(0))


def direction_errors(side: int, quality: int) -> dict[str, dict[str, float]]:
    """Face -> degrees. `turned` is the rotation of the whole face (best fit). `mean` is the mean error of its pixels,
    of which 8 bits and JPEG alone cause 0.1 to 0.2."""
    model = direction_model()
    skybox = skybox_of(draw_surround(model, _HERE, focal_of(side)), model.floor, side)
    data = np.frombuffer(jpeg(skybox.color, quality, whole_chroma=True), np.uint8)
    strip = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))[..., ::-1]
    found = {}
    for name in NAMES:
        heading, elevation = map(math.radians, _MIDDLES[name])
        camera = Camera(Intrinsics.from_fov(_SIDE, _SIDE, math.radians(80)), camera_pose(_HERE, heading, elevation))
        rays = camera.rays().astype(np.float64).reshape(-1, 3)
        seen = 2 * (sample_strip(strip, rays).astype(np.float64) / 255) - 1
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        found[name] = {"turned": _rotation_angle(rays, seen), "mean": float(np.degrees(_angles(rays, seen)).mean())}
    return found


def _rotation_angle(rays: NDArray[np.float64], seen: NDArray[np.float64]) -> float:
    """Degrees of the rotation that best maps `rays` (N, 3) to `seen` (N, 3) (Kabsch 1976)."""
    u, _, v = np.linalg.svd(rays.T @ seen)
    u[:, -1] *= np.sign(np.linalg.det(u @ v))
    return rotation_angle(u @ v)


def _angles(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1)), np.float64)
