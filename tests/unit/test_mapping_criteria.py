"""Criteria chosen by name: each family decides by its own measurement, alone or joined, and nothing is guessed."""

from __future__ import annotations

from dataclasses import asdict, replace
from itertools import combinations

import numpy as np
import pytest
from columns import Columns, flat_floor, room
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.graph.store import same_evidence
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import CELLS, DEPTH, NEAR, WIDTH
from nvsim.mapping.criteria import CRITERIA, can_stand, decide
from nvsim.mapping.evidence.evidence_stack import EvidenceStack
from nvsim.mapping.explanation.explain import closed_edge_reason, explain, smallest_margin
from nvsim.mapping.explanation.poor_graph import explain_no_viewpoint
from nvsim.mapping.families import FAMILIES, parse_families
from nvsim.render.backends import RenderOutput

SHAPE = (29, CELLS)
CLEAR = {"alpha": 0, "up": 255, "reach": 255, "mass": 0, "network_up": 255}
FILLED = {"alpha": 255, "up": 0, "reach": 0, "mass": 255, "network_up": 0}
PLANES = {"alpha": "alpha", "normal": "up", "network-normal": "network_up", "depth": "reach", "slice": "mass"}
SUBSETS = [names for size in range(1, len(FAMILIES) + 1) for names in combinations(FAMILIES, size)]


def evidence(*filled: str, known: bool = True, rows: slice = slice(None), lacks: tuple[str, ...] = ()) -> Evidence:
    """A clear corridor but for the planes that are `filled` along `rows`."""
    planes: dict[str, NDArray[np.uint8] | None] = {}
    for name, value in CLEAR.items():
        plane = np.full(SHAPE, value, np.uint8)
        plane[rows] = FILLED[name] if name in filled else value
        planes[name] = None if name in lacks else plane
    support = np.full(SHAPE, known)
    return Evidence("a", 0, 0.0, 2.5, support=support, near=NEAR, depth=DEPTH, width=WIDTH, submap=0,
                    target=(0.0, 2.5), **planes)  # fmt: skip


@pytest.mark.parametrize("rule", ["mean", "worst"])
@pytest.mark.parametrize("criteria", SUBSETS)
def test_a_family_decides_by_its_own_measurement_where_it_is_named(criteria: tuple[str, ...], rule: str) -> None:
    config = MappingConfig(rule=rule, criteria=criteria)  # type: ignore[arg-type]
    assert decide(evidence(), config) == "open"
    assert decide(evidence(known=False), config) == "unknown", "known floor is asked for whatever is named"
    for family, plane in PLANES.items():
        assert decide(evidence(plane), config) == (family if family in criteria else "open")
    assert decide(evidence(*FILLED), config) == criteria[0]


@pytest.mark.parametrize("criteria", SUBSETS)
def test_one_stands_where_every_family_named_leaves_the_floor_free(criteria: tuple[str, ...]) -> None:
    config = MappingConfig(criteria=criteria)
    assert can_stand([evidence()] * 8, config) and not can_stand([evidence(known=False)] * 8, config)
    for family, plane in PLANES.items():
        # The upward normal contains 1 - alpha and is not asked beside it.
        asked = family in criteria and not (family == "normal" and "alpha" in criteria)
        assert can_stand([evidence(plane, rows=slice(0, 4))] * 8, config) != asked
        assert can_stand([evidence(plane, rows=slice(8, None))] * 8, config), "what is ahead is not beneath"


@pytest.mark.parametrize("family", ["network-normal", "depth", "slice"])
def test_what_was_not_measured_is_said_and_not_guessed(family: str) -> None:
    config = MappingConfig(criteria=("alpha", family))
    old = evidence(lacks=("reach", "mass", "network_up"))
    assert decide(old, MappingConfig()) == "open"
    for deciding in (
        lambda: decide(old, config),
        lambda: explain(old, config),
        lambda: can_stand([old], config),
        lambda: EvidenceStack([old], np.zeros(1, np.int64), 1).decide(config),
        lambda: EvidenceStack([evidence(), old], np.zeros(2, np.int64), 1).decide(config),
    ):
        with pytest.raises(InputError, match=rf"{family}.*was not measured.*--reapply"):
            deciding()
    joined = edge("a", "b")
    viewpoints = {id: Viewpoint(id, (0.0, y, 1.5)) for id, y in (("a", 0.0), ("b", 2.5))}
    graph = NavGraph("pair", viewpoints, {joined.key: joined}, {old.key: old})
    assert closed_edge_reason(config)(graph, joined.key) == "" and np.isnan(smallest_margin(config)(graph, joined.key))


