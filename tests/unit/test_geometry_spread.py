"""Some of many, spread evenly."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from nvsim.geometry.sampling import evenly_spaced


@given(st.integers(0, 5000), st.integers(1, 400))
def test_the_ends_are_among_them_and_no_gap_is_much_wider_than_another(count: int, most: int) -> None:
    found = evenly_spaced(count, most)
    assert len(found) == min(count, most)
    assert found == sorted(set(found)) and (not found or found[0] == 0)
    gaps = [b - a for a, b in zip(found, found[1:])]
    assert not gaps or (found[-1] == count - 1 and max(gaps) - min(gaps) <= 1)
