"""Compare floor masks, and each cue of the paper's hybrid method, with ground truth: intersection over union per
frame.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.errors import InputError
from nvsim.evaluation.frame_truth import FrameTruth, frame_truth
from nvsim.events import Listener, Progress, ignore_event
from nvsim.geometry.sampling import evenly_spaced
from nvsim.networks.installed import BUNDLED, find_model
from nvsim.perception.hybrid import HybridFloor
from nvsim.perception.main_directions import StraightNormals
from nvsim.perception.normals_network import NormalsNetwork
from nvsim.perception.regions import RegionGrowing
from nvsim.perception.segment import read_mask
from nvsim.perception.semantic_network import SemanticNetwork
from nvsim.project.ledger import record
from nvsim.project.project import Project

_LEAST_FLOOR = 0.01
_WORST = 10


class MaskWithTruth(NamedTuple):
    """A mask and its ground truth, (H, W) bool, and (H, W) bool, which pixels count (None: all)."""

    name: str
    predicted: NDArray[np.bool_]
    expected: NDArray[np.bool_]
    known: NDArray[np.bool_] | None = None


def floor_figures(masks: Iterable[MaskWithTruth]) -> dict[str, Any]:
    """Compares every mask with its ground truth. Raises InputError if there are none.

    Returns JSON-able metrics. `miou` is the mean IoU of the frames with at least 1 % true floor, 0 if there are none.
    `frames` is their number. `precision` and `recall` are over all their pixels. `false_floor` is the mean share of
    pixels labeled as floor in the other frames. `per_frame` has name, share of true floor, and IoU; `worst` lists the
    frames with the lowest IoU."""
    rows: list[dict[str, Any]] = []
    true_positive = claimed = actual = 0
    elsewhere: list[float] = []
    for name, found, expected, known in masks:
        if known is not None:
            if not known.any():
                continue
            found, expected = found[known], expected[known]
        both, either = int((found & expected).sum()), int((found | expected).sum())
        share = float(expected.mean())
        counts = share >= _LEAST_FLOOR
        rows.append({"name": name, "floor": share, "iou": both / either if either else 1.0, "counts": counts})
        if counts:
            true_positive, claimed, actual = (
                true_positive + both,
                claimed + int(found.sum()),
                actual + int(expected.sum()),
            )
        else:
            elsewhere.append(float(found.mean()))
    scored = [r for r in rows if r["counts"]]
    if not rows:
        raise InputError("There is no floor mask to compare; give the folder of the true floor masks.")
    return {
        "miou": float(np.mean([r["iou"] for r in scored])) if scored else 0.0,
        "frames": len(scored),
        "precision": true_positive / claimed if claimed else 0.0,
        "recall": true_positive / actual if actual else 0.0,
        "false_floor": float(np.mean(elsewhere)) if elsewhere else 0.0,
        "worst": [{"name": r["name"], "iou": r["iou"]} for r in sorted(scored, key=lambda r: r["iou"])[:_WORST]],
        "per_frame": rows,
    }


STAGE = "evaluate floor"


def evaluate_project_floor(
    project: Project, truth: Path | None, from_scan: bool = False, cues: int = 0, semantic: str = BUNDLED,
    normals: str = BUNDLED, listen: Listener = ignore_event,
) -> dict[str, Any]:  # fmt: skip
    """`floor_figures` of the computed masks without user corrections, and the provider that made them.

    If `cues` is not 0, adds mean IoUs over that many frames, evenly spread over the trajectory: iou_semantic of the
    floor by the network `semantic`, iou_normals of horizontal surfaces by the network `normals`, iou_hybrid of both
    combined, and iou_masks of the project's masks. Raises InputError if masks, networks or ground truth are missing.
    """
    known = frame_truth(project, truth, from_scan)
    frames = project.need_capture().frames
    masks = {i: project.layout.mask_of(frames[i].name, i) for i in known.frames}
    missing = next((path for path in masks.values() if not path.is_file()), None)
    if missing is not None:
        raise InputError(f"{missing} is missing; run `nvsim floors --project` first.")

    def mask_with_truth(index: int) -> MaskWithTruth:
        name, (width, height) = frames[index].name, known.size(index)
        return MaskWithTruth(
            f"{PurePosixPath(name).stem}.png",
            read_mask(masks[index], width, height),
            *known.floor(index, width, height),
        )

    figures = floor_figures(map(mask_with_truth, known.frames))
    found = record(project, "floors")
    figures["provider"] = (found.summary if found else {}).get("provider", "geometry")
    if cues:
        figures |= _score_single_cues(project, known, masks, cues, semantic, normals, listen)
    return figures


def _score_single_cues(
    project: Project, known: FrameTruth, masks: dict[int, Path], cues: int, semantic: str, normals: str,
    listen: Listener,
) -> dict[str, Any]:  # fmt: skip
    looks, faces = find_model("semantic", semantic), find_model("normals", normals)
    if looks is None or faces is None:
        raise InputError("The cues need networks; name them with --semantic and --normals, or give --cues 0.")
    straight = StraightNormals.of_capture(NormalsNetwork(faces.open()), project.need_capture().frames)
    hybrid = HybridFloor(SemanticNetwork(looks.open()), straight, RegionGrowing())
    rows: dict[str, list[MaskWithTruth]] = {"semantic": [], "normals": [], "hybrid": [], "masks": []}
    chosen = [known.frames[k] for k in evenly_spaced(len(known.frames), cues)]
    for done, i in enumerate(chosen):
        listen(Progress(STAGE, done, len(chosen), "cues"))
        frame, (width, height) = project.need_capture().frames[i], known.size(i)
        image = read_image(frame, frame.intrinsics.scaled(width, height))
        steps = hybrid.steps(frame.camera.scaled(width, height), image)
        expected = known.floor(i, width, height)
        own = read_mask(masks[i], width, height)
        for name, mask in zip(rows, (steps.semantic, steps.horizontal, steps.prompted, own), strict=True):
            rows[name].append(MaskWithTruth(frame.name, mask, *expected))
    return {f"iou_{name}": floor_figures(judged)["miou"] for name, judged in rows.items()} | {"cues": len(chosen)}
