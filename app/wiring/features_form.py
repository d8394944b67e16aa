"""The form of a feature export, with a panel that lists the layouts and the networks that compute them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject

from app.forms.form import CommandForm
from app.panels.feature_makers import FeatureMakersPanel
from app.wiring.part import WindowContext
from nvsim.cli.arguments import parse
from nvsim.cli.options import command_of
from nvsim.r2r.features.layouts import LAYOUTS, lacking

FEATURES = "export features"


class FeaturesForm(QObject):
    """Adds the panel to `form`, and exists as long as the form."""

    def __init__(self, form: CommandForm, context: WindowContext) -> None:
        super().__init__(form)
        self._form, self._context = form, context
        self.panel = FeatureMakersPanel(form)
        form.stand_beside(self.panel)
        form.resize(form.width() + 120, form.height())  # its options have long help texts
        form.tried.connect(self._on_tried)

    def _on_tried(self, arguments: Sequence[str]) -> None:
        project = self._context.document.project
        if project is None:
            return
        a = parse(command_of(FEATURES), ["--project", str(project), *arguments], FEATURES)
        self.panel.show_makers(a.layout, a.model, a.projection)
        sentence = next((said for said in (lacking(LAYOUTS[name]) for name in a.layout) if said), "")
        self._form.hold(sentence or self._without_scan(a.folder or project.absolute().parent / "scans"))

    def _without_scan(self, folder: Path) -> str:
        """The reason to disable the form if there is no exported scan; "" if there is one, or if a job may write it."""
        if any(h.state in ("running", "queued") for h in self._context.jobs.handles):
            return ""
        if any((place / "scans.txt").is_file() for place in (folder / "connectivity", folder)):
            return ""
        return f"{folder} has no exported scan; export the scan first, or select another folder."
