"""Exports of the graph as R2R connectivity, GraphML, GeoJSON, or an image, and exports of scans, tasks, datasets, and
features as jobs.

A graph that agents cannot use is refused with the finding, unless the user forces the export.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QFileDialog

from app.actions import Action
from app.forms.arguments import Settings
from app.forms.form import CommandForm
from app.jobs.scan_estimate import DATASET, VERB
from app.look.front import bring_up
from app.panels.form import Form
from app.state.graph_files import ForeignGraph
from app.state.graph_reasons import with_editing
from app.state.stages import enabled
from app.wiring.coloring import ColoringPart
from app.wiring.features_form import FEATURES, FeaturesForm
from app.wiring.jobs import OUT, JobsPart
from app.wiring.part import Part, WindowContext
from app.wiring.scan_form import ScanForm
from nvsim.errors import InputError
from nvsim.files.opening import is_folder
from nvsim.files.user_folders import home
from nvsim.graph.offers import Choice
from nvsim.graph.types import NavGraph
from nvsim.project.work import WORK, sentence

TASKS = "export tasks"
KINDS = {
    "r2r": "R2R connectivity and scans.txt, for agents",
    "graphml": "GraphML, for Gephi, yEd, and networkx",
    "geojson": "GeoJSON, for maps",
    "png": "PNG figure of the visible storey, in the current colors, with a legend",
    "svg": "SVG figure of the visible storey, for papers",
    "pdf": "PDF figure of the visible storey, for papers",
}
_INSIST = {False: "refuse and give the reason", True: "export anyway"}


class ExportPart(Part):
    """Exports the graph, and opens the forms of the other exports."""

    ACTIONS = (
        Action("export_graph", "&Export graph…", "Export the graph for agents, other tools, or as an image", "&File",
               1, "Ctrl+E", "export", enabled=with_editing),
        Action("export_scan", f"{WORK[VERB].title}…", f"{WORK[VERB].does[0].upper()}{WORK[VERB].does[1:]}", "&File", 1,
               "Ctrl+Shift+E", enabled=enabled(VERB)),
        Action("export_tasks", f"{WORK[TASKS].title}…", sentence(WORK[TASKS].does)[:-1], "&File", 1,
               enabled=enabled(TASKS)),
        Action("export_dataset", f"{WORK[DATASET].title}…", sentence(WORK[DATASET].does)[:-1], "&File", 1,
               "Ctrl+Shift+D", enabled=enabled(DATASET)),
        Action("export_features", f"{WORK[FEATURES].title}…", sentence(WORK[FEATURES].does)[:-1], "&File", 1,
               enabled=enabled(FEATURES)),
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.form: Form | None = None

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {
            "export_graph": self.show_form,
            "export_scan": self.open_scan_form,
            "export_tasks": self.open_tasks_form,
            "export_dataset": self.open_dataset_form,
            "export_features": self.open_features_form,
        }

    def restore(self, settings: QSettings) -> None:
        self.context.part(JobsPart).formOpened.connect(self._on_form)

    # A scan -----------------------------------------------------------------------------------------------------

    def open_scan_form(self) -> CommandForm | None:
        """Opens the form of the scan export, with an estimate."""
        return self.context.part(JobsPart).open_form(VERB)

    def open_tasks_form(self) -> CommandForm | None:
        """Opens the form of the task export. Its default is the exported scan beside the project, if there is one."""
        project = self.context.document.project
        scans = None if project is None else project.parent / OUT[VERB]
        there = scans is not None and is_folder(scans / "connectivity")
        return self.context.part(JobsPart).open_form(TASKS, {"scans": str(scans)} if there else None)

    def open_dataset_form(self) -> CommandForm | None:
        """Opens the form of the dataset export, with an estimate."""
        return self.context.part(JobsPart).open_form(DATASET)

    def open_features_form(self) -> CommandForm | None:
        """Opens the form of the feature export. Its default is the folder of the exported scan."""
        project = self.context.document.project
        if project is None:
            return None
        scans = Settings(project).changed(VERB).get("out") or project.parent / OUT[VERB]
        return self.context.part(JobsPart).open_form(FEATURES, {"folder": str(scans)})

    def _on_form(self, form: CommandForm) -> None:
        if self.context.document.project is None:
            return
        if form.verb in (VERB, DATASET):
            ScanForm(form, self.context)
        elif form.verb == FEATURES:
            FeaturesForm(form, self.context)

    # The graph --------------------------------------------------------------------------------------------------

    def show_form(self) -> None:
        if self.form is not None:
            self.form.destroyed.disconnect(self._forget)  # it is deleted later, and must not clear the next form
            self.form.close()
        self.form = Form(
            "export_graph",
            "Export graph",
            "Exports the current graph, including unsaved edits.",
            (
                Choice("kind", "Format", KINDS),
                Choice("force", "If agents cannot use it", _INSIST, "For R2R connectivity"),
            ),
            self._choose_place,
            self.context.settings,
            self.context.window,
            "Export to…",
        )
        self.form.destroyed.connect(self._forget)
        bring_up(self.form)

    def _forget(self) -> None:
        self.form = None

    def _choose_place(self, values: dict[str, Any]) -> None:
        document, window = self.context.document, self.context.window
        if document.graph is None:
            return
        start = (document.path or home()).parent
        if values["kind"] == "r2r":
            name = QFileDialog.getExistingDirectory(window, "Folder for the connectivity file", str(start))
        else:
            suffix = values["kind"]
            suggestion = str(start / f"{document.graph.scan}.{suffix}")
            name, _ = QFileDialog.getSaveFileName(window, "Export graph", suggestion, f"{suffix} (*.{suffix})")
        if name:
            self.export(values["kind"], Path(name), force=bool(values["force"]))

    def export(self, kind: str, path: Path, *, force: bool = False) -> bool:
        """Writes the graph. An error or a refusal becomes a notice. Returns whether the graph was written."""
        graph = self.context.document.graph
        if graph is None:
            return False
        try:
            written = self._write(kind, graph, path, force)
        except InputError as error:
            self.context.notices.error(str(error), about="export")
            return False
        self.context.notices.info(f"Wrote {written}.", about="export")
        return True

    def _shown(self, graph: NavGraph) -> NavGraph:
        """The part of the graph on the visible storey."""
        index = self.context.document.shown_arrays.index
        if len(index) == len(graph.viewpoints):
            return graph
        viewpoints = {id: v for id, v in graph.viewpoints.items() if id in index}
        edges = {key: edge for key, edge in graph.edges.items() if key[0] in index and key[1] in index}
        return NavGraph(graph.scan, viewpoints, edges)

    def _write(self, kind: str, graph: NavGraph, path: Path, force: bool) -> Path:
        from app.wiring.figure import figure
        from nvsim.figures import save_figure
        from nvsim.graph import exports

        if kind == "r2r":
            return self._write_r2r(graph, path, force)
        if kind == "graphml":
            return exports.write_graphml(graph, path)
        if kind == "geojson":
            return exports.write_geojson(graph, path)
        coloring = self.context.part(ColoringPart).coloring
        return save_figure(figure(self._shown(graph), self.context.document.contents.occupancy, coloring), path, kind)

    def _write_r2r(self, graph: NavGraph, folder: Path, force: bool) -> Path:
        from nvsim.graph import exports
        from nvsim.graph.connectivity import write_connectivity
        from nvsim.graph.findings import Context
        from nvsim.graph.sight import lines_of_sight

        document = self.context.document
        file, occupancy = document.editing.file, document.contents.occupancy
        if not force:
            exports.refuse(graph, None if file is None else file.context(Context()))
        if isinstance(file, ForeignGraph):  # keeps its poses and lists
            return file.export(graph, folder)
        return write_connectivity(graph, folder, lines_of_sight(graph, occupancy))
