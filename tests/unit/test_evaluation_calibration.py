"""Sweeps of thresholds against decisions one by one, intervals against scipy, and the files they are written to."""

from __future__ import annotations

import csv
import json
import math
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from columns import Columns, fill, flat_floor, room
from scipy.stats import binomtest

from nvsim.errors import InputError
from nvsim.evaluation.calibrated import Calibration, draw_calibration, text_of, write_calibration
from nvsim.evaluation.calibration import Corridors, calibrate
from nvsim.evaluation.graph import evaluate_graph
from nvsim.evaluation.interval import cases_needed, wilson
from nvsim.graph.types import NavGraph
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import decide
from nvsim.mapping.evidence.rethreshold import Rethresholder
from nvsim.occupancy.paths import segment_is_free
from nvsim.occupancy.types import OCCUPIED, OccupancyMap

CONFIG = MappingConfig(view_size=96, settle=False, jitter=0.0)
WALK = np.array([[1.0 + 0.5 * i, 2.0, 1.2] for i in range(15)])


@pytest.mark.parametrize(("part", "whole"), [(0, 1), (1, 1), (0, 40), (40, 40), (13, 40), (225, 226), (6372, 6492)])
def test_the_interval_is_that_of_wilson(part: int, whole: int) -> None:
    reference = binomtest(part, whole).proportion_ci(0.95, method="wilson")
    assert wilson(part, whole) == pytest.approx((reference.low, reference.high), abs=1e-12)


def test_nothing_counted_says_nothing_and_enough_is_as_many_as_it_takes() -> None:
    assert wilson(0, 0) == (0, 1)
    for lower in (0.5, 0.9, 0.99):
        count = cases_needed(lower)
        assert wilson(count, count)[0] >= lower > wilson(count - 1, count - 1)[0]


@pytest.fixture(scope="module")
def made() -> tuple[NavGraph, OccupancyMap]:
    """A graph built by a model that is noisy and does not see a post, and the true map."""
    seen = fill(room(9, 4), 6.0, 1.0, 6.5, 1.5, OCCUPIED)
    truth = fill(seen, 3.4, 2.2, 3.6, 2.4, OCCUPIED)
    world = Columns(seen, noise=0.12)
    return build_map(world, WALK, flat_floor, world.support, CONFIG, scan="test").graph, truth


@pytest.fixture(scope="module")
def found(made: tuple[NavGraph, OccupancyMap]) -> Calibration:
    return calibrate(*made, WALK, CONFIG, want=0.7)


def test_a_way_is_taken_when_all_that_was_measured_along_it_passes(made: tuple[NavGraph, OccupancyMap]) -> None:
    graph, truth = made
    ways: dict[object, list] = {}
    for e in graph.evidence.values():
        stands = [v.id for v in graph.viewpoints.values() if math.dist(v.position[:2], e.target) < 0.01]
        ways.setdefault(frozenset([e.viewpoint, *stands]) if stands else e.key, []).append(e)
    corridors = Corridors(graph, truth, 0.25)
    assert len(corridors.free) == len(ways) < len(graph.evidence)

    def free(radius: float) -> int:
        starts = [(graph.viewpoints[es[0].viewpoint].position[:2], es[0].target) for es in ways.values()]
        return sum(segment_is_free(truth, np.array(a), np.array(b), radius) for a, b in starts)

    assert (corridors.free.sum(), corridors.free_robot.sum()) == (free(0.0), free(0.25))
    for config in (CONFIG, replace(CONFIG, row_alpha=0.08), replace(CONFIG, both_ways=False, cell_alpha=0.3)):
        rule = all if config.both_ways else any
        assert corridors.accepted(config).sum() == sum(
            rule(decide(e, config) == "open" for e in es) for es in ways.values()
        )


def test_the_row_in_use_is_that_of_the_graph(made: tuple[NavGraph, OccupancyMap], found: Calibration) -> None:
    figures = evaluate_graph(*made, WALK[:, :2])
    assert (found.now["edges"], found.now["coverage"]) == (figures["edges"], figures["coverage"])
    assert 0 < found.now["valid_robot"] <= found.now["valid"] < found.now["accepted"], "the post is not seen"
    for sweep in found.sweeps.values():
        assert {**found.now} in [{k: v for k, v in row.items() if k != "threshold"} for row in sweep]


