"""Floor masks of the rendered house against its truth: the whole stage, from the capture on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from nvsim.capture.read import read
from nvsim.evaluation.floor import evaluate_floor
from nvsim.perception.floor_height import estimate_floor
from nvsim.perception.segment import mask_path, segment_capture


@pytest.mark.data
def test_house_walk_masks_overlap_the_truth_by_at_least_0_93(shared_data: Path, tmp_path: Path):
    capture = read(shared_data / "house_walk" / "kapture")
    surface = estimate_floor(capture.cloud, capture.positions)
    assert np.abs(surface.height_at(capture.positions[:, :2])).max() < 0.02
    todo = list(range(0, len(capture.frames), 36))
    segment_capture(capture, lambda i: surface, tmp_path, todo=todo)
    names = [mask_path(tmp_path, i).name for i in todo]
    figures = evaluate_floor([(tmp_path / n, shared_data / "house_walk" / "ground_truth" / "floor" / n) for n in names])
    assert figures["frames"] >= 8
    assert figures["miou"] > 0.93, figures["worst"]
