"""Clusters of the trajectory and their overlap, held against a slow reading of the definition."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from nvsim.errors import InputError
from nvsim.submaps.picture import draw_submaps
from nvsim.submaps.split import SubmapConfig, split, table_rows

walks = arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.floats(-20, 20, width=32))
level_walks = walks.map(lambda walk: walk * (1, 1, 0))  # on stairs, the overlap is larger


@settings(max_examples=60, deadline=None)
@given(level_walks, st.integers(1, 6), st.floats(0, 5))
def test_cores_share_out_the_frames_and_overlap_is_everything_within_delta(walk, count, delta):
    submaps = split(walk, SubmapConfig(count=count, overlap=delta))
    assert sorted(f for s in submaps for f in s.core) == list(range(len(walk)))
    assert len(submaps) == min(count, len(np.unique(walk, axis=0)))
    for s in submaps:
        distance = np.linalg.norm(walk[:, None] - walk[list(s.core)][None], axis=2).min(axis=1)
        near = set(np.flatnonzero(distance <= delta - 1e-6))
        perhaps = set(np.flatnonzero(distance <= delta + 1e-6)) | set(s.core)
        assert near <= set(s.frames) <= perhaps
        assert np.array_equal(s.positions, walk[list(s.core)])


@settings(max_examples=20, deadline=None)
@given(walks, st.integers(1, 6))
def test_split_is_deterministic_and_ordered_by_first_frame(walk, count):
    once, again = (split(walk.copy(), SubmapConfig(count=count)) for _ in range(2))
    assert [(s.core, s.frames) for s in once] == [(s.core, s.frames) for s in again]
    assert [s.index for s in once] == list(range(len(once)))
    assert [s.core[0] for s in once] == sorted(s.core[0] for s in once)


def test_clusters_are_those_of_agglomerative_clustering():
    from sklearn.cluster import AgglomerativeClustering

    walk = np.random.default_rng(3).normal(0, 5, (200, 3))
    labels = AgglomerativeClustering(n_clusters=7, linkage="ward").fit_predict(walk)
    expected = {tuple(np.flatnonzero(labels == k)) for k in range(7)}
    assert {s.core for s in split(walk, SubmapConfig(count=7))} == expected


def test_two_rooms_become_two_submaps_that_share_the_door():
    walk = np.column_stack([np.concatenate([np.linspace(0, 4, 40), np.linspace(6, 10, 40)]), np.zeros(80), np.ones(80)])
    first, second = split(walk, SubmapConfig(count=2, overlap=2.15))
    assert first.core == tuple(range(40)) and second.core == tuple(range(40, 80))
    assert first.frames[-1] == 41 and second.frames[0] == 38


@pytest.mark.parametrize("count", [1, 3, None])
def test_identical_positions_are_one_submap(count):
    (only,) = split(np.ones((7, 3)), SubmapConfig(count=count))
    assert only.core == only.frames == tuple(range(7))


def test_one_frame_is_one_submap_and_no_frame_is_none():
    assert len(split(np.zeros((1, 3)), SubmapConfig(count=4))) == 1
    assert split(np.zeros((0, 3))) == ()


def test_memory_budget_bounds_every_submap():
    walk = np.column_stack([np.arange(600) * 0.3, np.zeros(600), np.ones(600)])
    config = SubmapConfig(memory_gb=0.8, megabytes_per_frame=8.0)
    submaps = split(walk, config)
    assert config.frames_per_submap == 100
    assert max(len(s.frames) for s in submaps) <= 100
    assert 600 / 100 <= len(submaps) <= 24


def test_twenty_thousand_frames_do_not_need_all_pairs():
    walk = np.cumsum(np.random.default_rng(0).normal(0, 0.15, (20000, 3)), axis=0)
    submaps = split(walk, SubmapConfig(count=12))
    assert len(submaps) == 12 and sum(len(s.core) for s in submaps) == 20000


@pytest.mark.parametrize(
    "config", [SubmapConfig(count=0), SubmapConfig(overlap=-1), SubmapConfig(overlap=float("nan"))]
)
def test_senseless_settings_are_refused(config):
    with pytest.raises(InputError):
        split(np.zeros((5, 3)), config)


def test_table_and_picture_tell_the_same_story(tmp_path: Path):
    import cv2

    walk = np.column_stack([np.arange(40) * 0.3, np.zeros(40), np.ones(40)])
    submaps = split(walk, SubmapConfig(count=3, overlap=1.0))
    rows = table_rows(submaps, walk)
    assert [r["frames"] for r in rows] == [len(s.frames) for s in submaps]
    assert [r["shared frames"] for r in rows] == [len(s.frames) - len(s.core) for s in submaps]
    assert rows[0]["extent of own frames, m"] == f"{0.3 * (len(submaps[0].core) - 1):.1f} x 0.0 x 0.0"
    draw_submaps(walk, submaps, tmp_path / "submaps.png")
    picture = cv2.imread(str(tmp_path / "submaps.png"))
    colors = {tuple(c) for c in picture.reshape(-1, 3).tolist()}
    assert len(colors) > 4
