"""Imports the capture again with another setting: a scale from a known length, without one frame, or another piece of
a video."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

from PySide6.QtCore import QSettings

from nvsim.project.config import CaptureConfig
from nvsim.project.project import Project
from nvsim.project.stages.imported import capture_config
from nvsim.reconstruction.report import folder_of_report
from nvsim_app.actions import Action
from nvsim_app.jobs.queue import JobHandle
from nvsim_app.modes.measure import MeasureMode
from nvsim_app.panels.details import DetailsPanel
from nvsim_app.panels.form import KnownLength, outdated_results_text
from nvsim_app.state.document import Document
from nvsim_app.state.reasons import Reason, with_frame, with_project_folder, with_trajectory
from nvsim_app.wiring.jobs import JobsPart
from nvsim_app.wiring.part import Part, WindowContext


def with_own_frames(document: Document) -> Reason:
    return with_project_folder(document) or with_trajectory(document)


class ReimportPart(Part):
    """Commands that import the capture again."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        mode = context.modes.modes["measure"]
        assert isinstance(mode, MeasureMode)
        self.mode = mode
        self.mode.on_confirm = self.ask

    def restore(self, settings: QSettings) -> None:
        details = self.context.window.panels["details"]
        assert isinstance(details, DetailsPanel)
        details.pieceWanted.connect(self.use_piece)

    def ask(self) -> KnownLength | None:
        """Asks for the true length of the measured line. Without a measured line, starts measuring."""
        document, window = self.context.document, self.context.window
        if (reason := with_own_frames(document)) is not None:
            self.context.notices.warning(f"The scale cannot be set: {reason}.")
            return None
        if self.mode.meters <= 0:
            self.context.modes.choose("measure")
            window.statusBar().showMessage("Click two points whose distance you know, then press Enter")
            return None
        dialog = KnownLength(self.mode.meters, document.contents.stages, window)
        dialog.chosen.connect(self.set_scale)
        dialog.finished.connect(dialog.deleteLater)
        dialog.open()
        return dialog

    def set_scale(self, factor: float) -> JobHandle | None:
        """Queues an import of this capture in which all lengths are multiplied by `factor`."""
        document = self.context.document
        project, capture = document.project, document.contents.capture
        if project is None or capture is None:
            return None
        with self.context.notices.reporting():
            with Project.open(project) as opened:
                config = capture_config(opened)
            height = None if config.camera_height is None else config.camera_height * factor
            # If a model was selected, the source of the capture is the folder of that model.
            config = replace(config, scale=capture.alignment.scale * factor, camera_height=height, model="")
            handle = self._import(project, [str(capture.source), *options_of(config)], "Import with another scale")
            self.mode.cancel()
            return handle
        return None

    def leave_out(self) -> JobHandle | None:
        """Queues an import of this capture without the selected frame."""
        document = self.context.document
        project, capture, row = document.project, document.contents.capture, document.frame_at_hand
        if project is None or capture is None or row is None:
            return None
        name = capture.frames[row].name
        with self.context.notices.reporting():
            config = _config_of(project)
            names = f"{config.leave_out},{name}" if config.leave_out else name
            options = options_of(replace(config, leave_out=names, model=""))
            handle = self._import(project, [str(capture.source), *options], f"Import without {name}")
            self.context.notices.info(f"{name} is left out. {outdated_results_text(document.contents.stages)}")
            return handle
        return None

    def use_piece(self, number: int) -> JobHandle | None:
        """Queues an import of another piece of the video. Each piece has its own unit, so only a camera height is
        kept."""
        document = self.context.document
        project, report = document.project, document.contents.poses
        if project is None or report is None:
            return None
        with self.context.notices.reporting():
            capture, source = document.contents.capture, report.source
            if capture is not None:
                source = str(folder_of_report(capture.source) or source)
                config = replace(_config_of(project), scale=None, leave_out="", model=str(number))
                if any(config.camera_height == measured.scale for measured in report.measured):
                    config = replace(config, camera_height=None)  # it was measured, and is measured for each piece
                options = options_of(config)
            else:
                options = [*self._options_ordered(), "--model", str(number)]
            handle = self._import(project, [source, *options], f"Import piece {number}")
            self.context.notices.info(f"Piece {number} is imported. {outdated_results_text(document.contents.stages)}")
            return handle
        return None

    def _options_ordered(self) -> list[str]:
        """The options of the last ordered import, whose capture was refused."""
        imports = [h.job.order for h in self.context.jobs.handles if h.job.order.verb == "import" and h.is_own]
        ordered = [order for order in imports if not order.folder]  # of the window
        return without_option(ordered[-1].arguments[3:], "--model") if ordered else []

    def _import(self, project: Path, words: list[str], title: str) -> JobHandle:
        """Queues `nvsim import` of a source with options. Raises InputError if the job cannot start."""
        source, *options = words
        handle = self.context.jobs.start("import", [source, "--project", str(project), *options], project, title)
        self.context.part(JobsPart).show_panel()
        return handle

    ACTIONS = (
        Action("&Graph", 0, "set_scale", "Set the s&cale by a known length…",
               "Click two points and enter their true distance; the capture is imported again with that scale", ask,
               enabled=with_own_frames),
        Action("F&rame", 4, "leave_out_frame", "&Leave out this frame",
               "Import the capture again without the selected frame", leave_out,
               enabled=lambda document: with_own_frames(document) or with_frame(document)),
    )  # fmt: skip


def without_option(words: Sequence[str], flag: str) -> list[str]:
    """The words of a command line without an option and its value, written as `--flag VALUE` or `--flag=VALUE`."""
    found, is_value = [], False
    for word in words:
        if not is_value and word != flag and not word.startswith(f"{flag}="):
            found.append(word)
        is_value = word == flag
    return found


def _config_of(project: Path) -> CaptureConfig:
    """The settings of the capture's import, without a camera height that was only assumed. Otherwise another import
    would take it for a height that the user knows. Raises InputError if the project is damaged."""
    with Project.open(project) as opened:
        config, capture = capture_config(opened), opened.capture()
    assumed = capture is not None and not capture.alignment.scale_known
    return replace(config, camera_height=None) if assumed else config


def options_of(config: CaptureConfig) -> list[str]:
    """The flags of `nvsim import` that result in `config`."""
    flags = []
    for field in fields(config):
        value = getattr(config, field.name)
        if value != field.default:
            flags += [f"--{field.name.replace('_', '-')}", str(value)]
    return flags
