"""Small views rendered in parallel equal those rendered one after the other, and an error in a thread is reported."""

from __future__ import annotations

import threading

import numba
import numpy as np
import pytest
from test_render_nearby import GEOMETRY, hall, view

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.backends import RenderOutput
from nvsim.render.geometry_views import side_by_side
from nvsim.render.scene import render_regions
from nvsim.render.workspace import RenderBuffers
from nvsim.splats.types import SubmapModel


def same(a: RenderOutput, b: RenderOutput) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in GEOMETRY)


def test_views_at_once_are_those_alone() -> None:
    model = SubmapModel(hall(3), None, None, FloorSurface.flat(0.0))
    cameras, masks = zip(*(view(seed) for seed in range(16)), strict=True)
    masks = (np.zeros_like(masks[0]), *masks[1:])
    alone = [render_regions(model, [c], [m], GEOMETRY)[0] for c, m in zip(cameras, masks, strict=True)]
    assert all(map(same, render_regions(model, cameras, masks, GEOMETRY), alone))
    assert not alone[0].alpha.any()  # type: ignore[union-attr]


def test_several_callers_do_not_disturb_each_other() -> None:
    model = SubmapModel(hall(4, 3000), None, None, FloorSurface.flat(0.0))
    cameras, masks = zip(*(view(seed) for seed in range(8)), strict=True)
    wanted = render_regions(model, cameras, masks, GEOMETRY)
    wrong: list[int] = []

    def draw() -> None:
        for _ in range(5):
            found = render_regions(model, cameras, masks, GEOMETRY)
            wrong.extend(i for i, (a, b) in enumerate(zip(found, wanted, strict=True)) if not same(a, b))

    threads = [threading.Thread(target=draw) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@pytest.mark.parametrize("bad", range(6))
def test_what_goes_wrong_is_told_and_the_threads_are_as_before(bad: int) -> None:
    def draw(i: int, workspace: RenderBuffers) -> int:
        if i == bad:
            raise ValueError(f"view {i}")
        return i

    before = numba.get_num_threads()
    with pytest.raises(ValueError, match=f"view {bad}"):
        side_by_side(draw, 6)
    assert numba.get_num_threads() == before
    assert side_by_side(lambda i, _: i * i, 6) == [0, 1, 4, 9, 16, 25]
