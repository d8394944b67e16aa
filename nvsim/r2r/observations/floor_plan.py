"""Draws the floor plans of a scan: for each storey an image, one with the graph, and the world transform as JSON.

A plan shows the floor texture, and the Gaussians between the floor and a cut below the ceiling. Every pixel is drawn
from the submap whose camera on the storey is nearest, so that only one model is in memory at once.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.figures import save_figure
from nvsim.files import atomic
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.graph.exports.picture import LegendRow, MapArea, draw_areas, grouped
from nvsim.graph.types import NavGraph
from nvsim.r2r.observations.layout import png
from nvsim.r2r.observations.skybox import as_bytes
from nvsim.render.kernel_types import Float32
from nvsim.render.model import render_model
from nvsim.render.workspace import tiles_of
from nvsim.splats import harmonics
from nvsim.splats.floor_mesh import floor_mesh
from nvsim.splats.scene import SceneModel
from nvsim.splats.types import Gaussians, SubmapModel
from nvsim.submaps.split import Submap, storeys_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CUT = 1.9
"""Meters above the floor; higher Gaussians are not drawn."""
_BELOW = -0.3  # meters above the floor; lower Gaussians are not drawn
_REACH = 4.0  # meters around the cameras that the plan shows
_LONGEST = 2048  # pixels
_FINEST = 0.01  # meters per pixel
_ALTITUDE = 2000.0  # meters; from this height, the top of a wall is one pixel away from its foot
_COARSER = 8  # side in pixels of the cells that are assigned to one submap
_PAPER = np.float32(0.96)
NAME = "floor_plans.json"
_KEYS = {"edge": LegendRow("", "#1969c8"), "node": LegendRow("", "#aa1e28"), "leading away": LegendRow("", "#966ebe")}


@dataclass(frozen=True)
class Frame:
    """The area of a plan in the world: +x is right, and +y is up on the page.

    low, high      (x, y) meters, outer edges of the image
    meters         meters per pixel
    width, height  pixels
    """

    low: tuple[float, float]
    high: tuple[float, float]
    meters: float
    width: int
    height: int

    @staticmethod
    def around(positions: NDArray[np.floating]) -> Frame:
        """Returns the frame that shows the surroundings of positions (N, 2 or more), meters, world."""
        low, high = positions[:, :2].min(axis=0) - _REACH, positions[:, :2].max(axis=0) + _REACH
        meters = max(_FINEST, float((high - low).max()) / _LONGEST)
        width, height = (math.ceil(float(side) / meters) for side in high - low)
        left, top = float(low[0]), float(low[1]) + height * meters
        return Frame((left, float(low[1])), (left + width * meters, top), meters, width, height)

    @property
    def world_to_pixel(self) -> list[list[float]]:
        """(2, 3) matrix from (x, y, 1), meters, to column and row; (0.5, 0.5) is the center of the first pixel."""
        s = 1 / self.meters
        return [[s, 0.0, -self.low[0] * s], [0.0, -s, self.high[1] * s]]

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Returns the column and row of a position in meters."""
        return (x - self.low[0]) / self.meters, (self.high[1] - y) / self.meters

    def centers(self) -> NDArray[np.float64]:
        """Returns (height, width, 2) x, y of the pixel centers, meters."""
        x = self.low[0] + (np.arange(self.width) + 0.5) * self.meters
        y = self.high[1] - (np.arange(self.height) + 0.5) * self.meters
        return np.stack(np.meshgrid(x, y), axis=-1)

    def camera(self) -> Camera:
        """Returns a camera that sees the frame from so high above that its rays are nearly parallel."""
        focal = _ALTITUDE / self.meters
        intrinsics = Intrinsics(self.width, self.height, focal, focal, self.width / 2, self.height / 2)
        middle = [(a + b) / 2 for a, b in zip(self.low, self.high, strict=True)]
        return Camera(intrinsics, camera_pose(np.array([*middle, _ALTITUDE]), 0.0, -math.pi / 2))


