"""Opening projects and splat files, reading again, saving an image of the view."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from PySide6.QtWidgets import QFileDialog

from app.actions import Action
from app.state.graph_files import ForeignGraph
from app.state.graph_reasons import with_scans
from app.state.reasons import with_project
from app.wiring.part import Part
from nvsim.splats.formats.choice import READABLE


class FilePart(Part):
    ACTIONS = (
        Action(
            "open",
            "&Open project…",
            "Open another project folder",
            "&File",
            shortcut="Ctrl+O",
            icon="open",
            toolbar=True,
        ),
        Action(
            "open_splats",
            "Open s&plats…",
            "Open a splat file of any program: PLY, compressed PLY, SPZ, SOG, .splat",
            "&File",
            shortcut="Ctrl+Shift+O",
        ),
        Action(
            "open_graph",
            "Open &graph…",
            "Open any connectivity file: of Matterport3D, R2R, or NVSim",
            "&File",
            shortcut="Ctrl+G",
        ),
        Action(
            "next_scan",
            "Ne&xt scan",
            "Open the next connectivity file of the same folder",
            "&File",
            shortcut="Ctrl+PgDown",
            enabled=with_scans,
        ),
        Action(
            "previous_scan",
            "Pre&vious scan",
            "Open the connectivity file before in the same folder",
            "&File",
            shortcut="Ctrl+PgUp",
            enabled=with_scans,
        ),
        Action(
            "refresh",
            "&Refresh",
            "Read the project again now",
            "&File",
            shortcut="F5",
            icon="refresh",
            enabled=with_project,
        ),
        Action(
            "screenshot",
            "&Save image of the view…",
            "Save what the 3D view shows as a PNG file",
            "&File",
            1,
            "Ctrl+Alt+S",
            "camera",
        ),
        Action(
            "close_project",
            "&Close project",
            "Go back to the first page; running jobs go on",
            "&File",
            2,
            "Ctrl+W",
            enabled=with_project,
        ),
        Action("quit", "&Quit", "Close the window; running jobs go on", "&File", 2, "Ctrl+Q", "quit"),
    )

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        window = self.workspace.window
        return {
            "open": self.choose_project,
            "open_splats": self.choose_splats,
            "open_graph": self.choose_graph,
            "next_scan": lambda: self._step_scan(1),
            "previous_scan": lambda: self._step_scan(-1),
            "refresh": window.refreshWanted.emit,
            "screenshot": self.choose_picture,
            "close_project": window.closeWanted.emit,
            "quit": window.close,
        }

    def choose_project(self) -> None:
        folder = QFileDialog.getExistingDirectory(self.workspace.window, "Open a project", self._start())
        if folder:
            self.workspace.window.projectChosen.emit(Path(folder))

    def choose_splats(self) -> None:
        pattern = " ".join(f"*{suffix}" for suffix in READABLE)
        window = self.workspace.window
        name, _ = QFileDialog.getOpenFileName(window, "Open a splat file", self._start(), f"Splats ({pattern})")
        if name:
            window.projectChosen.emit(Path(name))

    def choose_graph(self) -> None:
        window = self.workspace.window
        pattern = "Connectivity (*_connectivity.json *.json)"
        name, _ = QFileDialog.getOpenFileName(window, "Open a graph", self._start(), pattern)
        if name:
            window.projectChosen.emit(Path(name))

    def _step_scan(self, step: int) -> None:
        file = self.workspace.document.contents.graph_file
        if isinstance(file, ForeignGraph) and self.workspace.document.path in file.scans:
            at = file.scans.index(self.workspace.document.path)
            self.workspace.window.projectChosen.emit(file.scans[(at + step) % len(file.scans)])

    def choose_picture(self) -> None:
        window = self.workspace.window
        name, _ = QFileDialog.getSaveFileName(window, "Save image", "view.png", "PNG (*.png)")
        if name:
            window.save_picture(Path(name), self.workspace.scene)

    def _start(self) -> str:
        return str(self.workspace.document.path or Path.home())
