"""Compare a project's floor masks with ground truth, and compare each cue of the paper's hybrid method alone."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Any

from nvsim.capture.images import read_image
from nvsim.errors import InputError
from nvsim.evaluation.floor import Judged, floor_figures
from nvsim.evaluation.frame_truth import FrameTruth, frame_truth
from nvsim.events import Listener, Progress, silent
from nvsim.geometry.sampling import spread
from nvsim.networks.installed import BUNDLED, find_model
from nvsim.perception.hybrid import HybridFloor
from nvsim.perception.main_directions import StraightNormals
from nvsim.perception.normals_network import NormalsNetwork
from nvsim.perception.regions import RegionGrowing
from nvsim.perception.segment import read_mask
from nvsim.perception.semantic_network import SemanticNetwork
from nvsim.project.ledger import record
from nvsim.project.project import Project

STAGE = "evaluate floor"


def evaluate_project_floor(
    project: Project, truth: Path | None, from_scan: bool = False, cues: int = 0, semantic: str = BUNDLED,
    normals: str = BUNDLED, listen: Listener = silent,
) -> dict[str, Any]:  # fmt: skip
    """`floor_figures` of the computed masks without user corrections, and the provider that made them.

    If `cues` is not 0, adds mean IoUs over that many frames, evenly spread over the trajectory: iou_semantic of the
    floor by the network `semantic`, iou_normals of horizontal surfaces by the network `normals`, iou_hybrid of both
    combined, and iou_masks of the project's masks. Raises InputError if masks, networks or ground truth are missing.
    """
    known = frame_truth(project, truth, from_scan)
    masks = {i: project.layout.mask(i) for i in known.frames}
    missing = next((path for path in masks.values() if not path.is_file()), None)
    if missing is not None:
        raise InputError(f"{missing} is missing; run `nvsim floors --project` first.")

    def judged(index: int) -> Judged:
        name, (width, height) = project.need_capture().frames[index].name, known.size(index)
        return Judged(
            f"{PurePosixPath(name).stem}.png",
            read_mask(masks[index], width, height),
            *known.floor(index, width, height),
        )

    figures = floor_figures(map(judged, known.frames))
    found = record(project, "floors")
    figures["provider"] = (found.summary if found else {}).get("provider", "geometry")
    if cues:
        figures |= _alone(project, known, masks, cues, semantic, normals, listen)
    return figures


def _alone(
    project: Project, known: FrameTruth, masks: dict[int, Path], cues: int, semantic: str, normals: str,
    listen: Listener,
) -> dict[str, Any]:  # fmt: skip
    looks, faces = find_model("semantic", semantic), find_model("normals", normals)
    if looks is None or faces is None:
        raise InputError("The cues need networks; name them with --semantic and --normals, or give --cues 0.")
    straight = StraightNormals.of_capture(NormalsNetwork(faces.open()), project.need_capture().frames)
    hybrid = HybridFloor(SemanticNetwork(looks.open()), straight, RegionGrowing())
    rows: dict[str, list[Judged]] = {"semantic": [], "normals": [], "hybrid": [], "masks": []}
    chosen = [known.frames[k] for k in spread(len(known.frames), cues)]
    for done, i in enumerate(chosen):
        listen(Progress(STAGE, done, len(chosen), "cues"))
        frame, (width, height) = project.need_capture().frames[i], known.size(i)
        image = read_image(frame, frame.intrinsics.scaled(width, height))
        steps = hybrid.steps(frame.camera.scaled(width, height), image)
        expected = known.floor(i, width, height)
        own = read_mask(masks[i], width, height)
        for name, mask in zip(rows, (steps.semantic, steps.horizontal, steps.prompted, own), strict=True):
            rows[name].append(Judged(frame.name, mask, *expected))
    return {f"iou_{name}": floor_figures(judged)["miou"] for name, judged in rows.items()} | {"cues": len(chosen)}
