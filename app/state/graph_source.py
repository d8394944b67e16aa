"""Reads a connectivity file with the occupancy map and the point cloud beside it."""

from __future__ import annotations

from pathlib import Path

from app.state.graph_files import ForeignGraph
from app.state.loading import Contents, prepared
from app.state.occupancy_child import start_reading
from nvsim.files.placeholders import is_metadata_name
from nvsim.graph.foreign import ForeignFile, connectivity_files


class GraphSource:
    """A connectivity file, or the first scan of a folder of connectivity files."""

    def __init__(self, path: Path) -> None:
        """Raises InputError if a folder contains no connectivity file."""
        files = connectivity_files(path)
        self.path = files[0]
        self.scans = tuple(files if len(files) > 1 else _siblings(path))

    def contents(self) -> Contents:
        """Reads the file, and the map and the cloud beside it. Raises InputError with the entry and the reason if a
        file is damaged."""
        file = ForeignFile.open(self.path)
        child = None if file.beside.map is None else start_reading(file.beside.map)
        cloud = file.beside.points()
        occupancy = None if child is None else child.result()
        return prepared(
            Contents(
                self.path,
                graph=file.graph,
                graph_file=ForeignGraph(file, self.scans),
                cloud=cloud,
                occupancy=occupancy,
                notes=() if occupancy is None else occupancy.notes,
            )
        )


def _siblings(path: Path) -> list[Path]:
    """All connectivity files in the folder of `path`, sorted by name."""
    if not path.is_file():
        return [path]
    return sorted(p for p in path.parent.glob("*_connectivity.json") if not is_metadata_name(p.name))
