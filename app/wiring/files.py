"""Opens every kind of file, reads the open project again, and saves an image of the view."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QFileDialog

from app.actions import Action
from app.panels.open_dialog import OpenDialog
from app.state.graph_files import ForeignGraph
from app.state.graph_reasons import with_scans
from app.state.reasons import with_project
from app.wiring.new_project import NewProjectPart
from app.wiring.part import Part
from nvsim.files.user_folders import home

_FOLDER = "open_folder"


class FilePart(Part):
    """Commands that open and close files."""

    ACTIONS = (
        Action("open", "&Open…",
               "Open a project, a capture, a video, a navigation graph (R2R connectivity), or a splat file", "&File",
               shortcut="Ctrl+O", icon="open", toolbar=True),
        Action("next_scan", "Ne&xt scan", "Open the next connectivity file in the same folder", "&File",
               shortcut="Ctrl+PgDown", enabled=with_scans),
        Action("previous_scan", "Pre&vious scan", "Open the previous connectivity file in the same folder", "&File",
               shortcut="Ctrl+PgUp", enabled=with_scans),
        Action("refresh", "&Refresh", "Read the project again", "&File", shortcut="F5", icon="refresh",
               enabled=with_project),
        Action("screenshot", "&Save image of the view…", "Save the 3D view as a PNG file", "&File", 1, "Ctrl+Alt+S",
               "camera"),
        Action("close_project", "&Close project", "Return to the start page; running jobs continue", "&File", 2,
               "Ctrl+W", enabled=with_project),
        Action("quit", "&Quit", "Close the window; running jobs continue", "&File", 2, "Ctrl+Q", "quit"),
    )  # fmt: skip

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        window = self.context.window
        return {
            "open": lambda _=False: self.choose(),
            "next_scan": lambda: self._step_scan(1),
            "previous_scan": lambda: self._step_scan(-1),
            "refresh": window.refreshWanted.emit,
            "screenshot": self.choose_picture,
            "close_project": window.closeWanted.emit,
            "quit": window.close,
        }

    def restore(self, settings: QSettings) -> None:
        self.context.window.start.openWanted.connect(self.choose)

    def choose(self) -> OpenDialog:
        """Opens the dialog that selects what to open."""
        dialog = OpenDialog(self._start(), self.context.window)
        dialog.chosen.connect(self._on_chosen)
        dialog.open()
        return dialog

    def _on_chosen(self, path: Path) -> None:
        self.context.settings.setValue(_FOLDER, str(path.parent))
        self.context.part(NewProjectPart).take([path])

    def _step_scan(self, step: int) -> None:
        file = self.context.document.contents.graph_file
        if isinstance(file, ForeignGraph) and self.context.document.path in file.scans:
            at = file.scans.index(self.context.document.path)
            self.context.window.projectChosen.emit(file.scans[(at + step) % len(file.scans)])

    def choose_picture(self) -> None:
        window = self.context.window
        name, _ = QFileDialog.getSaveFileName(window, "Save image", "view.png", "PNG (*.png)")
        if name:
            window.save_picture(Path(name), self.context.scene)

    def _start(self) -> Path:
        """The folder of the open file, or else the folder that was used last."""
        path = self.context.document.path
        last = Path(str(self.context.settings.value(_FOLDER, "") or home()))
        return path.absolute().parent if path is not None else last if last.is_dir() else home()