def draw_plan(
    scene: SceneModel, frame: Frame, positions: NDArray[np.floating], owners: NDArray[np.int64]
) -> NDArray[np.uint8]:
    """Draws (height, width, 3) uint8 RGB of a storey.

    The storey's cameras are at `positions` (N, 3), meters, world, and belong to the submaps `owners` (N,).

    Raises InputError if a model is unreadable.
    """
    from scipy.spatial import cKDTree

    rows, columns = -(-frame.height // _COARSER), -(-frame.width // _COARSER)
    cells = frame.centers()[::_COARSER, ::_COARSER]
    distance, nearest = cKDTree(positions[:, :2]).query(cells)
    owner = np.where(distance <= _REACH, owners[nearest], -1).reshape(rows, columns)
    owner = owner.repeat(_COARSER, axis=0).repeat(_COARSER, axis=1)[: frame.height, : frame.width]
    image = np.full((frame.height, frame.width, 3), _PAPER, np.float32)
    for index in np.unique(owner[owner >= 0]).tolist():
        mine = owner == index
        image[mine] = _seen_from_above(scene.model(index), frame, mine, positions[owners == index])
    return as_bytes(image)


def _seen_from_above(
    model: SubmapModel, frame: Frame, mask: NDArray[np.bool_], cameras: NDArray[np.floating]
) -> Float32:
    """Returns (n, 3) the colors at the pixels of `mask` (height, width)."""
    ground = _floor(model, frame, mask)
    standing = replace(
        model, gaussians=_slice_below_cut(model, cameras), background=None, texture=None, appearance=None
    )
    view = render_model(standing, frame.camera(), tiles=tiles_of(mask))
    assert view.rgb is not None and view.alpha is not None
    return np.asarray(view.rgb[mask] + (1 - view.alpha[mask][:, None]) * ground, np.float32)


def _floor(model: SubmapModel, frame: Frame, mask: NDArray[np.bool_]) -> Float32:
    """Returns (n, 3) the floor colors at the pixels of `mask`, and the paper color where the floor is unknown."""
    mesh = floor_mesh(model)
    if mesh is None:
        return np.full((int(mask.sum()), 3), _PAPER, np.float32)
    low, high = mesh.vertices[:, :2].min(axis=0), mesh.vertices[:, :2].max(axis=0)
    rows, columns = mesh.image.shape[:2]
    share = (frame.centers() - low) / (high - low)
    at = [(share[..., i] * n - 0.5).astype(np.float32) for i, n in ((0, columns), (1, rows))]
    image = mesh.image.astype(np.float32)
    image[..., :3] *= image[..., 3:] / 255
    texels = cv2.remap(image, at[0], at[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[mask] / 255
    texels[((share < 0) | (share > 1)).any(axis=-1)[mask]] = 0  # outside the texture
    return np.asarray(texels[:, :3] + (1 - texels[:, 3:]) * _PAPER, np.float32)


def _slice_below_cut(model: SubmapModel, cameras: NDArray[np.floating]) -> Gaussians:
    """Returns the Gaussians between floor and cut, each with the color that its nearest camera (N, 3) sees.

    No images were taken from above, so the spherical harmonics in that direction are meaningless.
    """
    from scipy.spatial import cKDTree

    g = model.baked()
    above = g.means[:, 2] - model.floor.height_at(g.means[:, :2])
    rows = np.flatnonzero((above > _BELOW) & (above < CUT))
    means = g.means[rows]
    ways = means - cameras[cKDTree(cameras).query(means)[1]]
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-6)
    weights = harmonics.basis(ways, g.sh_degree)
    colors = np.maximum(0.5 + np.einsum("nk,nkc->nc", weights, g.sh[rows]), 0)
    sh = ((colors - 0.5) / harmonics.DC).astype(np.float32)[:, None]
    return Gaussians(means, g.log_scales[rows], g.quats[rows], g.opacity_logits[rows], np.ascontiguousarray(sh))


@dataclass(frozen=True, eq=False)
class Storey:
    """One storey.

    number     1 for the lowest
    positions  (N, 3) camera positions, meters, world; owners (N,) their submaps
    ids        its viewpoints
    """

    number: int
    positions: NDArray[np.float64]
    owners: NDArray[np.int64]
    ids: tuple[str, ...]


def storeys_with(graph: NavGraph, submaps: tuple[Submap, ...]) -> Iterator[Storey]:
    """Yields the storeys of the trajectory, from the lowest, with the viewpoints of `graph` nearest in height.

    `submaps` are those that have a model.
    """
    positions = np.concatenate([s.positions for s in submaps])
    owners = np.concatenate([np.full(len(s.positions), s.index, np.int64) for s in submaps])
    found = storeys_of(positions)
    heights = np.array([v.position[2] for v in graph.viewpoints.values()])
    nearest = found.nearest(heights)
    for k in range(len(found.levels)):
        on = found.cameras_of_storey(k)
        ids = tuple(id for id, storey in zip(graph.viewpoints, nearest, strict=True) if storey == k)
        if on.any():
            yield Storey(k + 1, positions[on], owners[on], ids)


def write_plans(scene: SceneModel, graph: NavGraph, submaps: tuple[Submap, ...], folder: Path) -> list[Path]:
    """Writes storey_N.png, storey_N_graph.png and floor_plans.json into `folder` and returns their paths.

    Raises InputError if a model is unreadable or writing fails.
    """
    written, notes = [], []
    for storey in storeys_with(graph, submaps):
        frame = frame_of(graph, storey)
        image = draw_plan(scene, frame, storey.positions, storey.owners)
        plain, drawn = (folder / f"storey_{storey.number}{end}.png" for end in ("", "_graph"))
        atomic.write_bytes(plain, png(image))
        save_figure(_with_graph(graph, storey, frame, image), drawn)
        written += [plain, drawn]
        notes.append(_note(graph, storey, frame, plain, drawn))
    about = {
        "scan": graph.scan,
        "pixels": "column, row = world_to_pixel @ (x, y, 1); (0.5, 0.5) is the center of the first pixel; +y is up",
        "cut": CUT,
        "storeys": notes,
    }
    path = folder / NAME
    atomic.write_text(path, json.dumps(about, indent=1) + "\n")
    return [*written, path]


def frame_of(graph: NavGraph, storey: Storey) -> Frame:
    """Returns the area that the plan of a storey shows."""
    places = np.array([graph.viewpoints[id].position for id in storey.ids], np.float64).reshape(-1, 3)
    return Frame.around(np.concatenate([storey.positions, places]))


def _note(graph: NavGraph, storey: Storey, frame: Frame, plain: Path, drawn: Path) -> dict[str, Any]:
    floors = [graph.viewpoints[id].position[2] - graph.viewpoints[id].height for id in storey.ids]
    return {
        "storey": storey.number,
        "plan": plain.name,
        "plan_with_graph": drawn.name,
        "width": frame.width,
        "height": frame.height,
        "metres_per_pixel": frame.meters,
        "world_to_pixel": frame.world_to_pixel,
        "floor": float(np.median(floors)) if floors else None,
        "viewpoints": {id: list(frame.pixel(*graph.viewpoints[id].position[:2])) for id in storey.ids},
    }


def _with_graph(graph: NavGraph, storey: Storey, frame: Frame, image: NDArray[np.uint8]) -> Figure:
    here = set(storey.ids)
    edges = {key: "edge" if here.issuperset(key) else "leading away" for key in graph.edges if here.intersection(key)}
    area = MapArea(np.array(frame.low), np.array(frame.high), storey.ids, edges, image)
    groups = grouped(_KEYS, dict.fromkeys(storey.ids, "node"), edges)
    return draw_areas(graph, [area], groups, max(frame.width, frame.height))
