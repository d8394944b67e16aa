"""What may be opened in the window, asked before anything is closed for it."""

from __future__ import annotations

from pathlib import Path

from app.state.graph_files import holds_graph
from nvsim.files.reading import reading
from nvsim.graph.foreign import connectivity_files


def check_project(path: Path) -> None:
    """Raises InputError when `path` is neither a project that this version can read, nor a connectivity file or a
    folder of them, nor a file of a kind that may hold splats."""
    with reading(path, "a project, a connectivity file or a splat file", "choose one that is"):
        if holds_graph(path):
            connectivity_files(path)
            return
        if path.exists() and not path.is_dir():
            from nvsim.splats.formats.choice import recognise

            recognise(path)
            return
        from nvsim.project.project import Project

        Project.open(path).close()
