"""Fixtures that every test may use."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
FAST = {
    *("atomic", "reading", "stored_arrays", "events", "joblist", "submaps_split", "first_changes"),
    *("geometry", "geometry_camera_path", "geometry_lens", "geometry_rotation"),
    *("capture_clouds", "capture_images", "capture_multi", "capture_readers", "capture_store"),
    *("graph_connectivity", "graph_edits", "graph_history", "graph_journal", "graph_selection", "graph_storeys"),
}
"""Of tests/unit, the files that compile no kernel, start no process and open no window: `pytest -m fast`."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.parent.name == "unit" and item.path.stem.removeprefix("test_") in FAST:
            item.add_marker("fast")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real captures beside the repository; its absence is an error on CI and a skip elsewhere."""
    folder = Path(os.environ.get("NVSIM_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        if os.environ.get("CI") == "true":
            pytest.fail(f"the real captures are missing: {folder}")
        pytest.skip(f"the real captures are not here: {folder} (set NVSIM_DATA to their folder)")
    return folder


@pytest.fixture(scope="session", autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Tests, and the processes that they start, keep their secret apart from that of whoever runs them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield
