"""Corridors read from one panorama: the same regions as from pitched views, on closed forms and on a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from columns import Columns, fill, flat_floor, room
from numpy.typing import NDArray
from test_render_panorama import HERE, compass

from nvsim.benchmarks.map_builder import hall
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera
from nvsim.geometry.directions import Sphere
from nvsim.graph.store import same_evidence
from nvsim.graph.types import Evidence
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import Corridor, headings, offset_ahead
from nvsim.mapping.criteria import corridor_of, decide
from nvsim.mapping.views.floor_view import FloorView, measure
from nvsim.mapping.views.view_sources import render_pitched_views
from nvsim.occupancy.types import OCCUPIED
from nvsim.render.backends import RenderOutput
from nvsim.render.panorama import render_equirectangular
from nvsim.render.scene import render_regions

PITCHED = MappingConfig()
PANORAMA = replace(PITCHED, views="panorama")
CHANNELS = frozenset({"alpha", "normal", "depth"})
MODEL = hall()


class Hall:
    """The furnished hall. noise: what no mask asks for is noise, else all is rendered."""

    def __init__(self, noise: bool = True) -> None:
        self._noise = noise
        self.shares: list[float] = []

    def views(
        self, position: NDArray[np.floating], cameras: Sequence[Camera], masks: Sequence[NDArray[np.bool_]]
    ) -> tuple[int, list[RenderOutput]]:
        return 0, render_regions(MODEL, cameras, masks, CHANNELS)

    def panorama(self, sphere: Sphere, mask: NDArray[np.bool_], submap: int | None = None) -> tuple[int, RenderOutput]:
        self.shares.append(float(mask.mean()))
        asked = mask if self._noise else None
        size = sphere.width, sphere.height
        view = render_equirectangular(MODEL, sphere.position, *size, CHANNELS, sphere.heading, mask=asked)
        if self._noise:
            assert view.alpha is not None and view.normal is not None
            view.alpha[~mask] = np.random.default_rng(0).uniform(size=(~mask).sum())
            view.normal[~mask] = 1.0
        return 0, view


def known(points: NDArray[np.floating]) -> NDArray[np.bool_]:
    return np.ones(points.shape[:-1], bool)


def around(source: Hall, place: tuple[float, float], config: MappingConfig) -> list[Evidence]:
    """The evidence of the eight directions."""
    corridors = {
        k: [Corridor(place, tuple(np.array(place) + offset_ahead(h, 2.5)))] for k, h in enumerate(headings(config))
    }
    views = render_pitched_views(source, np.array([*place, 1.3]), corridors, flat_floor, config)
    return [measure(views[k], "v", k, c, flat_floor, known) for k, (c,) in corridors.items()]


@pytest.mark.parametrize("heading", [0.0, 2.5])
def test_the_sphere_is_that_of_the_rendered_panorama(heading: float) -> None:
    sphere = Sphere(HERE, 64, 32, heading)
    shown = render_equirectangular(compass(), HERE, 64, 32, heading=heading).rgb  # the color is the direction
    assert shown is not None and np.abs(shown - sphere.rays()).max() < 0.01
    pixels, distance = sphere.project(HERE + 3.0 * sphere.rays())
    rows, columns = np.mgrid[:32, :64] + 0.5
    assert np.allclose(pixels, np.stack([columns, rows], axis=-1), atol=1e-4) and np.allclose(distance, 3.0)


@pytest.mark.parametrize("heading", np.radians([0.0, 97.0, 180.0, 181.0, 352.5]))
def test_every_cell_is_read_where_it_lies_also_across_the_seam(heading: float) -> None:
    sphere = Sphere(np.array([3.0, -2.0, 1.3]), 512, 256)
    rays = sphere.rays()
    alpha = (0.5 + 0.3 * rays[..., 0] - 0.2 * rays[..., 1] + 0.2 * rays[..., 2]).astype(np.float32)
    view = FloorView(0, sphere, alpha, alpha * 0, np.ones(alpha.shape, bool))
    corridor = Corridor((3.0, -2.0), tuple(np.array([3.0, -2.0]) + offset_ahead(heading, 2.5)))
    way = np.concatenate([corridor.cells(), np.zeros((corridor.rows, 18, 1))], axis=-1) - sphere.position
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    expected = 0.5 + way @ np.array([0.3, -0.2, 0.2])
    found = measure(view, "v", 0, corridor, flat_floor, known)
    assert found.views == "panorama" and np.abs(found.alpha / 255 - expected).max() < 0.005


@pytest.mark.parametrize(("alpha", "z"), [(1.0, 0.75), (1.0, 0.3), (0.4, 0.75), (1.0, 0.0)])
def test_the_reach_of_depth_is_measured_along_the_ray(alpha: float, z: float) -> None:
    # As for a pitched view: a sheet at height z hides z of the height of the camera.
    sphere = Sphere(np.array([0.0, 0.0, 1.5]), 512, 256)
    down = np.minimum(sphere.rays()[..., 2], -1e-3)
    filled = np.full(down.shape, alpha, np.float32)
    depth = (alpha * (z - 1.5) / down).astype(np.float32)
    view = FloorView(0, sphere, filled, filled * 0, filled > 0, depth)
    found = measure(view, "v", 0, Corridor((0.0, 0.0), (0.0, 2.5)), flat_floor, known)
    assert found.reach is not None
    assert found.reach / 255 == pytest.approx(np.full(found.reach.shape, 1 - alpha * z / 1.5), abs=0.01)


@pytest.mark.parametrize("place", [(4.7, 4.5), (1.5, 1.2), (12.0, 10.6)])
def test_a_region_of_the_panorama_shows_what_the_pitched_view_shows(place: tuple[float, float]) -> None:
    flat, round_ = (around(Hall(), place, config) for config in (PITCHED, PANORAMA))
    blocked = 0
    for one, other in zip(flat, round_, strict=True):
        part = corridor_of(one, PITCHED)
        for plane in ("alpha", "up", "reach"):
            means = [float(getattr(e, plane)[part].mean()) / 255 for e in (one, other)]
            assert means[0] == pytest.approx(means[1], abs=0.01)
        assert decide(one, PITCHED) == decide(other, PANORAMA)
        blocked += decide(one, PITCHED) != "open"
    assert 0 < blocked < 8, "both answers are compared"


def test_only_what_the_regions_see_is_rendered() -> None:
    part, whole = Hall(), Hall(noise=False)
    for one, other in zip(*(around(source, (4.7, 4.5), PANORAMA) for source in (part, whole)), strict=True):
        assert np.array_equal(one.alpha, other.alpha) and np.array_equal(one.up, other.up)
    assert part.shares[0] < 0.4
    near, aside = Corridor((4.7, 4.5), (4.7, 6.0)), Corridor((4.7, 4.5), (4.7, 2.0))
    view = render_pitched_views(part, np.array([4.7, 4.5, 1.3]), {0: [near]}, flat_floor, PANORAMA)[0]
    assert view.shows_corridor(near, flat_floor) and not view.shows_corridor(aside, flat_floor)


def test_a_map_of_panoramas_is_that_of_pitched_views_and_evidence_says_which_it_is() -> None:
    world = Columns(fill(room(7, 5), 3.0, 1.5, 4.0, 2.5, OCCUPIED))
    walk = np.array([(1.0, 1.0, 1.2), (1.5, 3.8, 1.2), (5.8, 3.8, 1.2)])
    plain = MappingConfig(settle=False, jitter=0.0)
    sphere = replace(plain, views="panorama")

    def built(config: MappingConfig, **known_: object):  # type: ignore[no-untyped-def]
        before = world.rendered
        graph = build_map(world, walk, flat_floor, world.support, config, scan="v", **known_).graph  # type: ignore[arg-type]
        return graph, world.rendered - before

    flat, _ = built(plain)
    round_, many = built(sphere)
    # A corridor that touches the corner of a column may go either way.
    assert len(set(flat.edges) ^ set(round_.edges)) <= 2 < 10 < len(flat.edges)
    assert {e.views for e in round_.evidence.values()} == {"panorama"}
    assert built(sphere, previous=round_)[1] == 0, "what was measured is decided again"
    again, views = built(sphere, previous=flat)
    assert views == many, "what pitched views showed is not taken for a panorama"
    assert all(same_evidence(again.evidence[key], e) for key, e in round_.evidence.items())


def test_a_panorama_of_no_size_is_refused() -> None:
    with pytest.raises(InputError, match="panorama-width"):
        replace(PANORAMA, panorama_width=0)
