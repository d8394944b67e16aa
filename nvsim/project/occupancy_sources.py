"""Sources of rays for an occupancy map: LiDAR scans, depth images, estimated depth, and trained models."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.sweeps import Sweep, depth_sweeps, scan_sweeps, scans_with_places, sweep_of_depth
from nvsim.capture.types import Capture
from nvsim.errors import InputError
from nvsim.events import Listener, Warning
from nvsim.files.frame_numbers import number_in
from nvsim.geometry.camera import Camera
from nvsim.occupancy.ros import Source
from nvsim.project.project import Project
from nvsim.project.work import missing_result_error

if TYPE_CHECKING:
    from nvsim.geometry.floor_surface import FloorSurface

STAGE = "occupancy"
Wanted = Literal["auto", "lidar", "depth", "images", "trained"]
_REACH: dict[Source, float] = {"lidar": 12.0, "depth": 5.0, "images": 4.0, "trained": 5.0}
"""Meters; more distant measurements are not accurate enough."""
_PIXELS = 320  # longer side of a depth image; more rays would cross only the same cells
_RENDERED = 240
_STANDS = 0.5  # alpha from which a pixel shows an obstacle


@dataclass(frozen=True, eq=False)
class MeasuredRays:
    """Measured rays.

    source  kind of the measurement
    count   number of LiDAR scans or images
    sweeps  function that yields the sweeps one by one. Rays of trained models end on the floor if no Gaussian stops
            them
    cloud   (N, 3) meters, world, if the only source is a cloud without known sensor positions
    places  (M, 3) meters, world, of the sensors if known, else of the cameras
    reach   maximum length of rays in meters
    note    origin and limits of the rays in words
    """

    source: Source
    count: int
    sweeps: Callable[[FloorSurface], Iterator[Sweep]] | None
    cloud: NDArray[np.float32] | None
    places: NDArray[np.float64]
    reach: float
    note: str


def find_capture_with_ranges(project: Project, listen: Listener) -> Capture:
    """The project's capture with LiDAR scans and depth images of its source. Projects do not store LiDAR scans, and
    older ones no depth images. Returns the stored capture with a warning if the source is missing or has changed."""
    from nvsim.capture.read import read
    from nvsim.project.stages.imported import capture_config

    stored = project.need_capture()
    try:
        config = capture_config(project)
        found = read(
            stored.source,
            alignment=stored.alignment,
            leave_out=config.leave_out,
            images=config.images,
            axes=config.axes,
        )
    except InputError as error:
        listen(Warning(f"LiDAR scans and depth images of the capture cannot be read: {error}", STAGE))
        return stored
    if trajectory_digest(found) != trajectory_digest(stored):
        listen(Warning(f"{stored.source} has changed since it was imported; its LiDAR scans are not used.", STAGE))
        return stored
    return replace(stored, scans=found.scans, depths=stored.depths or found.depths)


def find_rays(capture: Capture, project: Project | None, wanted: Wanted = "auto") -> MeasuredRays:
    """The rays of `capture` as read from its source, and of the `project` that it was imported into.

    "auto" selects the best available source: LiDAR scans with known scanner positions, depth images, a point cloud,
    estimated depth, or rendered depth of trained models. Raises InputError if the wanted source is missing.
    """
    scans = scans_with_places(capture.scans)
    finders: list[tuple[Source, Callable[[], MeasuredRays | None]]] = [
        ("lidar", lambda: _of_scans(capture) if scans else None),
        ("depth", lambda: _of_depths(capture)),
        ("lidar", lambda: _of_cloud(capture)),
        ("images", lambda: None if project is None else _of_images(capture, project)),
        ("trained", lambda: None if project is None else _of_models(capture, project)),
    ]
    for source, find in finders:
        if wanted in ("auto", source) and (found := find()) is not None:
            return found
    raise _no_rays_error(capture, project, wanted)


def _of_scans(capture: Capture) -> MeasuredRays:
    scans = scans_with_places(capture.scans)
    places = np.array([scan.to_world[:3, 3] for scan in scans])
    note = f"{len(scans)} LiDAR scans, with rays from the positions of the scanner."
    return MeasuredRays("lidar", len(scans), lambda _: scan_sweeps(scans), None, places, _REACH["lidar"], note)


def _of_depths(capture: Capture) -> MeasuredRays | None:
    depths = capture.depths
    if not depths:
        return None
    places = np.array([depth.camera_to_world[:3, 3] for depth in depths])
    note = f"{len(depths)} depth images of the capture."
    return MeasuredRays(
        "depth", len(depths), lambda _: depth_sweeps(depths, _PIXELS), None, places, _REACH["depth"], note
    )


def _of_cloud(capture: Capture) -> MeasuredRays | None:
    cloud = capture.cloud
    if cloud is None or cloud.kind != "lidar" or not len(cloud.points):
        return None
    note = (
        f"A cloud of {len(cloud.points)} points without sensor positions; rays were cast from the nearest cameras "
        "with a free line of sight to each point."
    )
    return MeasuredRays("lidar", 1, None, cloud.points, capture.positions, _REACH["lidar"], note)


def _of_images(capture: Capture, project: Project) -> MeasuredRays | None:
    if project.stage_results().depth is None:
        return None
    from nvsim.depth.files import read_depth

    folder = project.layout.depth

    def sweeps(_: FloorSurface) -> Iterator[Sweep]:
        for index, frame in enumerate(capture.frames):
            depth = read_depth(folder, number_in(folder, frame.name, index))
            yield sweep_of_depth(frame.camera.scaled(depth.shape[1], depth.shape[0]), depth)

    note = f"Depth that was estimated from {len(capture.frames)} images, which is noisier than a LiDAR scan."
    return MeasuredRays("images", len(capture.frames), sweeps, None, capture.positions, _REACH["images"], note)


def _of_models(capture: Capture, project: Project) -> MeasuredRays | None:
    scene = project.scene()
    if scene is None:
        return None
    from nvsim.render.scene import render_scene

    reach = _REACH["trained"]

    def sweeps(floor: FloorSurface) -> Iterator[Sweep]:
        for frame in capture.frames:
            camera = Camera(frame.intrinsics.limited_to(_RENDERED), frame.camera_to_world)
            output = render_scene(scene, camera, frozenset({"alpha", "depth"}))[1]
            assert output.alpha is not None and output.depth is not None
            stands = output.alpha >= _STANDS
            seen = sweep_of_depth(camera, np.where(stands, output.depth, 0))
            # Gaussians exclude the floor, so pixels that they do not cover show floor.
            rays = camera.rays()
            along = floor.distance_along_rays(camera.position, rays)
            bare = ~stands & (along <= reach)
            ground = camera.position + along[bare, None] * rays[bare]
            yield Sweep(seen.origin, np.concatenate([seen.points, ground]))

    note = (
        "The rendered depth of trained models, the weakest source: it has their errors, and cannot be used to evaluate "
        "graphs from these models."
    )
    return MeasuredRays("trained", len(capture.frames), sweeps, None, capture.positions, reach, note)


def _no_rays_error(capture: Capture, project: Project | None, wanted: Wanted) -> InputError:
    if project is not None and wanted == "images":
        return missing_result_error(project.layout.root, "depth")
    if project is not None and wanted == "trained":
        return missing_result_error(project.layout.root, "train")
    if wanted in ("images", "trained"):
        return InputError(f"{capture.source} is a capture; --source {wanted} needs a project: name it with --project.")
    what = {"lidar": "no LiDAR scan", "depth": "no depth images"}.get(wanted, "no LiDAR scan or depth images")
    more = "import it and run `nvsim depth --project` first" if project is None else "run `nvsim depth --project` first"
    return InputError(f"{capture.source} has {what} to build a map from; {more}.")


def trajectory_digest(capture: Capture) -> str:
    """Hash of frame names and positions: equal for all imports of these frames with one alignment."""
    state = hashlib.sha256(json.dumps([f.name for f in capture.frames]).encode())
    state.update(np.ascontiguousarray(np.round(capture.positions, 6) + 0.0).tobytes())
    return state.hexdigest()[:24]


def source_digests(capture: Capture, project: Project | None) -> tuple[str, ...]:
    """The digest of the trajectory, and that of the project's folder if there is a project."""
    if project is None:
        return (trajectory_digest(capture),)
    place = hashlib.sha256(str(project.layout.root.resolve()).encode(errors="surrogatepass")).hexdigest()[:24]
    return trajectory_digest(capture), place