def test_a_row_is_what_the_thresholds_make_of_the_graph(
    made: tuple[NavGraph, OccupancyMap], found: Calibration
) -> None:
    graph, truth = made
    for field, value in (("row_alpha", 0.06), ("cell_alpha", 0.35), ("support", 1.0)):
        config = replace(CONFIG, **{field: value})
        again = Rethresholder(graph, WALK)
        after = again.apply(again.decide(config))
        joined = {id for key in after.edges for id in key}
        left = replace(after, viewpoints={i: v for i, v in after.viewpoints.items() if i in joined}, evidence={})
        figures = evaluate_graph(left, truth, WALK[:, :2])
        row = next(row for row in found.sweeps[field] if row["threshold"] == value)
        assert (row["edges"], row["viewpoints"]) == (figures["edges"], figures["nodes"])
        assert row["coverage"] == figures["coverage"]


def test_suggested_is_the_loosest_threshold_that_is_sure_enough(found: Calibration) -> None:
    looser = {"tau_alpha": 1, "row_alpha": 1, "cell_alpha": 1, "tau_normal": -1, "row_normal": -1, "support": -1}
    assert len(found.suggested) == 2 * len(looser)
    for row in found.suggested:
        low = "low" if row["judge"] == "point" else "low_robot"
        good = [r["threshold"] for r in found.sweeps[row["criterion"]] if r[low] >= found.want]
        assert row["threshold"] == max(good, key=lambda t: looser[row["criterion"]] * t, default=None)
        if good:
            at = next(r for r in found.sweeps[row["criterion"]] if r["threshold"] == row["threshold"])
            assert row["edges_change"] == at["edges"] - found.now["edges"]
    assert any(row["threshold"] is not None for row in found.suggested)


def test_what_is_out_of_reach_is_said(made: tuple[NavGraph, OccupancyMap]) -> None:
    found = calibrate(*made, WALK, CONFIG, want=0.9999)
    assert all(row["threshold"] is None for row in found.suggested)
    assert f"at least {cases_needed(0.9999)} accepted" in found.why_none and found.why_none in text_of(found)
    with pytest.raises(InputError, match="--want"):
        calibrate(*made, WALK, CONFIG, want=1.0)
    with pytest.raises(InputError, match="evidence"):
        calibrate(replace(made[0], evidence={}), made[1], WALK, CONFIG)


def test_files_hold_the_numbers(found: Calibration, tmp_path: Path) -> None:
    files = {f.suffix: f for f in write_calibration(found, tmp_path / "out")}
    with open(files[".csv"], newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(map(len, found.sweeps.values()))
    assert float(rows[7]["validity"]) == found.sweeps["tau_alpha"][7]["validity"]
    assert json.loads(files[".json"].read_text())["suggested"] == found.suggested
    texts = "".join(ElementTree.parse(files[".svg"]).getroot().itertext())
    assert all(name in texts for name in found.sweeps) and "suggested, robot" in texts
    assert cv2.imread(str(files[".png"])).shape[1] > 1000


def test_a_curve_is_where_its_values_are(found: Calibration) -> None:
    figure = draw_calibration(found)
    upper, lower = (figure.axes[i] for i in (0, 3))  # of the first criterion
    sweep = found.sweeps["tau_alpha"]
    curves = {line.get_label(): line.get_xydata().tolist() for line in (*upper.lines, *lower.lines)}
    accepted = [row for row in sweep if row["accepted"]]
    assert curves["valid, point"] == [[row["threshold"], row["validity"]] for row in accepted]
    assert curves["valid, robot"] == [[row["threshold"], row["validity_robot"]] for row in accepted]
    assert curves["accepted"] == [[row["threshold"], row["share"]] for row in sweep]
    assert curves["coverage"] == [[row["threshold"], row["coverage"]] for row in sweep]
    assert curves["now"][0][0] == CONFIG.tau_alpha
    band = upper.collections[0].get_paths()[0].vertices
    assert {row["low"] for row in accepted} <= set(band[:, 1].tolist()), "the interval"