def test_an_explanation_shows_what_was_measured_and_says_what_decides() -> None:
    config = MappingConfig(criteria=("slice",))
    shown = {m.criterion.field: m.decides for m in explain(evidence("alpha"), config).measures}
    assert set(shown) == {c.field for c in CRITERIA}
    assert {field for field, decides in shown.items() if decides} == {
        "tau_slice", "row_slice", "cell_slice", "support",
    }  # fmt: skip
    few = {
        m.criterion.family for m in explain(evidence(lacks=("reach", "mass", "network_up")), MappingConfig()).measures
    }
    assert few == {"alpha", "normal", ""}


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("alpha,normal",), ("alpha", "normal")),
        (("slice", "alpha"), ("alpha", "slice")),
        ((" depth , depth,",), ("depth",)),
        (["normal"], ("normal",)),
    ],
)
def test_names_stand_alone_or_joined_in_any_order(names: tuple[str, ...], expected: tuple[str, ...]) -> None:
    assert parse_families(names) == MappingConfig(criteria=names).criteria == expected


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ((), "No criterion"),
        ((",",), "No criterion"),
        (("fog",), "'fog' is unknown"),
    ],
)
def test_other_names_are_refused_with_a_sentence(names: tuple[str, ...], words: str) -> None:
    with pytest.raises(InputError, match=words):
        MappingConfig(criteria=names)


def test_a_map_that_was_built_before_stays_current_until_what_came_later_is_used() -> None:
    before = {"rule", "tau_alpha", "tau_normal", "tau_dist", "row_alpha", "cell_alpha", "row_normal", "support",
              "both_ways", "robot_radius", "margin", "merge_radius", "max_distance", "max_viewpoints",
              "cover_distance", "lattice_offset", "view_size", "checked_merges", "standing", "start", "starts",
              "isolated", "jitter", "settle", "reach", "stretch"}  # fmt: skip
    config = MappingConfig()
    kept = {name: value for name, value in asdict(config).items() if name in before}
    assert config.key == {"MappingConfig": kept} == replace(config, row_slice=0.3, tau_depth=0.5).key
    assert config.key != replace(config, criteria=("alpha",)).key
    both = replace(config, criteria=("alpha", "depth"))
    assert both.key != replace(both, tau_depth=0.5).key and both.key == replace(both, row_slice=0.3).key


class Deep(Columns):
    """Columns whose views have depth: what hides the floor stands halfway to it."""

    def views(self, position, cameras, masks):  # type: ignore[no-untyped-def]
        submap, views = super().views(position, cameras, masks)
        for camera, view in zip(cameras, views, strict=True):
            assert view.alpha is not None
            rays = camera.rays() @ camera.camera_to_world[:3, :3]
            down = np.maximum(-camera.rays()[..., 2], 1e-6)
            to_floor = camera.position[2] / down * rays[..., 2]
            view.depth = np.where(view.alpha > 0.001, 0.5 * to_floor, 0).astype(np.float32)
        return submap, views


def test_remembered_evidence_is_measured_again_only_where_it_lacks_what_is_asked() -> None:
    world, plain = Deep(room(5, 4)), MappingConfig(view_size=96, settle=False, jitter=0.0)
    walk = np.array([(1.0, 2.0, 1.2), (2.0, 2.0, 1.2), (3.0, 2.0, 1.2), (4.0, 2.0, 1.2)])

    def built(config: MappingConfig, previous: NavGraph | None = None) -> tuple[NavGraph, int]:
        views = world.rendered
        graph = build_map(world, walk, flat_floor, world.support, config, scan="deep", previous=previous).graph
        return graph, world.rendered - views

    deep = replace(plain, criteria=("alpha", "depth"))
    fresh, many = built(deep)
    assert {e.reach is None for e in fresh.evidence.values()} == {False} and many > 0
    assert built(deep, fresh)[1] == 0 and built(plain, fresh)[1] == 0
    old = replace(fresh, evidence={key: replace(e, reach=None) for key, e in fresh.evidence.items()})
    assert built(plain, old)[1] == 0
    again, views = built(deep, old)
    assert views == many and all(same_evidence(again.evidence[k], e) for k, e in fresh.evidence.items())


def test_a_view_without_depth_gives_no_reach() -> None:
    class Flat(Columns):
        def _view(self, camera):  # type: ignore[no-untyped-def]
            view = super()._view(camera)
            return RenderOutput(alpha=view.alpha, normal=view.normal)

    world = Flat(room(5, 4))
    with pytest.raises(InputError, match="'depth'"):
        config = MappingConfig(view_size=96, criteria=("depth",))
        build_map(world, np.array([(2.0, 2.0, 1.2)]), flat_floor, world.support, config, scan="flat")


def test_where_nobody_can_stand_the_sentence_names_what_refused() -> None:
    refused = [(0.02, 1.0), (0.05, 0.9)]
    assert "Gaussians are between" in explain_no_viewpoint(refused, MappingConfig(criteria=("slice",)))
    assert "mean alpha at least 0.31" in explain_no_viewpoint([(0.31, 1.0)], MappingConfig(criteria=("alpha", "slice")))
    assert "too little known floor" in explain_no_viewpoint([(0.9, 0.1)], MappingConfig(criteria=("slice",)))
