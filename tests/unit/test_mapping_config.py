"""Options of the map builder under which no search would end, or there would be nothing to see, are refused."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import pytest

from nvsim.errors import InputError
from nvsim.mapping.config import MappingConfig

NUMBERS = [field.name for field in fields(MappingConfig) if type(field.default) is float]


@pytest.mark.parametrize(
    ("name", "value"),
    [("merge_radius", -1.0), ("merge_radius", 0.0), ("tau_dist", 0.0), ("reach", -2.0), ("stretch", 0.5)]
    + [("max_viewpoints", 0), ("cover_distance", 0.0), ("jitter", 3.0), ("view_size", 3), ("panorama_width", 9)]
    + [("robot_radius", -0.1), ("margin", -0.1), ("max_distance", -1.0), ("around", -1.0)]
    + [(name, float("nan")) for name in NUMBERS],
)
def test_a_value_out_of_range_is_one_sentence_that_names_the_option(name: str, value: Any) -> None:
    with pytest.raises(InputError, match=f"^[^\n]*--{name.replace('_', '-')}[^\n]*$"):
        MappingConfig(**{name: value})


def test_the_paper_and_every_default_are_in_range() -> None:
    assert MappingConfig.paper().merge_radius == MappingConfig().merge_radius
