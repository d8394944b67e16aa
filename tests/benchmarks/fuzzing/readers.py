"""The list of all readers of the product. Add a reader to the file of its family, and a new family to this list."""

from __future__ import annotations

from fuzzing import (
    captures,
    depths,
    endpoints,
    features,
    graphs,
    maps,
    models,
    networks,
    project_files,
    projects,
    scans,
    splats,
    tasks,
    window,
)
from fuzzing.reader import Reader


def all_readers() -> list[Reader]:
    families = (
        *(captures, depths, splats, maps, graphs, projects, project_files, models, networks),
        *(features, scans, tasks, endpoints, window),
    )
    found = [r for family in families for r in family.readers()]
    assert len({r.name for r in found}) == len(found)
    return found
