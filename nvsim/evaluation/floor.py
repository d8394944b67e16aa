"""Compare floor masks with ground truth: intersection over union (IoU) per frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError

_LEAST_FLOOR = 0.01
_WORST = 10


def evaluate_floor(pairs: Sequence[tuple[Path, Path]]) -> dict[str, Any]:
    """Compares every pair of a mask and its ground truth. A mask of another size is resized to the ground truth's.

    Returns JSON-able metrics. `miou` is the mean IoU of the frames with at least 1 % true floor, 0 if there are none.
    `frames` is their number. `precision` and `recall` are over all their pixels. `false_floor` is the mean share of
    pixels labeled as floor in the other frames. `per_frame` has name, share of true floor, and IoU; `worst` lists the
    frames with the lowest IoU. Raises InputError if an image is missing or unreadable.
    """
    from nvsim.perception.segment import read_mask

    def masks() -> Iterator[Judged]:
        for mask, truth in pairs:
            expected = read_mask(truth)
            height, width = expected.shape
            yield Judged(truth.name, read_mask(mask, width, height), expected)

    return floor_figures(masks())


class Judged(NamedTuple):
    """A mask and its ground truth, (H, W) bool, and (H, W) bool, which pixels count (None: all)."""

    name: str
    found: NDArray[np.bool_]
    expected: NDArray[np.bool_]
    known: NDArray[np.bool_] | None = None


def floor_figures(masks: Iterable[Judged]) -> dict[str, Any]:
    """The metrics of `evaluate_floor` for masks in memory. Raises InputError if there are none."""
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
