"""Floor masks of the rendered house against its truth: the whole stage, from the capture on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from nvsim.capture.read import read
from nvsim.evaluation.floor import MaskWithTruth, floor_figures
from nvsim.perception.floor_height import estimate_floor
from nvsim.perception.segment import mask_path, read_mask, segment_capture


@pytest.mark.data
def test_house_walk_masks_overlap_the_truth_by_at_least_0_93(shared_data: Path, tmp_path: Path):
    capture = read(shared_data / "house_walk" / "kapture")
    surface = estimate_floor(capture.cloud, capture.positions)
    assert np.abs(surface.height_at(capture.positions[:, :2])).max() < 0.02
    todo = list(range(0, len(capture.frames), 36))
    segment_capture(capture, lambda i: surface, tmp_path, todo=todo)
    names = [mask_path(tmp_path, i).name for i in todo]
    truth = shared_data / "house_walk" / "ground_truth" / "floor"
    expected = [(n, read_mask(truth / n)) for n in names]
    figures = floor_figures(MaskWithTruth(n, read_mask(tmp_path / n, *e.shape[::-1]), e) for n, e in expected)
    assert figures["frames"] >= 8
    assert figures["miou"] > 0.93, figures["worst"]
