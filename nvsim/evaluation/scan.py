"""Check an exported scan: files, directions, reachable edges, seams, and how similar views sampled from its strips are
to views rendered directly."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.evaluation.scan_files import ScanFiles, direction_errors, sample_strip, scans_in, seam_steps
from nvsim.evaluation.scores import psnr
from nvsim.events import Listener, Progress, ignore_event
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.geometry.directions import HEIGHT, STEP, VFOV, VIEWS, WIDTH, heading_and_elevation, sweep
from nvsim.graph.types import NavGraph
from nvsim.project.project import Project
from nvsim.project.work import missing_result_error
from nvsim.r2r.observations.incremental_surround import PlacesSeen
from nvsim.render.model import render_model
from nvsim.splats.types import SubmapModel

_PATCH = 80  # pixels
_FINER = 2
STAGE = "check"
MOST_TURNED = 0.5
"""Largest error in degrees of a face's direction."""
MOST_SEAM = 1.5
"""Largest ratio of the gray step across a border to the steps next to it."""
LEAST_MEDIAN, LEAST = 35.0, 28.0
"""Least PSNR in dB of views sampled from strips, compared with live renders of the models: median, and each view."""
_STRIPS = 50  # number of strips on which seams are measured
_STRAIGHT = 4  # one of so many views is also rendered by `straight_view`, which takes ten times as long


def edges_out_of_reach(graph: NavGraph) -> list[tuple[str, str]]:
    """Directed edges between included viewpoints that no view of the sweep offers, so that agents cannot use them.

    Their end is straight above or below, or at an equal position.

    Source: the rule of Matterport3DSimulator with restricted navigation. A location is navigable if its horizontal
    direction is within half the field of view of the heading. The field of view is proportional to the width.
    """
    found = []
    for edge in graph.edges.values():
        for a, b in ((edge.a, edge.b), (edge.b, edge.a)):
            start, end = graph.viewpoints[a], graph.viewpoints[b]
            if start.included and end.included and not _is_in_simulator_view(start.position, end.position):
                found.append((a, b))
    return found


def _is_in_simulator_view(start: tuple[float, float, float], end: tuple[float, float, float]) -> bool:
    x, y = end[0] - start[0], end[1] - start[1]
    length, least = math.hypot(x, y), math.cos(VFOV * WIDTH / HEIGHT / 2)
    if length == 0:
        return False
    headings = (heading_and_elevation(i)[0] for i in range(VIEWS))
    return any((x * math.sin(h) + y * math.cos(h)) / length >= least for h in headings)


def straight_view(model: SubmapModel, camera: Camera) -> NDArray[np.float32]:
    """(H, W, 3) float32, the view of `camera`, not clamped, from patches whose rays are all near an optical axis.

    Gaussians are flattened along the optical axis and sorted by depth along it, and the error of both grows with the
    angle of a ray to the axis. In a patch of 80 pixels, which has its own axis and twice the resolution, this angle is
    at most 8 degrees. Only the rasterizer is shared with the export of scans, so that this view can test the export.

    Raises InputError if no backend can run here.
    """
    k = camera.intrinsics
    rays = camera.scaled(_FINER * k.width, _FINER * k.height).rays()
    image = np.empty((k.height, k.width, 3), np.float32)
    for top in range(0, k.height, _PATCH):
        for left in range(0, k.width, _PATCH):
            part = rays[_FINER * top : _FINER * (top + _PATCH), _FINER * left : _FINER * (left + _PATCH)]
            patch = _colors_along_rays(model, camera, part)
            size = part.shape[1] // _FINER, part.shape[0] // _FINER
            image[top : top + _PATCH, left : left + _PATCH] = cv2.resize(patch, size, interpolation=cv2.INTER_AREA)
    return image


