"""The self-check of an exported scan: files, directions, reach, seams, and how near views that are sampled from its
strips come to views drawn directly."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.evaluation.scan_directions import direction_errors
from nvsim.evaluation.scan_files import ScanFiles, scans_in
from nvsim.evaluation.scan_reach import edges_out_of_reach
from nvsim.evaluation.scan_sampler import sample_strip
from nvsim.evaluation.scan_seams import seam_steps
from nvsim.evaluation.scores import psnr
from nvsim.events import Listener, Progress, silent
from nvsim.geometry.camera import Camera, look
from nvsim.geometry.view_sweep import STEP, VIEWS, sweep
from nvsim.project.project import Project
from nvsim.project.work import lacks
from nvsim.r2r.observations.skybox import focal_of
from nvsim.r2r.observations.surround import draw_surround
from nvsim.render.model import render_model

STAGE = "check"
MOST_TURNED = 0.5
"""Degrees by which a face may look past its direction."""
MOST_SEAM = 1.5
"""How many times as large as beside it a step over a border may be."""
LEAST_MEDIAN, LEAST = 35.0, 28.0
"""dB of views sampled from strips against the same views sampled from what the strips were sampled from: median, and
each. What is drawn directly is another matter: a model draws some spots otherwise in the corner of a view than in its
middle, because Gaussians are sorted by their depth along the view's axis."""
_STRIPS = 50  # of which seams are measured


def evaluate_scan(
    root: Path,
    scan: str | None = None,
    project: Project | None = None,
    views: int = 400,
    listen: Listener = silent,
) -> dict[str, Any]:
    """Figures of one scan in the folder `root`, by name; `problems` are sentences about what is wrong, and there are
    none where all is well. With `project`, from which it was exported, `views` views are drawn and compared.

    Raises InputError where there is no finished scan, or several and none is named.
    """
    places = [p for p in scans_in(root) if scan in (None, p.scan)]
    if len(places) != 1:
        names = ", ".join(p.scan for p in scans_in(root))
        raise InputError(f"{root} holds the scans {names}; name one of them with --scan.")
    files = ScanFiles(places[0])
    problems = files.problems()
    result: dict[str, Any] = {"scan": files.places.scan, "viewpoints": len(files.viewpoints)}
    result["files"] = sum(len(part.files) for part in files.parts.values())
    faces = direction_errors(files.size, files.quality)
    result["direction_deg"] = max(max(face.values()) for face in faces.values())
    result["faces_deg"] = faces
    turned = [n for n, f in faces.items() if max(f.values()) > MOST_TURNED]
    problems += [f"The face {n} looks {max(faces[n].values()):.2f} degrees past its direction." for n in turned]
    unreached = edges_out_of_reach(files.graph)
    result["edges"], result["edges_out_of_reach"] = len(files.graph.edges), len(unreached)
    problems += [f"No view of {a} offers the edge to {b}." for a, b in unreached]
    if not problems:
        problems += _look(files, project, views, result, listen)
    result["problems"] = problems
    return result


def _look(files: ScanFiles, project: Project | None, views: int, result: dict[str, Any], listen: Listener) -> list[str]:
    """Adds the figures that are measured on pictures; returns the problems."""
    problems = []
    chosen = files.viewpoints[:: max(1, len(files.viewpoints) // _STRIPS)]
    steps = np.array([seam_steps(files.strip(id)) for id in chosen]).reshape(-1, 2).mean(axis=0)
    result["step_over_borders"], result["step_beside"] = map(float, steps)
    if steps[0] > MOST_SEAM * max(steps[1], 0.5):
        problems.append(
            f"The faces have seams: steps of {steps[0]:.1f} over their borders, {steps[1]:.1f} beside them."
        )
    if project is not None:
        source, direct = _against_model(files, project, views, listen)
        result |= {"views": views, "psnr_median": float(np.median(direct)), "psnr_worst": float(direct.min())}
        result["views_below_28_db"] = int((direct < 28).sum())
        result |= {"psnr_source_median": float(np.median(source)), "psnr_source_worst": float(source.min())}
        if np.median(source) < LEAST_MEDIAN or source.min() < LEAST:
            problems.append(
                f"Views from the strips have {np.median(source):.1f} dB against what the strips were made from, "
                f"{source.min():.1f} at worst; {LEAST_MEDIAN:.0f} and {LEAST:.0f} are expected."
            )
    return problems


def _against_model(
    files: ScanFiles, project: Project, count: int, listen: Listener
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """PSNR (count,) of views in random directions at random viewpoints, the same in every run: against what the strips
    were sampled from, and against views drawn directly."""
    scene = project.scene(memory_budget=0)
    if scene is None:
        raise lacks(project.layout.root, "train")
    random = np.random.default_rng(1)
    poses = []
    for _ in range(count):
        id = files.viewpoints[int(random.integers(len(files.viewpoints)))]
        turn, row = random.uniform(0, 2 * np.pi), int(random.integers(-1, 2))
        poses.append((scene.nearest(np.array(files.graph.viewpoints[id].position)), id, turn, row * STEP))
    intrinsics = sweep(np.zeros(3))[VIEWS // 2].intrinsics
    values: list[tuple[float, float]] = []
    surround, drawn = None, ""
    for submap, id, heading, elevation in sorted(poses):
        at, model = np.array(files.graph.viewpoints[id].position), scene.model(submap)
        if id != drawn or surround is None:
            surround, drawn = draw_surround(model, at, focal_of(files.size), over=surround), id
        camera = Camera(intrinsics, look(at, heading, elevation))
        direct = render_model(model, camera).rgb
        assert direct is not None
        sampled = sample_strip(files.strip(id), camera.rays()) / np.float32(255)
        values.append((_psnr(sampled, surround.colour(camera)), _psnr(sampled, direct)))
        listen(Progress(STAGE, len(values), count))
    source, straight = np.array(values).T
    return source, straight


def _psnr(sampled: NDArray[np.float32], drawn: NDArray[np.float32]) -> float:
    return psnr(float(((sampled - np.clip(drawn, 0, 1)) ** 2).mean()))
