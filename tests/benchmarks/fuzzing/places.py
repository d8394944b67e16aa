"""Temporary folders for seeds, and small files of the shared data next to the checkout, if it exists."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_TESTS = Path(__file__).resolve().parents[2]
_LARGEST = 40_000


@contextmanager
def workshop() -> Iterator[Path]:
    """An empty folder that is deleted after the seeds are read from it."""
    with tempfile.TemporaryDirectory(prefix="seeds-") as name:
        yield Path(name)


def shared(pattern: str, largest: int = _LARGEST) -> list[Path]:
    """Small files of the shared data. Empty if the data is missing."""
    for root in (_TESTS.parent.parent / "shared" / "data", _TESTS.parents[2] / "shared" / "data"):
        if root.is_dir():
            return [p for p in sorted(root.glob(pattern)) if p.is_file() and p.stat().st_size <= largest]
    return []
