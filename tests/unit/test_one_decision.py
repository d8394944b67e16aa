"""All modules that decide or explain an edge agree for equal evidence."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvsim.graph.types import Evidence, NavGraph, SecondOpinion, Viewpoint, edge
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import CELLS, DEPTH, NEAR, WIDTH, Corridor
from nvsim.mapping.criteria import CRITERIA, DECISIONS, OPEN, can_stand, decide
from nvsim.mapping.evidence.evidence_stack import EvidenceStack, decision_names
from nvsim.mapping.evidence.second_opinions import opinions
from nvsim.mapping.explanation.explain import closed_edge_reason, explain, smallest_margin
from nvsim.mapping.families import FAMILIES
from nvsim_app.state.directions import compass, directions
from nvsim_app.state.graph_arrays import GraphArrays
from nvsim_app.thresholds.slider import thresholds

CORRIDOR = Corridor((0.0, 0.0), (0.0, 2.5))
A, B = "a" * 32, "b" * 32
shares = st.floats(0, 1)


@st.composite
def evidences(draw: st.DrawFn) -> Evidence:
    """Anything between an empty and a filled corridor, with values at the limits among them."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shape = (CORRIDOR.rows, CELLS)

    def planes() -> dict[str, np.ndarray]:
        found = {name: (draw(shares) * rng.random(shape) * 255).astype(np.uint8) for name in ("alpha", "up", "reach")}
        mass = (draw(shares) * rng.random(shape) * 255).astype(np.uint8)
        network_up = 255 - (draw(shares) * rng.random(shape) * 255).astype(np.uint8)
        return {"alpha": found["alpha"], "up": 255 - found["up"], "reach": 255 - found["reach"], "mass": mass,
                "network_up": network_up}  # fmt: skip

    return Evidence(
        A, 0, CORRIDOR.heading, CORRIDOR.length, support=rng.random(shape) >= draw(shares) * 0.5, near=NEAR,
        depth=DEPTH, width=WIDTH, submap=0, target=CORRIDOR.target, **planes(),
        second=SecondOpinion(1, **planes()) if draw(st.booleans()) else None,
    )  # fmt: skip


@st.composite
def configs(draw: st.DrawFn) -> MappingConfig:
    limits = {c.field: draw(st.sampled_from([0.0, 51 / 255, 0.5, 204 / 255, 1.0]) | shares) for c in CRITERIA}
    rule = draw(st.sampled_from(["mean", "worst"]))
    criteria = draw(st.lists(st.sampled_from(FAMILIES), min_size=1))
    radius = draw(st.sampled_from([0.0, 0.1, 0.25, 0.4]))
    return MappingConfig(
        rule=rule, criteria=tuple(criteria), second_opinion=draw(st.booleans()), robot_radius=radius, **limits
    )


def graph_with(evidence: Evidence) -> NavGraph:
    places = {A: (0.0, 0.0, 1.5), B: (0.0, 2.5, 1.5)}
    viewpoints = {id: Viewpoint(id, place) for id, place in places.items()}
    joined = edge(A, B)
    return NavGraph("scan", viewpoints, {joined.key: joined}, {evidence.key: evidence})


@given(evidences(), configs())
def test_builder_stack_explanation_inspector_details_and_findings_say_the_same(
    evidence: Evidence, config: MappingConfig
) -> None:
    decision = decide(evidence, config)
    stack = EvidenceStack([evidence], np.zeros(1, np.int64), 1)
    assert decision_names()[int(stack.decide(config)[0])] == decision
    assert stack.can_stand(config).tolist() == [can_stand([evidence], config)]
    found = explain(evidence, config)
    assert found.decision == decision
    graph = graph_with(evidence)
    (direction,) = directions(graph, GraphArrays.of(graph), A, config)  # what inspector and details show
    assert direction.explanation.decision == decision and direction.open == (decision == OPEN)
    doubt = closed_edge_reason(config)(graph, (A, B))  # what findings and `nvsim graph check` say
    assert (doubt == "") == (decision == OPEN)
    assert decision == OPEN or DECISIONS[decision].clause in doubt
    least = smallest_margin(config)(graph, (A, B))
    assert least <= 0 if decision != OPEN else least >= 0


@given(evidences(), configs())
def test_the_value_shown_is_the_one_that_was_asked_about(evidence: Evidence, config: MappingConfig) -> None:
    found = explain(evidence, config)
    told = {one.submap: one for one in opinions(evidence, config)}
    assert set(told) == {one.submap for one in (found, found.other) if one is not None}
    for shown, measure in [(one.submap, m) for one in (found, found.other) if one is not None for m in one.measures]:
        rows, cells = measure.part
        plane = getattr(told[shown], measure.criterion.plane)[rows, cells]
        assert measure.value == pytest.approx(plane.mean() / (1 if plane.dtype == bool else 255))
        held = {"<": measure.value < measure.limit, "≤": measure.value <= measure.limit,
                ">": measure.value > measure.limit, "≥": measure.value >= measure.limit}  # fmt: skip
        assert held[measure.relation]


def test_every_criterion_has_a_slider_a_threshold_and_words() -> None:
    fields = {t.field for t in thresholds()}
    for criterion in CRITERIA:
        assert criterion.field in fields
        assert 0 <= criterion.limit(MappingConfig()) <= 1
        assert DECISIONS[criterion.word].label and DECISIONS[criterion.word].clause


def test_stale_evidence_is_shown_nowhere() -> None:
    blank = np.zeros((CORRIDOR.rows, CELLS), np.uint8)
    evidence = Evidence(
        A, 0, 0.0, 2.5, blank, blank + 255, blank == 0, NEAR, DEPTH, WIDTH, 0, CORRIDOR.target, stale=True
    )
    graph = graph_with(evidence)
    assert directions(graph, GraphArrays.of(graph), A, MappingConfig()) == ()
    assert closed_edge_reason(MappingConfig())(graph, (A, B)) == ""


def test_a_direction_that_is_blocked_reaches_as_far_as_the_way_is_clear() -> None:
    alpha = np.zeros((CORRIDOR.rows, CELLS), np.uint8)
    alpha[12] = 255
    clear = Evidence(
        A, 0, CORRIDOR.heading, 2.5, alpha * 0, alpha * 0 + 255, alpha == alpha, NEAR, DEPTH, WIDTH, 0, CORRIDOR.target
    )
    for evidence, reach in ((clear, 1.0), (replace(clear, alpha=alpha), (NEAR + 12 * DEPTH) / 2.5)):
        graph = replace(graph_with(evidence), edges={})
        (direction,) = directions(graph, GraphArrays.of(graph), A, MappingConfig())
        assert direction.reach == pytest.approx(reach)
        assert direction.passable == (reach == 1.0)


@pytest.mark.parametrize(
    ("degrees", "name"),
    [(0, "north"), (90, "east"), (180, "south"), (265, "west"), (-45, "north-west"), (23, "north-east")],
)
def test_headings_have_compass_names(degrees: float, name: str) -> None:
    assert compass(math.radians(degrees)) == name
