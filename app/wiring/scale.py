"""The scale of the project from a length that the user measures in a view and knows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace

from app.actions import Action
from app.jobs.queue import JobHandle
from app.modes.measure import MeasureMode
from app.panels.known_length import KnownLength
from app.state.document import Document
from app.state.reasons import Reason, with_project_folder, with_trajectory
from app.wiring.jobs import JobsPart
from app.wiring.part import Part, Workspace
from nvsim.errors import InputError
from nvsim.project.config import CaptureConfig
from nvsim.project.project import Project
from nvsim.project.stages.imported import capture_config


def with_own_frames(document: Document) -> Reason:
    return with_project_folder(document) or with_trajectory(document)


class ScalePart(Part):
    ACTIONS = (
        Action(
            "set_scale",
            "Set the s&cale by a known length…",
            "Click two places, then give their true distance; the capture is imported again with that scale",
            "&Graph",
            0,
            enabled=with_own_frames,
        ),
    )

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        mode = workspace.modes.modes["measure"]
        assert isinstance(mode, MeasureMode)
        self.mode = mode
        self.mode.settle = self.ask

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"set_scale": self.ask}

    def ask(self) -> KnownLength | None:
        """Asks for the true length of the measured way; without one, measuring begins."""
        document, window = self.workspace.document, self.workspace.window
        if (reason := with_own_frames(document)) is not None:
            self.workspace.notices.warning(f"The scale cannot be set: {reason}.")
            return None
        if self.mode.metres <= 0:
            self.workspace.modes.choose("measure")
            window.statusBar().showMessage("Click two places whose distance you know, then press Enter")
            return None
        dialog = KnownLength(self.mode.metres, document.contents.stages, window)
        dialog.chosen.connect(self.set_scale)
        dialog.finished.connect(dialog.deleteLater)
        dialog.open()
        return dialog

    def set_scale(self, factor: float) -> JobHandle | None:
        """Queues an import of the same capture in which everything is `factor` times as long."""
        document = self.workspace.document
        project, capture = document.project, document.contents.capture
        if project is None or capture is None:
            return None
        try:
            with Project.open(project) as opened:
                config = capture_config(opened)
            height = None if config.camera_height is None else config.camera_height * factor
            # The source of a capture of a chosen model is the folder of that model.
            config = replace(config, scale=capture.alignment.scale * factor, camera_height=height, model="")
            arguments = [str(capture.source), "--project", str(project), *options_of(config)]
            handle = self.workspace.jobs.start("import", arguments, project, "Import with another scale")
        except InputError as error:
            self.workspace.notices.error(str(error))
            return None
        self.mode.cancel()
        self.workspace.part(JobsPart).show_panel()
        return handle


def options_of(config: CaptureConfig) -> list[str]:
    """The flags of `nvsim import` that give `config`."""
    flags = []
    for field in fields(config):
        value = getattr(config, field.name)
        if value != field.default:
            flags += [f"--{field.name.replace('_', '-')}", str(value)]
    return flags
