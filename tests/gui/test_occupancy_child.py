"""The map of a project, read in a process of its own."""

from __future__ import annotations

from pathlib import Path

import demo_project
import numpy as np
import pytest

from nvsim.errors import InputError
from nvsim.project.occupancy_maps import occupancy_of
from nvsim.project.project import Project
from nvsim_app.state.loading import ProjectReader
from nvsim_app.state.side_work import start_reading


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return demo_project.write_project(tmp_path / "demo.nvsim", count=500, models=0)


def test_the_map_is_the_one_that_the_project_holds(project: Path) -> None:
    found = start_reading(project).result()
    with Project.open(project) as opened:
        own = occupancy_of(opened)
        map_file = opened.layout.ground_truth / "map.yaml"
    assert found is not None and own is not None
    assert np.array_equal(found.cells, own.cells) and found.cells.dtype == np.uint8
    assert (found.resolution, found.origin) == (own.resolution, own.origin)
    alone = start_reading(map_file).result()
    assert alone is not None and np.array_equal(alone.cells, own.cells)


def test_what_is_wrong_with_a_map_is_one_sentence(project: Path) -> None:
    map_file = project / "ground_truth" / "map.yaml"
    map_file.write_text("image: nothing.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    with pytest.raises(InputError, match=r"nothing\.pgm"):
        start_reading(project).result()


def test_a_read_that_is_no_longer_needed_ends_at_once(project: Path) -> None:
    child = start_reading(project)
    child.kill()
    assert child.result() is None
    child.kill()  # harmless


def test_a_reader_that_is_interrupted_leaves_no_process(project: Path) -> None:
    reader = ProjectReader(project)
    updates = reader.updates()
    next(updates)
    reader.interrupt()
    assert all(contents.occupancy is None for contents in updates)
    reader.close()


def test_a_reader_that_is_left_in_the_middle_leaves_no_process(project: Path) -> None:
    reader = ProjectReader(project)
    for contents in reader.updates():
        if contents.graph is not None:
            break
    child = reader._child
    reader.close()
    assert child is not None and child.process_id is None
