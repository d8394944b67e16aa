"""A connectivity file as the window reads it: its graph, and the map and the cloud beside it."""

from __future__ import annotations

from pathlib import Path

from app.state.graph_files import ForeignGraph
from app.state.loading import Contents, prepared
from app.state.occupancy_child import OccupancyChild
from nvsim.files.placeholders import is_metadata_name
from nvsim.graph.foreign import ForeignFile, connectivity_files


class GraphSource:
    """A connectivity file, or a folder of them, as the window opens it; of a folder the first scan."""

    def __init__(self, path: Path) -> None:
        """Raises InputError when a folder holds none."""
        files = connectivity_files(path)
        self.path = files[0]
        self.scans = tuple(files if len(files) > 1 else _siblings(path))

    def contents(self) -> Contents:
        """Reads it, and a map and a cloud beside it. Raises InputError with the entry and the reason."""
        file = ForeignFile.open(self.path)
        child = None if file.beside.map is None else OccupancyChild(file.beside.map)
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
    """The connectivity files in the folder of one, in order of their names."""
    if not path.is_file():
        return [path]
    return sorted(p for p in path.parent.glob("*_connectivity.json") if not is_metadata_name(p.name))
