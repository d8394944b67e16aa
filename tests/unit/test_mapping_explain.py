"""Explanations against the decisions they explain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvsim.graph.types import Evidence
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import CELLS, DEPTH, NEAR, WIDTH, Corridor
from nvsim.mapping.criteria import decide
from nvsim.mapping.explanation.explain import explain, outline

CORRIDOR = Corridor((1.0, 2.0), (2.5, 4.0))


def evidence(alpha: float = 0.0) -> Evidence:
    shape = (CORRIDOR.rows, CELLS)
    return Evidence(
        "a", 0, CORRIDOR.heading, CORRIDOR.length, np.full(shape, round(255 * alpha), np.uint8),
        np.full(shape, 255, np.uint8), np.ones(shape, bool), NEAR, DEPTH, WIDTH, 0, CORRIDOR.target, "", "",
    )  # fmt: skip


@given(st.integers(0, 2**32 - 1), st.sampled_from(["mean", "worst"]), st.floats(0, 1), st.floats(0, 1))
def test_the_explanation_decides_like_the_criteria(seed: int, rule: str, dark: float, limit: float) -> None:
    rng = np.random.default_rng(seed)
    e = evidence()
    e = replace(
        e,
        alpha=(rng.random(e.alpha.shape) * dark * 255).astype(np.uint8),
        up=(255 - rng.random(e.up.shape) * dark * 255).astype(np.uint8),
        support=rng.random(e.support.shape) > 0.1,
    )
    config = replace(MappingConfig(), rule=rule, row_alpha=limit, support=0.5)
    found = explain(e, config)
    assert found.decision == decide(e, config)
    assert (found.failed is None) == (found.decision == "open")


def test_the_row_that_decided_is_the_one_that_something_stands_in() -> None:
    e = evidence()
    e.alpha[12, 6:12] = 130
    found = explain(e, MappingConfig())
    assert found.decision == "alpha" and found.failed is not None and found.failed.criterion.field == "row_alpha"
    assert found.failed.part[0] == slice(12, 13)
    assert found.obstacle == pytest.approx(NEAR + 12 * DEPTH)


def test_what_stands_beside_the_robot_is_not_in_its_way() -> None:
    e = evidence()
    e.alpha[:, :2] = 255
    assert explain(e, MappingConfig()).decision == "open"
    assert explain(e, replace(MappingConfig(), robot_radius=0.4)).decision == "alpha"


def test_the_outline_of_the_whole_corridor_holds_its_cells() -> None:
    e = evidence()
    corners = outline(e, (slice(0, CORRIDOR.rows), slice(0, CELLS)))
    forward, across = corners[1] - corners[0], corners[3] - corners[0]
    assert np.linalg.norm(across) == pytest.approx(WIDTH)
    assert np.linalg.norm(forward) == pytest.approx(CORRIDOR.rows * DEPTH)
    cells = CORRIDOR.cells()
    middle = cells.reshape(-1, 2).mean(axis=0)
    np.testing.assert_allclose(corners.mean(axis=0), middle, atol=1e-9)
    first = corners[0] + forward / CORRIDOR.rows / 2 + across / CELLS / 2
    np.testing.assert_allclose(cells[0, 0], first, atol=1e-9)


def test_under_the_mean_rule_rows_are_measured_and_do_not_decide() -> None:
    e = evidence()
    e.alpha[10] = 255
    found = explain(e, MappingConfig.paper())
    assert found.decision == "open"
    assert {m.criterion.field for m in found.measures if not m.decides} == {"row_alpha", "cell_alpha", "row_normal"}
    assert not next(m for m in found.measures if m.criterion.field == "row_alpha").passes
