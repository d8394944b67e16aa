"""An edge in the overlap of two submap models must be free in both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from columns import Columns, fill, flat_floor, room
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.graph.edits import add_edge
from nvsim.graph.quantities import clearness
from nvsim.graph.review import Review
from nvsim.graph.store import same_graph
from nvsim.graph.types import Evidence, NavGraph, SecondOpinion
from nvsim.mapping.builder import BuildResult, build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import CELLS, DEPTH, NEAR, WIDTH
from nvsim.mapping.criteria import can_stand, decide
from nvsim.mapping.evidence.measuring import MultiModelSource
from nvsim.mapping.evidence.rethreshold import Rethresholder
from nvsim.mapping.explanation.explain import closed_edge_reason, explain, smallest_margin
from nvsim.occupancy.types import OCCUPIED
from nvsim.render.backends import RenderOutput
from nvsim.splats.types import Gaussians
from nvsim_app.state.directions import directions
from nvsim_app.state.graph_arrays import GraphArrays

CONFIG = MappingConfig(view_size=96, settle=False, jitter=0.0)
ROOM = room(9, 6)
FLOATER = fill(ROOM, 4.2, 2.4, 4.6, 3.6, OCCUPIED)  # what the second model alone shows
WALK = np.column_stack([np.linspace(1.0, 8.0, 15), np.full(15, 3.0), np.full(15, 1.2)])
OVERLAP = (3.0, 6.0)  # meters along x where the second model was trained as well


class Pair(Columns):
    """The empty room, and another model of its middle, in which something floats."""

    def __init__(self) -> None:
        super().__init__(ROOM)
        self.second = Columns(FLOATER)

    def second_submap(self, position: NDArray[np.floating]) -> int | None:
        return 1 if OVERLAP[0] <= position[0] <= OVERLAP[1] else None

    def trained_at(self, submap: int, positions: NDArray[np.floating]) -> NDArray[np.bool_]:
        assert submap == 1
        return np.asarray((positions[:, 0] >= OVERLAP[0]) & (positions[:, 0] <= OVERLAP[1]))

    def views_of(
        self, submap: int, cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> list[RenderOutput]:
        assert submap == 1
        return self.second.views(cameras[0].position, cameras, masks)[1]

    def gaussians(self, submap: int) -> Gaussians:
        raise AssertionError("nobody asked for the slice")


def built(world: Columns, config: MappingConfig = CONFIG, previous: NavGraph | None = None) -> BuildResult:
    return build_map(world, WALK, flat_floor, world.support, config, scan="pair", previous=previous)


def crosses(graph: NavGraph, key: tuple[str, str]) -> bool:
    """Whether an edge meets what floats in the second model."""
    a, b = (np.array(graph.viewpoints[end].position[:2]) for end in key)
    along = a + np.linspace(0, 1, 200)[:, None] * (b - a)
    return bool((FLOATER.states_at(along) == OCCUPIED).any())


def test_no_edge_leads_through_what_one_of_two_models_shows() -> None:
    pair = Pair()
    assert isinstance(pair, MultiModelSource) and not isinstance(Columns(ROOM), MultiModelSource)
    graph, alone = built(pair).graph, built(Columns(ROOM)).graph
    assert any(crosses(alone, key) for key in alone.edges) and not any(crosses(graph, key) for key in graph.edges)
    for (id, _), evidence in graph.evidence.items():
        inside = OVERLAP[0] <= graph.viewpoints[id].position[0] <= OVERLAP[1]
        assert (evidence.second is not None) == inside
        if evidence.second is not None:
            assert evidence.second.submap == 1 and evidence.second.alpha.shape == evidence.alpha.shape
        else:
            assert evidence.decision != "disputed"
    disputed = [e for e in graph.evidence.values() if e.decision == "disputed"]
    assert disputed and all(e.second is not None and e.second.alpha.max() > 200 for e in disputed)


def test_without_an_overlap_or_without_the_option_nothing_more_is_rendered() -> None:
    pair = Pair()
    off = built(pair, replace(CONFIG, second_opinion=False))
    alone = built(Columns(ROOM))
    assert pair.second.rendered == 0 and same_graph(off.graph, alone.graph)
    assert off.report["rendered_views"] == alone.report["rendered_views"]


def test_what_was_measured_without_the_other_model_is_measured_again() -> None:
    first = built(Pair(), replace(CONFIG, second_opinion=False)).graph
    pair = Pair()
    again = built(pair, CONFIG, first)
    assert same_graph(again.graph, built(Pair()).graph) and 0 < pair.rendered < len(first.viewpoints) * 8
    remembered = Pair()
    built(remembered, CONFIG, again.graph)
    assert remembered.rendered == remembered.second.rendered == 0


def test_deciding_again_asks_both_and_ignores_the_second_where_it_is_not_wanted() -> None:
    graph = built(Pair()).graph
    redecider = Rethresholder(graph, WALK)
    assert not redecider.decide(CONFIG)
    loose = redecider.decide(replace(CONFIG, second_opinion=False))
    assert len(loose.new_edges) and not len(loose.lost_edges)
    ids = redecider.ids
    assert any(crosses(graph, (ids[a], ids[b])) for a, b in loose.new_edges)


def evidence(first: float, second: float) -> Evidence:
    planes = [np.full((29, CELLS), round(255 * alpha), np.uint8) for alpha in (first, second)]
    other = SecondOpinion(7, planes[1], 255 - planes[1])
    return Evidence("a", 0, 0.0, 2.5, planes[0], 255 - planes[0], planes[0] == planes[0], NEAR, DEPTH, WIDTH, 3,
                    (0.0, 2.5), second=other)  # fmt: skip


@pytest.mark.parametrize(
    ("first", "second", "decision"),
    [(0.0, 0.0, "open"), (0.5, 0.0, "disputed"), (0.0, 0.5, "disputed"), (0.5, 0.6, "alpha")],
)
def test_the_stricter_of_two_decides(first: float, second: float, decision: str) -> None:
    found = evidence(first, second)
    assert decide(found, CONFIG) == decision
    assert decide(found, replace(CONFIG, second_opinion=False)) == ("alpha" if first else "open")
    assert can_stand([found] * 8, CONFIG) == (first == second == 0)
    told = explain(found, CONFIG)
    assert told.decision == decision and told.other is not None and {told.submap, told.other.submap} == {3, 7}
    assert (told.failed is None) == (decision == "open")
    against_it, for_it = (3, 7) if first else (7, 3)
    words = f"submap {against_it} shows this, submap {for_it} shows the corridor free"
    assert told.disagreement == (words if decision == "disputed" else "")


def test_an_edge_that_two_models_disagree_about_is_doubted_and_reviewed_first() -> None:
    graph = built(Pair()).graph
    disputed = next(e for e in graph.evidence.values() if e.decision == "disputed" and e.joins)
    key = (min(disputed.viewpoint, disputed.joins), max(disputed.viewpoint, disputed.joins))
    ends = [id for id in graph.viewpoints if id not in key]
    unmeasured = next((a, b) for a in ends for b in ends if a < b and (a, b) not in graph.edges)
    graph = add_edge(add_edge(graph, *unmeasured), *key)
    order = Review(smallest_margin(CONFIG)).order(graph)
    assert order[0].edge == key and "two submap models disagree" in order[0].why and order[0].margin < 0
    assert order[1].edge == unmeasured
    why = closed_edge_reason(CONFIG)(graph, key)
    assert "the model of one submap shows the corridor free" in why and "submap 1 shows this" in why
    shown = directions(graph, GraphArrays.of(graph), disputed.viewpoint, CONFIG)
    (direction,) = [d for d in shown if d.key == disputed.key]
    assert direction.outcome_label == "models disagree" and "submap 0 shows the corridor free" in direction.sentence
    assert clearness(graph, key) < 0.1, "the second model counts there too"
