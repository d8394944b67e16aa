"""Rows, keys, tables and pictures of the ablation, without any training."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from nvsim.errors import InputError
from nvsim.evaluation.ablation import (
    AblationResult,
    AblationTable,
    ScoredRun,
    _over_seeds,
    mean_over_submaps,
    text_of,
    write_report,
)
from nvsim.evaluation.ablation_runs import ROWS, Budget, ablation_rows, preset_rows, training_run
from nvsim.evaluation.comparison import WIDTH, ComparedImage, Tile
from nvsim.project import ledger
from nvsim.project.project import Project
from nvsim.submaps.split import Submap
from nvsim.training.config import PRESETS, preset

SUBMAP = Submap(0, (0, 1), (0, 1, 2), np.zeros((2, 3)))
BUDGET = Budget(steps=50, image_size=64, gaussian_cap=500)


def test_each_row_of_the_ablation_changes_only_its_own_part() -> None:
    rows = {row.name: row.config for row in ablation_rows(BUDGET)}
    assert tuple(rows) == ROWS
    base, masking, suppression, floor, ours = (rows[name] for name in ROWS)
    assert not base.loss.masks_floor and not base.floor_aware and base.loss.alpha > 0
    assert masking.loss.masks_floor and not masking.floor_aware and masking.seed_height == base.seed_height
    assert (suppression.loss.suppression, suppression.loss.floor) == (1.0, 0.0)
    assert (floor.loss.suppression, floor.loss.floor) == (1.0, 1.0)
    assert replace(floor, loss=replace(floor.loss, floor=0.0)) == suppression
    assert replace(floor, loss=replace(floor.loss, alpha=0.0)) == ours
    assert ours == BUDGET.apply_to(preset("splatfacto-i")) and base == BUDGET.apply_to(preset("splatfacto-w"))


def test_every_row_has_the_same_budget_and_its_preset_s_own_ways() -> None:
    rows = (*ablation_rows(BUDGET), *preset_rows(BUDGET))
    assert {(r.config.steps, r.config.image_size, r.config.gaussian_cap) for r in rows} == {(50, 64, 500)}
    assert {r.name for r in preset_rows(BUDGET)} == set(PRESETS)
    default = {(r.config.steps, r.config.gaussian_cap) for r in preset_rows(Budget())}
    assert default == {(preset("nvsim").steps, preset("nvsim").gaussian_cap)}
    assert [r.name for r in ablation_rows(BUDGET, ["ours", "base"])] == ["base", "ours"]
    with pytest.raises(InputError, match="--presets 4dgs"):
        preset_rows(BUDGET, ["4dgs"])


def test_one_configuration_is_one_run_whatever_it_is_called_and_any_other_is_not(tmp_path: Path) -> None:
    with Project.create_or_open(tmp_path / "p.nvsim") as project:
        ours = ablation_rows(BUDGET)[-1].config
        (same,) = preset_rows(BUDGET, ["splatfacto-i"])
        assert same.config.name == "splatfacto-i"
        key = training_run(project, SUBMAP, ours, 0).folder
        assert training_run(project, SUBMAP, replace(same.config, name="other", threads=1), 0).folder == key
        folders = {
            training_run(project, SUBMAP, r.config, seed).folder for r in ablation_rows(BUDGET) for seed in (0, 1)
        }
        assert len(folders) == 2 * len(ROWS)
        ledger.begin_part(project, "floors", "other masks")
        ledger.finish(project, "floors", 0.0, {})
        assert training_run(project, SUBMAP, ours, 0).folder != key, "other masks are other data"
        assert training_run(project, SUBMAP, ours, 0).folder.is_relative_to(project.layout.root / "ablation")


def test_figures_are_means_over_frames_and_spread_over_seeds() -> None:
    a = ScoredRun([{"psnr": 20.0}, {"psnr": 24.0}], [{"novel_psnr": 18.0}], 10.0, 100)
    b = ScoredRun([{"psnr": 31.0}], [{"novel_psnr": float("nan")}], 5.0, 50)
    both = mean_over_submaps([a, b])
    assert both == {"psnr": 25.0, "novel_psnr": 18.0, "frames": 3, "seconds": 15.0, "gaussians": 150}
    over = _over_seeds([both, {**both, "psnr": 27.0, "novel_psnr": None}])
    assert over["psnr"] == 26.0 and over["psnr_spread"] == pytest.approx(2**0.5, abs=1e-4)
    assert over["frames"] == 3 and "novel_psnr_spread" not in over
    assert "psnr_spread" not in _over_seeds([both])


FIGURES = {"psnr": 20.0, "psnr_nonfloor": 21.0, "alpha_floor": 0.5, "alpha_nonfloor": 0.9}


def outcome() -> AblationResult:
    image = np.full((48, 64, 3), 0.25, np.float32)
    floor = np.zeros((48, 64), bool)
    floor[24:] = True
    shown = [ComparedImage.of("held out: a.jpg", image, floor), ComparedImage.of("novel: 001", image, None)]
    novel = {"novel_psnr": 20.0, "novel_psnr_down": 19.0, "novel_alpha_floor": float("nan")}
    tiles = [
        [Tile.of(np.full_like(image, level), np.full((48, 64), 1 - level, np.float32), f) for level in (0.5, 0.75)]
        for f in (FIGURES, novel)
    ]
    row = {
        "row": "base",
        "title": "the base",
        **FIGURES,
        "novel_psnr": 20.0,
        "frames": 2,
        "seconds": 3.0,
        "gaussians": 9,
    }
    rows = [row, {**row, "row": "ours", "title": "ours, a longer title", "psnr": 22.0}]
    return AblationResult(
        {"ablation": AblationTable(rows, [{**r, "seed": 0, "submap": 0} for r in rows], tiles)}, shown, 2, 0
    )


def test_report_writes_text_csv_and_a_picture_whose_tiles_are_what_was_rendered(tmp_path: Path) -> None:
    files = write_report(outcome(), tmp_path / "out", "no LPIPS model: give --lpips FILE.onnx")
    assert [f.name for f in files] == ["tables.txt", "ablation.csv", "ablation.png"]
    text = files[0].read_text()
    assert "22.00*" in text and "Means over 2 held-out frames" in text
    assert "LPIPS is empty: no LPIPS model: give --lpips FILE.onnx." in text
    assert text == text_of(outcome(), "no LPIPS model: give --lpips FILE.onnx")
    rows = list(csv.DictReader(io.StringIO(files[1].read_text())))
    assert [(r["row"], r["seed"]) for r in rows] == [("base", "mean"), ("ours", "mean"), ("base", "0"), ("ours", "0")]
    assert float(rows[1]["psnr"]) == 22.0 and rows[0]["submap"] == "mean"
    sheet = cv2.imread(str(files[2]))
    height = round(48 * WIDTH / 64)
    # The frame is 0.25; the renders are 0.5 and 0.75 and their alphas 0.5 and 0.25; two pictures are shown.
    for gray, count in ((64, 2 + 2), (128, 2 + 2), (191, 2)):
        area = int((np.abs(sheet.astype(int) - gray).max(axis=2) == 0).sum())
        assert area == pytest.approx(count * (height - 2) * (WIDTH - 2), rel=0.01)
