"""New projects, and paths that are dropped on the window or selected to be opened."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QEvent, QMimeData, QObject, QSettings
from PySide6.QtGui import QDragEnterEvent, QDropEvent
from PySide6.QtWidgets import QFileDialog

from nvsim.capture import formats
from nvsim.capture.excluded_frames import FROM_FILE, write_names
from nvsim.capture.multi_capture import SUFFIX, write_list
from nvsim.errors import InputError
from nvsim.files.user_folders import home_folder
from nvsim.project.path_kind import GRAPHS, path_kind, sentence_about
from nvsim.project.work import STAGE
from nvsim_app.actions import Action
from nvsim_app.look.plain_text import plain
from nvsim_app.look.widgets import DropTarget
from nvsim_app.panels.new_project import NewProject, NewProjectDialog
from nvsim_app.state.document import Document
from nvsim_app.state.reasons import Reason
from nvsim_app.wiring.jobs import JobsPart
from nvsim_app.wiring.part import Part

LEFT_OUT = "left_out.txt"
"""The file of a project with the names of the frames that were not imported."""


def without_capture(document: Document) -> Reason:
    if document.project is None:
        return "no project is open"
    return None if document.contents.capture is None else "the project already has a capture; create a new project"


def with_own_capture(document: Document) -> Reason:
    if document.project is None:
        return "no project is open"
    return None if document.contents.capture is not None else f"{STAGE['import'].missing}; import one first"


class NewProjectPart(Part):
    """Creates projects from captures, videos, or the built-in building, and adds captures."""

    def restore(self, settings: QSettings) -> None:
        window = self.context.window
        self.target = DropTarget(window)
        window.setAcceptDrops(True)
        window.installEventFilter(self)
        window.empty.importWanted.connect(lambda: self.open_dialog(project=self.context.document.project))
        window.start.newWanted.connect(lambda: self.open_dialog())
        window.start.demoWanted.connect(self.choose_demo)

    # Making -----------------------------------------------------------------------------------------------------

    def open_dialog(self, captures: Sequence[Path] = (), project: Path | None = None) -> NewProjectDialog:
        """Opens the dialog for one or several captures. On confirmation, creates and opens the project, and queues the
        import."""
        dialog = NewProjectDialog(captures, project, self.context.window)
        dialog.chosen.connect(self._make)
        dialog.open()
        return dialog

    def open_addition(self) -> NewProjectDialog | None:
        """Opens the dialog that adds a capture to the project. None if the project has no capture, or on an error."""
        from nvsim.project.project import Project
        from nvsim.project.stages.added_captures import sources
        from nvsim.project.stages.imported import capture_config

        document = self.context.document
        project, capture = document.project, document.contents.capture
        if project is None or capture is None:
            return None
        with self.context.notices.reporting():
            held = sources(capture)
            with Project.open(project) as opened:
                understood = capture_config(opened)
            dialog = NewProjectDialog((), project, self.context.window, beside=held, understood=understood)
            dialog.chosen.connect(self._add)
            dialog.open()
            return dialog
        return None

    def _add(self, new: NewProject) -> None:
        skipped = self._leaving_out(new)
        if skipped is None:
            return
        for capture in new.captures:
            arguments = [str(capture), "--add", "--project", str(new.project), *skipped]
            self.context.jobs.start("import", arguments, new.project, f"Add {capture.name}")
        if new.everything:
            self.context.part(JobsPart).run_everything()

    def _make(self, new: NewProject) -> None:
        if self._open_new(new.project):
            source = new.captures[0]
            if len(new.captures) > 1:
                source = new.project / f"together{SUFFIX}"
                try:
                    write_list(new.captures, source)
                except InputError as error:
                    self.context.notices.error(str(error))
                    return
            skipped = self._leaving_out(new)
            if skipped is None:
                return
            names = " and ".join(c.name for c in new.captures)
            arguments = [str(source), "--project", str(new.project), *new.options, *skipped]
            self.context.jobs.start("import", arguments, new.project, f"Import {names}")
            if new.everything:
                self.context.part(JobsPart).run_everything()

    def _leaving_out(self, new: NewProject) -> list[str] | None:
        """The flags for the frames that are left out. Their names are stored in the project, because the job may be
        resumed later. If they cannot be stored, shows a notice and returns None."""
        if not new.left_out:
            return []
        path = new.project / LEFT_OUT
        with self.context.notices.reporting():
            write_names(new.left_out, path)
            return ["--leave-out", f"{FROM_FILE}{path}"]
        return None

    def choose_demo(self) -> None:
        """Asks for the path of the demo project, and creates it."""
        start = str(home_folder() / "demo.nvsim")
        chosen, _ = QFileDialog.getSaveFileName(self.context.window, "Demo project", start, "Projects (*.nvsim)")
        if chosen:
            path = Path(chosen if chosen.endswith(".nvsim") else f"{chosen}.nvsim")
            if self._open_new(path):
                arguments = ["--project", str(path), "--no-window"]
                self.context.jobs.start("demo", arguments, path, "The built-in building")

    def _open_new(self, path: Path) -> bool:
        """Creates the empty project and opens it. An error becomes a notice."""
        from nvsim.project.project import Project

        with self.context.notices.reporting():
            Project.create_or_open(path).close()
            if self.context.document.project != path:
                self.context.window.projectChosen.emit(path)
            return self.context.document.project == path
        return False

    # Dropping ---------------------------------------------------------------------------------------------------

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if isinstance(event, QDragEnterEvent) and _dropped(event.mimeData()):
            event.acceptProposedAction()
            self._mark_target(_dropped(event.mimeData()))
            return True
        if event.type() in (QEvent.Type.DragLeave, QEvent.Type.Drop):
            self._mark_target(())
        if isinstance(event, QDropEvent) and event.type() == QEvent.Type.Drop:
            paths = _dropped(event.mimeData())
            if paths:
                event.acceptProposedAction()
                self.open_paths(paths)
                return True
        return super().eventFilter(watched, event)

    def _mark_target(self, paths: Sequence[Path]) -> None:
        """Highlights where `paths` can be dropped; without paths, removes the highlight."""
        self.context.window.start.drop.highlight(bool(paths))
        more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
        self.target.show_words(f"Drop {plain(paths[0].name)}{more} to open or import it" if paths else "")

    def open_paths(self, paths: Sequence[Path]) -> None:
        """Opens dropped or selected paths: a project, a graph, a splat file, or else captures."""
        path, kind = paths[0], path_kind(paths[0])
        if kind in ("project", "splats", *GRAPHS):
            self.context.window.projectChosen.emit(path)
        elif kind in ("occupancy map", "nothing", "unreadable"):
            self.context.notices.error(sentence_about(path, kind))
        else:
            self.open_dialog(paths)

    ACTIONS = (
        Action("&File", -1, "new_project", "&New project from a capture or video…",
               f"Check a capture or a video and create a project from it: {formats.names()}, or MP4, MOV, MKV, WebM",
               open_dialog, "Ctrl+N", icon="new", toolbar=True),
        Action("&File", -1, "new_demo", "New project from the &built-in building…",
               "Generate a building with ground truth and run all stages on it", choose_demo),
        Action("&File", -1, "import", "&Import a capture…", "Import a capture into the open project",
               lambda self: self.open_dialog(project=self.context.document.project), enabled=without_capture),
        Action("&File", -1, "add_capture", "A&dd a capture…",
               "Import another capture of the same building into the open project", open_addition,
               enabled=with_own_capture),
    )  # fmt: skip


def _dropped(data: QMimeData) -> list[Path]:
    return [Path(url.toLocalFile()) for url in data.urls() if url.isLocalFile()]
