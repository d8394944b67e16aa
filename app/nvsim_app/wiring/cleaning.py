"""The command that cleans a splat: its mode in the 3D view, its panel, and the change of the project."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QSettings, QTimer

from nvsim.project.work import STAGES, WORK, StageName
from nvsim_app.actions import Action
from nvsim_app.drawing.render_child import RenderSource, WholeSplatSource
from nvsim_app.modes.clean import CleanMode
from nvsim_app.panels.cleaning import SEARCHING, CleanPanel
from nvsim_app.processes.background import BackgroundWork
from nvsim_app.processes.serving import EndMessage
from nvsim_app.processes.side_process import SideProcess
from nvsim_app.state.cleaning import SplatCleaning
from nvsim_app.state.document import Document
from nvsim_app.state.reasons import Reason, with_project_folder, with_scene
from nvsim_app.state.side_work import CLEANING
from nvsim_app.wiring.part import Dock, Part, WindowContext

CHANGED = "The splat has changed, so its cleaning ended without changes. Start it again."
"""The notice if another program, or a job, changed the Gaussians."""


def with_splat_project(document: Document) -> Reason:
    """None if the project was imported from splat files, otherwise the reason."""
    images = "only the Gaussians of a project that was imported from splat files can be removed"
    return with_project_folder(document) or (images if document.contents.has_images else with_scene(document))


class CleanPart(Part):
    """Runs the mode that cleans a splat."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.panel = CleanPanel()
        self.mode = CleanMode(context.modes.context, self._begin, self._end)
        self.mode.on_shape = lambda: self.panel.show_shape(self.mode.lasso)
        context.modes.modes[self.mode.name] = self.mode
        context.modes.listen(self.panel)
        self.process = SideProcess(CLEANING, self)
        self.process.ended.connect(self._on_found)
        self._writing = BackgroundWork("cleaning", self)
        self._source: WholeSplatSource | None = None
        self._before: RenderSource | None = None
        self._was_closed = False  # whether the panel was closed before
        self.panel.lassoChosen.connect(self.mode.set_lasso)
        self.panel.reachChosen.connect(self.mode.set_reach)
        self.panel.hideChosen.connect(self._show_marks)
        self.panel.applyWanted.connect(self.apply)
        self.panel.cancelWanted.connect(self.leave)
        context.document.projectLeft.connect(self.leave)
        context.document.contentsChanged.connect(self._on_contents)

    def docks(self) -> tuple[Dock, ...]:
        return (Dock("clean", "Clean splat", self.panel, "right", tab="details", needs=with_splat_project),)

    def store(self, settings: QSettings) -> None:
        self.mode.stop()
        self.process.close()
        self._writing.stop()

    def leave(self) -> None:
        """Leaves the mode without changes."""
        if self.context.modes.current is self.mode:
            self.context.modes.choose("select")

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "scene_stamp" not in parts or self.context.modes.current is not self.mode:
            return
        if self.mode.cleaning is None:  # nothing is marked yet
            QTimer.singleShot(0, self, self._begin_again)  # after the view has changed to the new models
            return
        self.context.notices.info(CHANGED, about="clean")
        self.leave()

    def _begin_again(self) -> None:
        project, feed = self.context.document.project, self.context.scene.feed
        if project is not None and self.context.modes.current is self.mode and self.mode.cleaning is None:
            if feed.source is not self._source:
                self._before = feed.source
            self._open(project)

    # Beginning and ending --------------------------------------------------------------------------------------

    def _begin(self) -> None:
        document, window, feed = self.context.document, self.context.window, self.context.scene.feed
        project = document.project
        if project is None:
            return
        self._was_closed = window.docks["clean"].isHidden()
        window.show_dock("clean")
        window.show_page(None)
        self.context.scene.setFocus()
        self.panel.show_cleaning(None, SEARCHING)
        self._before = feed.source
        self._open(project)

    def _open(self, project: Path) -> None:
        self._source = WholeSplatSource(project)
        self.context.scene.feed.show(self._source)
        self.process.open(project)

    def _end(self) -> None:
        feed = self.context.scene.feed
        self.process.close()
        self._writing.drop()
        self.panel.show_cleaning(None)
        feed.marks = None
        if feed.source is not None and feed.source is self._source:
            feed.show(self._before)
        self._source = self._before = None
        if self._was_closed:
            self.context.window.docks["clean"].hide()

    def _on_found(self, end: EndMessage) -> None:
        if end.sentence:
            self.context.notices.add("error", end.sentence, end.trace)
            self.leave()
            return
        cleaning = SplatCleaning(end.value)
        cleaning.changed.connect(self._show_marks)
        self.mode.cleaning = cleaning
        self.panel.show_cleaning(cleaning)
        self._show_marks()

    def _show_marks(self) -> None:
        cleaning, feed = self.mode.cleaning, self.context.scene.feed
        if cleaning is not None:
            feed.marks = cleaning.marks(self.panel.hide_box.isChecked())
            feed.request_sharp_image()

    # Applying --------------------------------------------------------------------------------------------------

    def apply(self) -> None:
        """Stores which Gaussians are removed, in a thread; then leaves the mode."""
        cleaning, project = self.mode.cleaning, self.context.document.project
        if cleaning is None or project is None or self._writing.busy:
            return
        rows, removed = cleaning.found.rows, cleaning.removed
        self._writing.start(
            lambda: _write(project, rows, removed),
            lambda outdated: self._on_written(int(removed.sum()), outdated),
            self._on_failed,
        )

    def _on_written(self, count: int, outdated: frozenset[StageName]) -> None:
        titles = " and ".join(f"“{WORK[stage].title}”" for stage in STAGES if stage in outdated)
        again = f" Run {titles} again, so that the results fit these Gaussians." if titles else ""
        self.context.notices.info(f"{count:,} Gaussians are removed.{again}", about="clean")
        self.leave()

    def _on_failed(self, sentence: str) -> None:
        self.context.notices.error(sentence, about="clean")

    ACTIONS = (
        Action("&Edit", 9, "mode_clean", "&Clean splat…",
               "Show floaters and Gaussians outside the building, and choose which Gaussians to remove",
               lambda self: self.context.modes.choose("clean"), enabled=with_splat_project, check="off", group="mode"),
    )  # fmt: skip


def _write(path: Path, rows: dict[int, NDArray[np.int64]], removed: NDArray[np.bool_]) -> frozenset[StageName]:
    """Stores which Gaussians are removed. Returns the stages that are outdated afterwards."""
    from nvsim.project.cleaning import remove_gaussians
    from nvsim.project.outdated import outdated_stages
    from nvsim.project.project import Project

    with Project.open(path, writable=True) as project:
        remove_gaussians(project, rows, removed)
        return outdated_stages(project)
