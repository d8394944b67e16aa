"""Shares of depth on maps whose answers are counted by hand."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from nvsim.errors import InputError
from nvsim.evaluation.depth import _at_size, _read_truth, _true_depth, evaluate_depth


def row(*values: float) -> np.ndarray:
    return np.array([values], np.float32)


def test_pixels_count_by_their_share_of_the_true_depth() -> None:
    true = row(2.0, 2.0, 2.0, 2.0, 2.0, 0.0, 4.0, 4.0)
    found = row(2.0, 2.03, 1.92, 2.15, 3.0, 1.0, 0.0, 4.3)
    figures = evaluate_depth([(found, true)])
    assert figures["within_2"] == pytest.approx(2 / 6, abs=1e-4), "2.00 and 2.03"
    assert figures["within_5"] == pytest.approx(3 / 6, abs=1e-4), "and 1.92"
    assert figures["within_10"] == pytest.approx(5 / 6, abs=1e-4), "and 2.15 and 4.3"
    assert figures["covered"] == pytest.approx(6 / 7, abs=1e-4) and figures["frames"] == 1


def test_frames_are_pooled_by_pixels() -> None:
    figures = evaluate_depth([(row(1.0), row(1.0)), (row(2.0, 2.0, 0.0), row(1.0, 1.0, 1.0))])
    assert figures["within_10"] == pytest.approx(1 / 3, abs=1e-4) and figures["covered"] == 0.75


def test_without_any_depth_nothing_is_claimed() -> None:
    figures = evaluate_depth([(row(0.0, 0.0), row(1.0, 1.0))])
    assert figures["within_2"] is None and figures["covered"] == 0.0
    assert evaluate_depth([])["covered"] is None


def test_a_truth_of_another_size_is_read_in_the_middle_of_each_pixel() -> None:
    true = np.arange(16, dtype=np.float32).reshape(4, 4)
    assert np.array_equal(_at_size(true, 2, 2), true[[1, 3]][:, [1, 3]])
    assert np.array_equal(_at_size(true, 4, 4), true)


def test_a_truth_is_found_by_the_image_or_by_its_number(tmp_path: Path) -> None:
    assert _true_depth(tmp_path, 3, "cam0/door.jpg") is None
    (tmp_path / "000003.png").touch()
    assert _true_depth(tmp_path, 3, "cam0/door.jpg") == tmp_path / "000003.png"
    (tmp_path / "door.png").touch()
    assert _true_depth(tmp_path, 3, "cam0/door.jpg") == tmp_path / "door.png"


def test_a_truth_that_is_no_depth_map_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "000000.png"
    cv2.imwrite(str(path), np.full((4, 5), 1500, np.uint16))
    assert np.allclose(_read_truth(path), 1.5)
    for wrong in (np.zeros((4, 5), np.uint8), np.zeros((4, 5, 3), np.uint16)):
        cv2.imwrite(str(path), wrong)
        with pytest.raises(InputError, match=r"000000\.png is not a depth map"):
            _read_truth(path)
    path.write_bytes(b"no image")
    with pytest.raises(InputError, match=r"000000\.png"):
        _read_truth(path)
