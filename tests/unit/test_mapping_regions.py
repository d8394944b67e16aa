"""Views of which only the corridors' regions are rendered give the same map as whole views."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from columns import flat_floor
from numpy.typing import NDArray

from nvsim.benchmarks.map_builder import HALL, hall
from nvsim.geometry.camera import Camera
from nvsim.graph.store import same_graph
from nvsim.mapping.builder import BuildResult, build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import Corridor
from nvsim.mapping.views.floor_view import measure
from nvsim.mapping.views.view_sources import render_pitched_views
from nvsim.render.backends import RenderOutput
from nvsim.render.model import render_model
from nvsim.render.scene import render_regions
from nvsim.render.workspace import tiles_of

CHANNELS = frozenset({"alpha", "normal"})
MODEL = hall()


class Source:
    """whole: the masks are not looked at; blank: what no mask asks for is noise."""

    def __init__(self, whole: bool) -> None:
        self._whole = whole
        self.tiles: list[float] = []

    def views(
        self, position: NDArray[np.floating], cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> tuple[int, list[RenderOutput]]:
        self.tiles += [float(tiles_of(m).mean()) for m in masks]
        if self._whole:
            return 0, [render_model(MODEL, c, CHANNELS) for c in cameras]
        views = render_regions(MODEL, cameras, masks, CHANNELS)
        noise = np.random.default_rng(0)
        for view, mask in zip(views, masks, strict=True):
            assert view.alpha is not None and view.normal is not None
            view.alpha[~mask] = noise.uniform(size=(~mask).sum())
            view.normal[~mask] = noise.uniform(size=((~mask).sum(), 3))
        return 0, views


def build(source: Source) -> BuildResult:
    walk = np.stack([np.linspace(1.5, 9.5, 30), np.full(30, 1.2), np.full(30, 1.3)], axis=-1)
    config = MappingConfig(max_viewpoints=14, view_size=128)
    return build_map(source, walk, flat_floor, inside, config, scan="regions")


def inside(points: NDArray[np.floating]) -> NDArray[np.bool_]:
    xy = points[..., :2]
    return np.asarray(((xy > 0) & (xy < np.array(HALL))).all(axis=-1))


def test_the_map_from_regions_is_that_from_whole_views() -> None:
    part, whole = Source(whole=False), Source(whole=True)
    from_part, from_whole = build(part), build(whole)
    assert same_graph(from_part.graph, from_whole.graph)
    for key, evidence in from_whole.graph.evidence.items():
        other = from_part.graph.evidence[key]
        assert np.array_equal(evidence.alpha, other.alpha) and np.array_equal(evidence.up, other.up)
    assert len(from_whole.graph.viewpoints) == 14 and from_whole.graph.edges
    assert np.mean(part.tiles) < 0.45, "most of the views is left out"


def test_a_view_says_which_corridors_it_shows() -> None:
    position, config = np.array([4.5, 4.5, 1.3]), MappingConfig()
    ahead, aside = Corridor((4.5, 4.5), (4.5, 7.0)), Corridor((4.5, 4.5), (5.4, 6.8))
    view = render_pitched_views(Source(whole=False), position, {0: [ahead]}, flat_floor, config)[0]
    assert view.shows_corridor(ahead, flat_floor) and not view.shows_corridor(aside, flat_floor)
    both = render_pitched_views(Source(whole=False), position, {0: [ahead, aside]}, flat_floor, config)[0]
    assert both.shows_corridor(aside, flat_floor)
    for corridor in (ahead, aside):
        truth = render_pitched_views(Source(whole=True), position, {0: [corridor]}, flat_floor, config)[0]
        a, b = (measure(v, "v", 0, corridor, flat_floor, inside) for v in (both, truth))
        assert np.array_equal(a.alpha, b.alpha) and np.array_equal(a.up, b.up)
