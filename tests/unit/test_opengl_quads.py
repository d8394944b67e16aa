"""The kernels that feed OpenGL, without OpenGL."""

from __future__ import annotations

import numpy as np
import pytest

from nvsim.render import kernel_types
from nvsim.render.opengl.quads import QUAD_WIDTH, nearest_first, write_quads


def splats_of(covariances: np.ndarray, opacity: float) -> np.ndarray:
    """Rows as projection writes them, in double precision and then rounded."""
    rows = np.zeros((len(covariances), kernel_types.WIDTH))
    inverse = np.linalg.inv(covariances)
    scale = -0.5 * np.log2(np.e)
    rows[:, kernel_types.CONIC_A], rows[:, kernel_types.CONIC_C] = scale * inverse[:, 0, 0], scale * inverse[:, 1, 1]
    rows[:, kernel_types.CONIC_B] = 2 * scale * inverse[:, 0, 1]
    rows[:, kernel_types.LOG_OPACITY] = np.log2(opacity)
    reach = np.sqrt(2 * np.log(255 * opacity))
    rows[:, kernel_types.HALF_WIDTH] = reach * np.sqrt(covariances[:, 0, 0])
    rows[:, kernel_types.HALF_HEIGHT] = reach * np.sqrt(covariances[:, 1, 1])
    return rows.astype(np.float32)


def quads_of(splats: np.ndarray) -> np.ndarray:
    quads = np.empty((len(splats), QUAD_WIDTH), np.float32)
    write_quads(splats, np.arange(len(splats), dtype=np.int32), len(splats), 2, quads)
    return quads.astype(np.float64)


@pytest.mark.parametrize("longest", [3.0, 300.0, 5000.0])
def test_a_quad_has_the_axes_of_its_ellipse(longest: float) -> None:
    """The outer products of the semi-axes add up to the covariance times the squared reach; also for a splat that is a
    thousand times longer than wide, whose determinant has no digit left in single precision."""
    r = np.random.default_rng(4)
    turn = np.concatenate([r.uniform(0, np.pi, 60), np.arange(5) * np.pi / 4, [1e-4]])
    long, short = np.exp(r.uniform(0, np.log(longest), len(turn))), np.full(len(turn), 0.55)
    axes = np.stack([np.stack([np.cos(turn), np.sin(turn)], -1), np.stack([-np.sin(turn), np.cos(turn)], -1)], 1)
    covariances = np.einsum("nk,nki,nkj->nij", np.stack([long, short], 1) ** 2, axes, axes)
    quads = quads_of(splats_of(covariances, 0.8))
    u, v = quads[:, 2:4], quads[:, 4:6]
    reach = np.sqrt(2 * np.log(255 * 0.8))
    assert np.linalg.norm(u, axis=1) == pytest.approx(reach * np.maximum(long, short), rel=1e-4)
    assert np.linalg.norm(v, axis=1) == pytest.approx(reach * np.minimum(long, short), rel=1e-4)
    assert np.abs(np.einsum("ni,ni->n", u, v)).max() < 1e-4 * longest
    # How far the tip is off sideways, pixels.
    side = np.where((long > short)[:, None], axes[:, 1], axes[:, 0])
    assert np.abs(np.einsum("ni,ni->n", u, side)).max() < 0.02


def test_a_round_splat_has_a_square() -> None:
    quads = quads_of(splats_of(np.eye(2)[None] * 4.0, 0.5))
    assert np.linalg.norm(quads[0, 2:4]) == pytest.approx(np.linalg.norm(quads[0, 4:6]), rel=1e-3)


@pytest.mark.parametrize("blocks", [1, 2, 5])
def test_rows_are_ordered_nearest_first(blocks: int) -> None:
    r = np.random.default_rng(blocks)
    n = 3000
    splats = np.zeros((n, kernel_types.WIDTH), np.float32)
    splats[:, kernel_types.DEPTH] = np.exp(r.uniform(np.log(0.05), np.log(30), n))
    visible = np.array([r.integers(0, n // blocks) for _ in range(blocks)], np.int32)
    keys, order = np.empty((2, n), np.uint32), np.empty((2, n), np.int32)
    count = nearest_first(splats, visible, keys[0], order[0], keys[1], order[1])
    shown = np.concatenate([np.arange(n * b // blocks, n * b // blocks + visible[b]) for b in range(blocks)])
    assert sorted(order[0, :count]) == list(shown)
    depths = splats[order[0, :count], kernel_types.DEPTH]
    assert (np.diff(depths) > -1e-5 * depths[1:]).all()


@pytest.mark.parametrize("depth", [None, 2.0])
def test_nothing_and_equal_depths_are_ordered_too(depth: float | None) -> None:
    n = 0 if depth is None else 40
    splats = np.zeros((n, kernel_types.WIDTH), np.float32)
    splats[:, kernel_types.DEPTH] = depth or 0
    keys, order = np.empty((2, n), np.uint32), np.empty((2, n), np.int32)
    assert nearest_first(splats, np.array([n], np.int32), keys[0], order[0], keys[1], order[1]) == n
    assert list(order[0]) == list(range(n))
