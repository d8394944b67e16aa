"""JSON becomes a dataclass with the types of its fields, or is refused with the reason."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any, Literal

import pytest

from nvsim.files.records import Count, Figure, record_of


@dataclass(frozen=True)
class Part:
    name: str
    share: Figure = 0.5


@dataclass(frozen=True)
class Whole:
    state: Literal["queued", "done"]
    count: Count
    size: tuple[int, int]
    parts: tuple[Part, ...] = ()
    low: float | None = None
    kept: bool = True


WHOLE = Whole("done", 3, (4, -5), (Part("a"), Part("b", 1.0)), -2.5, False)


def test_a_record_is_read_as_it_was_written() -> None:
    assert record_of(Whole, json.loads(json.dumps(asdict(WHOLE)))) == WHOLE


def test_missing_values_have_their_defaults_and_unknown_names_are_ignored() -> None:
    data = {"state": "queued", "count": 0, "size": [1, 2], "of_a_newer_version": {}}
    assert record_of(Whole, data) == Whole("queued", 0, (1, 2))


def test_a_whole_number_is_also_a_float() -> None:
    found = record_of(Whole, {"state": "done", "count": 1, "size": [1, 2], "low": 7})
    assert found.low == 7.0 and isinstance(found.low, float)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("state", "lost"),
        ("state", ["done"]),
        ("count", -1),
        ("count", 1.0),
        ("count", True),
        ("count", 1 << 63),
        ("size", [1, 2, 3]),
        ("size", "12"),
        ("parts", [{"share": 1.0}]),
        ("parts", [{"name": "a", "share": -0.1}]),
        ("parts", {"name": "a"}),
        ("low", float("nan")),
        ("low", float("inf")),
        ("low", 10**400),
        ("kept", 1),
    ],
)
def test_a_value_of_another_type_is_refused(name: str, value: Any) -> None:
    with pytest.raises(ValueError):
        record_of(Whole, {**json.loads(json.dumps(asdict(WHOLE))), name: value})


@pytest.mark.parametrize("data", [None, [], "text", {"state": "done"}])
def test_other_data_is_refused(data: Any) -> None:
    with pytest.raises(ValueError):
        record_of(Whole, data)
