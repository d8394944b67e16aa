"""Measure the angle between a network's normals and ground truth, on photographs or on renders of the models."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.errors import InputError
from nvsim.evaluation.frame_truth import frame_truth
from nvsim.events import Listener, Progress, ignore_event
from nvsim.geometry.camera import Camera
from nvsim.geometry.sampling import evenly_spaced
from nvsim.perception.main_directions import StraightNormals, straighten_normals
from nvsim.perception.normals_network import installed_normals
from nvsim.project.project import Project
from nvsim.project.work import missing_result_error

STAGE = "evaluate normals"
_WITHIN = 11.25  # degrees, a common threshold
Float32 = NDArray[np.float32]
Of = Literal["photographs", "renders"]


class Angles:
    """Angles between maps of normals (H, W, 3) float32, estimated and true, unit length or zero if unknown. Only pixels
    known in both maps count."""

    def __init__(self) -> None:
        self._angles: list[Float32] = []
        self._up: list[Float32] = []

    def add(self, found: Float32, true: Float32) -> None:
        """Adds the pixels of two normal maps (H, W, 3), zero where unknown."""
        there = found.any(axis=-1) & true.any(axis=-1)
        angle = np.degrees(np.arccos(np.clip((found * true).sum(axis=-1)[there], -1, 1)))
        self._angles.append(angle)
        self._up.append(angle[true[there][:, 2] > 0.9])

    def figures(self) -> dict[str, Any]:
        """Metrics over all pixels: normal_deg and median_deg, the mean and median angle in degrees; up_deg, the mean
        over surfaces that truly face up; within_11, the share of angles up to 11.25 degrees; frames. Raises InputError
        if no pixel is known."""
        every, level = (np.concatenate(parts) if parts else np.empty(0) for parts in (self._angles, self._up))
        if not len(every):
            raise InputError(
                "No true normals are available; give a folder with normals/ as --truth, or give --from-scan."
            )
        return {
            "normal_deg": round(float(every.mean()), 2),
            "median_deg": round(float(np.median(every)), 2),
            "up_deg": round(float(level.mean()), 2) if len(level) else None,
            "within_11": round(float((every <= _WITHIN).mean()), 4),
            "frames": len(self._angles),
        }


def evaluate_project_normals(
    project: Project,
    model: str,
    of: Of,
    truth: Path | None,
    from_scan: bool,
    most: int,
    listen: Listener = ignore_event,
) -> dict[str, Any]:
    """The metrics of `Angles` for the network `model`, whose normals are straightened by the headings of the capture.

    Measured on at most `most` frames, evenly spread over the trajectory, or on renders from their cameras. network_deg
    is the mean angle of the network without straightening. Raises InputError if models or ground truth are missing."""
    known, network = frame_truth(project, truth, from_scan), installed_normals(model)
    capture = project.need_capture()
    chosen = [known.normals[k] for k in evenly_spaced(len(known.normals), most)]
    scene = project.scene() if of == "renders" else None
    if of == "renders" and scene is None:
        raise missing_result_error(project.root, "train")
    if scene is not None:
        from nvsim.render.model import render_model
    headings = StraightNormals.of_capture(network, capture.frames).headings
    used, alone = Angles(), Angles()
    for done, i in enumerate(chosen):
        listen(Progress(STAGE, done, len(chosen)))
        frame = capture.frames[i]
        small = frame.intrinsics.limited_to(640)
        camera = Camera(small, frame.camera.camera_to_world)
        if scene is None:
            image = read_image(frame, small)
        else:
            rgb = render_model(scene.model_at(camera.position)[1], camera).rgb
            assert rgb is not None
            image = np.rint(np.clip(rgb, 0, 1) * 255).astype(np.uint8)
        seen, true = network.normals(image, camera), known.normal_map(i, small.width, small.height)
        alone.add(seen, true)
        used.add(straighten_normals(seen, headings), true)
    return used.figures() | {"network_deg": alone.figures()["normal_deg"]}
