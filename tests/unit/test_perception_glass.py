"""A pane through which the floor's pattern shows is glass; a cupboard is not."""

import numpy as np

from nvsim.perception.glass import GlassVotes


def test_cubes_before_a_known_pattern_are_glass_and_cubes_before_another_are_not():
    rng = np.random.default_rng(0)
    h, w = 60, 80
    expected = np.repeat(rng.normal(4, 0.3, (h, w, 1)), 3, axis=2).astype(np.float32)
    other = np.repeat(rng.normal(4, 0.3, (h, w, 1)), 3, axis=2).astype(np.float32)
    left = np.arange(w)[None, :, None] < w // 2
    seen = np.where(left, 0.8 * expected + 0.5, other).astype(np.float32)  # darker, less contrast, the same pattern
    hits = np.zeros((h, w, 3), np.float32)
    hits[..., 0] = np.where(left[..., 0], 1.0, 5.0)
    votes = GlassVotes()
    votes.add_votes(seen, expected, np.ones((h, w), bool), hits, np.full((h, w), 2.0, np.float32))
    assert votes.glass(np.array([[1.0, 0, 0], [5.0, 0, 0], [9.0, 0, 0]], np.float32)).tolist() == [True, False, False]


def test_the_floor_at_the_foot_of_a_thing_does_not_make_it_glass():
    pattern = np.random.default_rng(1).normal(4, 0.3, (40, 40, 3)).astype(np.float32)
    votes = GlassVotes()
    votes.add_votes(
        pattern, pattern, np.ones((40, 40), bool), np.zeros((40, 40, 3), np.float32), np.full((40, 40), 0.1)
    )
    assert not votes.glass(np.zeros((1, 3), np.float32)).any()


def test_the_pixels_of_several_views_count_together():
    """A pane needs 60 pixels. Each view shows 48 of them in one cube."""
    h, w = 60, 80
    pattern = np.random.default_rng(2).normal(4, 0.3, (h, w, 3)).astype(np.float32)
    hits = np.zeros((h, w, 3), np.float32)
    hits[..., 0] = 5.0
    hits[20:26, 30:38, 0] = 1.0
    votes, place = GlassVotes(), np.array([[1.0, 0, 0]], np.float32)
    for expected in (False, True):
        votes.add_votes(pattern, pattern, np.ones((h, w), bool), hits, np.full((h, w), 2.0, np.float32))
        assert votes.glass(place).tolist() == [expected]