def _colors_along_rays(model: SubmapModel, camera: Camera, rays: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w, 3) colors along `rays` (h, w, 3), from one render whose axis is their mean direction."""
    ahead = rays.reshape(-1, 3).mean(axis=0, dtype=np.float64)
    ahead /= np.linalg.norm(ahead)
    down = np.cross(ahead, camera.rotation[:, 0])
    down /= np.linalg.norm(down)
    pose = camera.camera_to_world.copy()
    pose[:3, :3] = np.stack([np.cross(down, ahead), down, ahead], axis=1)
    local = rays @ pose[:3, :3]
    across = (local[..., :2] / local[..., 2:]).astype(np.float32)
    focal = _FINER * camera.intrinsics.fx
    side = 2 * math.ceil(focal * float(np.abs(across).max()) + 2)
    drawn = render_model(model, Camera(Intrinsics(side, side, focal, focal, side / 2, side / 2), pose)).rgb
    assert drawn is not None
    at = across * np.float32(focal) + np.float32(side / 2 - 0.5)
    return np.asarray(cv2.remap(drawn, at[..., 0], at[..., 1], cv2.INTER_LINEAR), np.float32)


def evaluate_scan(
    root: Path,
    scan: str | None = None,
    project: Project | None = None,
    views: int = 400,
    listen: Listener = ignore_event,
) -> dict[str, Any]:
    """Metrics of one scan in the folder `root`, by name. `problems` lists sentences about defects; it is empty if there
    are none. With the `project` that it was exported from, `views` views are rendered and compared.

    Raises InputError if there is no finished scan, or if there are several and none is named.
    """
    places = [p for p in scans_in(root) if scan in (None, p.scan)]
    if len(places) != 1:
        names = ", ".join(p.scan for p in scans_in(root))
        raise InputError(f"{root} contains the scans {names}; name one of them with --scan.")
    files = ScanFiles(places[0])
    problems = files.problems()
    result: dict[str, Any] = {"scan": files.places.scan, "viewpoints": len(files.viewpoints)}
    result["files"] = sum(len(part.files) for part in files.parts.values())
    faces = direction_errors(files.size, files.quality)
    result["direction_deg"] = max(max(face.values()) for face in faces.values())
    result["faces_deg"] = faces
    turned = [n for n, f in faces.items() if max(f.values()) > MOST_TURNED]
    problems += [f"The face {n} points {max(faces[n].values()):.2f} degrees away from its direction." for n in turned]
    unreached = edges_out_of_reach(files.graph)
    result["edges"], result["edges_out_of_reach"] = len(files.graph.edges), len(unreached)
    problems += [f"No view of {a} offers the edge to {b}." for a, b in unreached]
    if not problems:
        problems += _check_images(files, project, views, result, listen)
    result["problems"] = problems
    return result


def _check_images(
    files: ScanFiles, project: Project | None, views: int, result: dict[str, Any], listen: Listener
) -> list[str]:
    """Adds the metrics that need images; returns the problems."""
    problems = []
    chosen = files.viewpoints[:: max(1, len(files.viewpoints) // _STRIPS)]
    steps = np.array([seam_steps(files.strip(id)) for id in chosen]).reshape(-1, 2).mean(axis=0)
    result["step_over_borders"], result["step_beside"] = map(float, steps)
    if steps[0] > MOST_SEAM * max(steps[1], 0.5):
        problems.append(
            f"The faces have seams: gray steps of {steps[0]:.1f} across their borders, {steps[1]:.1f} next to them."
        )
    if project is not None:
        found = _against_model(files, project, views, listen)
        for name, values in found.items():
            result |= {f"psnr_{name}_median": float(np.median(values)), f"psnr_{name}_worst": float(values.min())}
        live = found["live"]
        result |= {"views": views, "views_straight": len(found["straight"])}
        result["views_below_28_db"] = int((live < LEAST).sum())
        if np.median(live) < LEAST_MEDIAN or live.min() < LEAST:
            problems.append(
                f"Views from the strips have {np.median(live):.1f} dB compared with live renders, {live.min():.1f} at "
                f"worst; {LEAST_MEDIAN:.0f} and {LEAST:.0f} are expected."
            )
    return problems


def _against_model(files: ScanFiles, project: Project, count: int, listen: Listener) -> dict[str, NDArray[np.float64]]:
    """PSNR (count,) in dB of views in random directions at random viewpoints, with a fixed seed.

    live           strips compared with the simulator's live renders, which combine narrow views
    straight       strips compared with `straight_view`, for every fourth view
    wide           strips compared with one wide render
    wide_straight  one wide render compared with `straight_view`, for every fourth view
    """
    scene = project.scene(memory_budget=0)
    if scene is None:
        raise missing_result_error(project.layout.root, "train")
    random = np.random.default_rng(1)
    poses = []
    for _ in range(count):
        id = files.viewpoints[int(random.integers(len(files.viewpoints)))]
        turn, row = random.uniform(0, 2 * np.pi), int(random.integers(-1, 2))
        poses.append((scene.nearest(np.array(files.graph.viewpoints[id].position)), id, turn, row * STEP))
    intrinsics = sweep(np.zeros(3))[VIEWS // 2].intrinsics
    found: dict[str, list[float]] = {"live": [], "wide": [], "straight": [], "wide_straight": []}
    seen = PlacesSeen(0)
    for number, (submap, id, heading, elevation) in enumerate(sorted(poses)):
        at, model = np.array(files.graph.viewpoints[id].position), scene.model(submap)
        camera = Camera(intrinsics, camera_pose(at, heading, elevation))
        wide = render_model(model, camera).rgb
        assert wide is not None
        sampled = sample_strip(files.strip(id), camera.rays()) / np.float32(255)
        found["live"].append(_psnr(sampled, seen.image(model, camera, False)[0] / np.float32(255)))
        found["wide"].append(_psnr(sampled, wide))
        if number % _STRAIGHT == 0:
            straight = straight_view(model, camera)
            found["straight"].append(_psnr(sampled, straight))
            found["wide_straight"].append(_psnr(np.clip(wide, 0, 1), straight))
        listen(Progress(STAGE, number + 1, count))
    return {name: np.array(values) for name, values in found.items()}


def _psnr(sampled: NDArray[np.float32], drawn: NDArray[np.float32]) -> float:
    return psnr(float(((sampled - np.clip(drawn, 0, 1)) ** 2).mean()))
