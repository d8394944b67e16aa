"""Corridors, the values measured on them, and the decision."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from columns import Columns, fill, flat_floor, room
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.errors import InputError
from nvsim.graph.types import Evidence
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import CELLS, DEPTH, NEAR, WIDTH, Corridor, view_of
from nvsim.mapping.criteria import can_stand, decide, is_sufficient
from nvsim.mapping.views.floor_view import measure
from nvsim.mapping.views.view_sources import camera_towards, render_pitched_views
from nvsim.occupancy.types import OCCUPIED

CONFIG = MappingConfig(margin=0.0)


def evidence(alpha: np.ndarray, support: np.ndarray | None = None, up: np.ndarray | None = None) -> Evidence:
    alpha = np.broadcast_to(alpha, (29, CELLS))
    known = np.ones_like(alpha, bool) if support is None else np.broadcast_to(support, alpha.shape)
    raised = 1 - alpha if up is None else np.broadcast_to(up, alpha.shape)
    cells = [np.round(v * 255).astype(np.uint8) for v in (alpha, raised)]
    return Evidence("v", 0, 0.0, 2.5, *cells, known, NEAR, DEPTH, WIDTH, 0, (0.0, 2.5))


def rows(*hidden: int) -> np.ndarray:
    alpha = np.zeros((29, CELLS))
    alpha[list(hidden)] = 1.0
    return alpha


@settings(deadline=None)
@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(0, 2 * np.pi), st.floats(0.3, 3.5))
def test_cells_tile_the_corridor(x: float, y: float, heading: float, length: float) -> None:
    corridor = Corridor((x, y), (x + length * np.sin(heading), y + length * np.cos(heading)))
    cells = corridor.cells()
    forward = np.array([np.sin(heading), np.cos(heading)])
    local = cells - np.array([x, y])
    along, across = local @ forward, local @ np.array([forward[1], -forward[0]])
    assert np.allclose(np.diff(along, axis=0), DEPTH, atol=1e-6) and np.allclose(np.diff(across, axis=1), WIDTH / CELLS)
    assert along.min() - DEPTH / 2 == pytest.approx(NEAR, abs=1e-6)
    assert length + WIDTH / 2 - 1e-6 <= along.max() + DEPTH / 2 < length + WIDTH / 2 + DEPTH + 1e-6
    assert np.allclose(across + across[:, ::-1], 0, atol=1e-6)


@settings(deadline=None)
@given(st.floats(0.5, 2.0), st.floats(0, 2 * np.pi), st.floats(0.3, 3.5))
def test_every_cell_lies_in_the_view_that_reads_it(height: float, heading: float, length: float) -> None:
    corridor = Corridor((0.0, 0.0), (length * np.sin(heading), length * np.cos(heading)))
    direction = view_of(corridor, CONFIG)
    camera = camera_towards(np.array([0, 0, height]), np.radians(7.5 + 45 * direction), CONFIG)
    inner = corridor.cells()[:, 4:14]  # a robot of 0.25 m radius
    pixels, depth = camera.project(np.concatenate([inner, np.zeros((*inner.shape[:2], 1))], axis=-1))
    assert (depth > 0).all() and (pixels > -1).all() and (pixels < CONFIG.view_size + 1).all()


@pytest.mark.parametrize("heading", np.radians([7.5, 20.0, 187.5, 301.0]))
def test_hidden_cells_are_those_behind_the_obstacle(heading: float) -> None:
    forward = np.array([np.sin(heading), np.cos(heading)])
    obstacle = np.array([4.0, 4.0]) + 1.5 * forward
    occupancy = fill(room(8, 8), *(obstacle - 0.5), *(obstacle + 0.5), OCCUPIED)
    world = Columns(occupancy)
    corridor = Corridor((4.0, 4.0), tuple(np.array([4.0, 4.0]) + 2.5 * forward))
    k = view_of(corridor, CONFIG)
    view = render_pitched_views(world, np.array([4.0, 4.0, 1.2]), {k: [corridor]}, flat_floor, CONFIG)[k]
    found = measure(view, "v", 0, corridor, flat_floor, world.support)
    middle = found.alpha[:, 8:10].mean(axis=1) / 255
    along = NEAR + (np.arange(len(middle)) + 0.5) * DEPTH
    # The square is reached between half its side and half its diagonal before its middle, whichever way it is met.
    assert (middle[along < 1.5 - 0.5 * 2**0.5 - 0.1] < 0.05).all()
    assert (middle[along > 1.5 - 0.5 + 0.1] > 0.95).all()
    assert np.array_equal(found.support, world.support(corridor.cells()))


def test_mean_forgives_what_the_worst_row_sees() -> None:
    paper, default = MappingConfig.paper(), CONFIG
    assert decide(evidence(rows()), default) == decide(evidence(rows()), paper) == "open"
    assert decide(evidence(rows(20)), default) == "alpha"
    assert decide(evidence(rows(20)), paper) == "open"
    assert decide(evidence(rows(*range(1, 29))), paper) == "alpha"


def test_one_cell_blocks_only_inside_the_robot_width() -> None:
    alpha = np.zeros((29, CELLS))
    alpha[10, 3] = 1.0  # its center is 0.275 m from the middle
    assert decide(evidence(alpha), CONFIG) == "open"
    assert decide(evidence(alpha), replace(CONFIG, robot_radius=0.3)) == "alpha"
    alpha[10, 4] = 1.0
    assert decide(evidence(alpha), CONFIG) == "alpha"


def test_rows_beyond_the_robot_at_the_end_of_the_step_do_not_count() -> None:
    assert decide(evidence(rows(27, 28)), CONFIG) == "open"
    assert decide(evidence(rows(26)), CONFIG) == "alpha"


def test_unknown_floor_is_not_free_and_a_sloping_thing_is_not_floor() -> None:
    support = np.ones((29, CELLS), bool)
    support[12] = False
    assert decide(evidence(rows(), support), MappingConfig.paper()) == "open", "the paper asks for no known floor"
    assert decide(evidence(rows(), support), CONFIG) == "unknown"
    assert decide(evidence(rows(), up=np.array(0.5)), CONFIG) == "normal"


@settings(deadline=None)
@given(st.integers(0, 28), st.integers(0, CELLS - 1), st.floats(0, 1))
def test_more_alpha_never_opens_a_corridor(row: int, cell: int, more: float) -> None:
    rng = np.random.default_rng(row * CELLS + cell)
    alpha = rng.uniform(0, 0.3, (29, CELLS))
    raised = alpha.copy()
    raised[row, cell] = max(alpha[row, cell], more)
    for config in (CONFIG, MappingConfig.paper()):
        if decide(evidence(raised), config) == "open":
            assert decide(evidence(alpha), config) == "open"


def test_standing_looks_at_the_floor_under_the_feet_only() -> None:
    assert can_stand([evidence(rows(*range(4, 29)))] * 8, CONFIG)
    assert not can_stand([evidence(rows(0, 1))] * 8, CONFIG)
    assert not can_stand([evidence(rows(), np.zeros((29, CELLS), bool))] * 8, CONFIG)
    assert not can_stand([], CONFIG)


def test_evidence_answers_only_what_it_measured() -> None:
    found = evidence(rows())
    assert is_sufficient(found, 2.5, 2 * np.pi, CONFIG)
    assert not is_sufficient(found, 2.4, 0.0, CONFIG)
    assert not is_sufficient(found, 2.5, 0.1, CONFIG)
    narrow = replace(found, width=0.5)
    assert is_sufficient(narrow, 2.5, 0.0, CONFIG)
    assert not is_sufficient(narrow, 2.5, 0.0, replace(CONFIG, margin=0.1))


def test_a_robot_wider_than_the_evidence_is_refused() -> None:
    with pytest.raises(InputError, match="robot-radius"):
        replace(CONFIG, robot_radius=0.5)
