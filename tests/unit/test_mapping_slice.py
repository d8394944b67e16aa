"""The slice of a model between floor and camera, against integrals of a single Gaussian and things of known place."""

from __future__ import annotations

import math

import numpy as np
import pytest
from columns import flat_floor
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from nvsim.geometry.rotation import matrix_from_quaternion
from nvsim.mapping.corridor import CELLS, DEPTH, NEAR, WIDTH, Corridor
from nvsim.mapping.slice_mass import ABOVE_FLOOR, SliceGaussians
from nvsim.splats.types import Gaussians

AHEAD = Corridor((0.0, 0.0), (0.0, 2.5))


def gaussians(rows: list[tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...], float]]) -> Gaussians:
    """Means, standard deviations, quaternions and opacities."""
    means, deviations, quats, opacity = (np.array([row[i] for row in rows], np.float32) for i in range(4))
    logits = np.log(opacity / (1 - opacity)).astype(np.float32)
    return Gaussians(means, np.log(deviations), quats, logits, np.zeros((len(rows), 1, 3), np.float32))


def covered(
    corridor: Corridor, mean: NDArray, covariance: NDArray, opacity: float, low: float, high: float
) -> NDArray[np.float64]:
    """(rows, CELLS) the Gaussian's cover by numerical integration along the vertical through each cell's center, of its
    density widened by a uniform cell's variance, relative to its own peak as seen from above."""
    forward = np.array([math.sin(corridor.heading), math.cos(corridor.heading)])
    right = np.array([forward[1], -forward[0]])
    cell = DEPTH**2 / 12 * np.outer(forward, forward) + (WIDTH / CELLS) ** 2 / 12 * np.outer(right, right)
    wide = covariance + np.pad(cell, (0, 1))
    density = multivariate_normal(mean, wide, allow_singular=False)
    peak = 1 / (2 * np.pi * math.sqrt(np.linalg.det(covariance[:2, :2])))
    found = np.zeros((corridor.rows, CELLS))
    for place in np.ndindex(found.shape):
        column = [*corridor.cells()[place]]
        found[place] = opacity / peak * quad(lambda z, xy=column: density.pdf([*xy, z]), low, high, epsabs=1e-9)[0]
    return found


@pytest.mark.parametrize("heading", [0.0, 0.6, 4.0])
@pytest.mark.parametrize("top", [1.2, 0.4])
def test_one_gaussian_covers_what_its_integral_says(heading: float, top: float) -> None:
    corridor = Corridor((3.0, -2.0), (3.0 + 0.8 * math.sin(heading), -2.0 + 0.8 * math.cos(heading)))
    forward = np.array([math.sin(heading), math.cos(heading)])
    mean = np.array([*(np.array([3.0, -2.0]) + 0.5 * forward), 0.35])
    deviations, quat = np.array([0.12, 0.05, 0.2]), np.array([0.9, 0.2, -0.3, 0.25])
    axes = matrix_from_quaternion(quat) * deviations
    found = SliceGaussians(gaussians([(tuple(mean), tuple(deviations), tuple(quat), 0.8)])).mass(
        corridor, flat_floor, top
    )
    truth = covered(corridor, mean, axes @ axes.T, 0.8, ABOVE_FLOOR, top)
    assert found / 255 == pytest.approx(truth, abs=1.5 / 255) and truth.max() > 0.3


@pytest.mark.parametrize(
    ("z", "seen"), [(0.03, False), (0.3, True), (1.0, True), (1.6, False)], ids=["rug", "stool", "shelf", "lamp"]
)
def test_only_what_stands_between_floor_and_camera_counts(z: float, seen: bool) -> None:
    sheet = [((x, y, z), (0.05, 0.05, 0.01), (1.0, 0.0, 0.0, 0.0), 0.95)
             for x in np.arange(-0.5, 0.51, 0.05) for y in np.arange(1.0, 1.51, 0.05)]  # fmt: skip
    found = SliceGaussians(gaussians(sheet)).mass(AHEAD, flat_floor, 1.2)
    along = NEAR + (np.arange(AHEAD.rows) + 0.5) * DEPTH
    inside = (along > 1.05) & (along < 1.45)
    assert (found[inside] > 250).all() == seen and (found[inside] < 5).all() != seen
    assert (found[(along < 0.7) | (along > 1.8)] == 0).all()


def test_the_floor_that_counts_is_that_of_the_cell() -> None:
    lump = SliceGaussians(gaussians([((0.0, 1.0, 0.5), (0.05, 0.05, 0.05), (1.0, 0.0, 0.0, 0.0), 0.9)]))
    assert lump.mass(AHEAD, flat_floor, 1.2).max() > 150
    for height in (-2.0, 0.7):  # far below the lump, and above it
        assert lump.mass(AHEAD, lambda xy, h=height: np.full(xy.shape[:-1], h), 1.2).max() == 0  # type: ignore[misc]


def test_a_thin_wall_is_seen_wherever_it_crosses_the_cells() -> None:
    # Upright, 4 mm thick, of Gaussians one above the other, as a trained wall is.
    for y in np.linspace(1.0, 1.1, 7):
        wall = [((x, y, z), (0.03, 0.002, 0.03), (1.0, 0.0, 0.0, 0.0), 0.9)
                for x in np.arange(-0.5, 0.51, 0.03) for z in np.arange(0.05, 1.2, 0.03)]  # fmt: skip
        found = SliceGaussians(gaussians(wall)).mass(AHEAD, flat_floor, 1.2)
        assert found[:, 2:-2].max(axis=0).min() > 127, "it closes the corridor from side to side"
        assert (found[:8] == 0).all() and (found[13:] == 0).all(), "and nothing else"


def test_gaussians_outside_the_corridor_change_nothing() -> None:
    # 5,000 Gaussians over 30 x 30 m, of which some are wide: a slice of only those near the corridor is equal.
    random = np.random.default_rng(0)
    n = 5000
    means = random.uniform([-15, -15, -0.5], [15, 15, 3], (n, 3))
    sizes = np.where(random.random(n) < 0.02, 0.8, 0.06)[:, None] * random.uniform(0.2, 1.0, (n, 3))
    quats = random.normal(size=(n, 4))
    whole = gaussians([*zip(means.tolist(), sizes.tolist(), quats.tolist(), [0.7] * n, strict=True)])  # type: ignore[list-item]
    everywhere, found = SliceGaussians(whole), 0
    for heading, x, y in random.uniform([0, -12, -12], [2 * np.pi, 12, 12], (20, 3)):
        corridor = Corridor((x, y), (x + 2.5 * math.sin(heading), y + 2.5 * math.cos(heading)))
        near = np.hypot(*(means[:, :2] - (x, y)).T) < 3.0 + 3.4 * sizes.max(axis=1)
        fields = (whole.means, whole.log_scales, whole.quats, whole.opacity_logits, whole.sh)
        alone = SliceGaussians(Gaussians(*(array[near] for array in fields)))
        masses = everywhere.mass(corridor, flat_floor, 1.5), alone.mass(corridor, flat_floor, 1.5)
        assert np.abs(masses[0].astype(int) - masses[1]).max() <= 1
        found += int((masses[0] > 20).sum())
    assert found > 500, "the corridors are not empty"
