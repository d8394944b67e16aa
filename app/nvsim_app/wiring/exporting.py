"""Exports of the graph as R2R connectivity, GraphML, GeoJSON, or an image, and exports of scans, tasks, datasets, and
features as jobs.

A graph that agents cannot use is refused with the finding, unless the user forces the export.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QObject, QSettings
from PySide6.QtWidgets import QFileDialog
from shiboken6 import isValid

from nvsim.cli.arguments import parse
from nvsim.cli.options import command_of
from nvsim.figures import DASHES, SHAPES
from nvsim.files.opening import is_folder
from nvsim.files.user_folders import home_folder
from nvsim.graph.exports import ColorGroups, LegendRow, draw
from nvsim.graph.offers import ChoiceField
from nvsim.graph.types import NavGraph
from nvsim.occupancy.types import OccupancyMap
from nvsim.plain_text import count_text
from nvsim.project.work import WORK, sentence
from nvsim.r2r.features.layouts import LAYOUTS, missing_package_error
from nvsim_app.actions import Action
from nvsim_app.forms.fields import Settings
from nvsim_app.forms.form import CommandForm
from nvsim_app.look import lengths
from nvsim_app.look.widgets import show_and_focus
from nvsim_app.panels.form import Form
from nvsim_app.panels.scan_estimate import DATASET, VERB, FeatureMakersPanel, ScanEstimatePanel
from nvsim_app.state.graph_coloring import Coloring
from nvsim_app.state.graph_files import ForeignGraph
from nvsim_app.state.reasons import reason_of_command, with_editing
from nvsim_app.wiring.display import ColoringPart
from nvsim_app.wiring.jobs import OUT, JobsPart
from nvsim_app.wiring.part import Part, WindowContext

if TYPE_CHECKING:
    from matplotlib.figure import Figure


TASKS = "export tasks"
FEATURES = "export features"
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

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.form: Form | None = None

    def restore(self, settings: QSettings) -> None:
        self.context.part(JobsPart).formOpened.connect(self._on_form)

    # A scan -----------------------------------------------------------------------------------------------------

    def open_tasks_form(self) -> CommandForm | None:
        """Opens the form of the task export. Its default is the exported scan beside the project, if there is one."""
        project = self.context.document.project
        scans = None if project is None else project.parent / OUT[VERB]
        there = scans is not None and is_folder(scans / "connectivity")
        return self.context.part(JobsPart).open_form(TASKS, {"scans": str(scans)} if there else None)

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
        if self.form is not None and isValid(self.form):
            self.form.close()
        self.form = Form(
            "export_graph",
            "Export graph",
            "Exports the current graph, including unsaved edits.",
            (
                ChoiceField("kind", "Format", KINDS),
                ChoiceField("force", "If agents cannot use it", _INSIST, "For R2R connectivity"),
            ),
            self._choose_place,
            self.context.settings,
            self.context.window,
            "Export to…",
        )
        show_and_focus(self.form)

    def _choose_place(self, values: dict[str, Any]) -> None:
        document, window = self.context.document, self.context.window
        if document.graph is None:
            return
        start = (document.path or home_folder()).parent
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
        with self.context.notices.reporting(about="export"):
            written = self._write(kind, graph, path, force)
            self.context.notices.info(f"Wrote {written}.", about="export")
            return True
        return False

    def _visible_graph(self, graph: NavGraph) -> NavGraph:
        """The part of the graph on the visible storey."""
        index = self.context.document.shown_arrays.index
        if len(index) == len(graph.viewpoints):
            return graph
        viewpoints = {id: v for id, v in graph.viewpoints.items() if id in index}
        edges = {key: edge for key, edge in graph.edges.items() if key[0] in index and key[1] in index}
        return NavGraph(graph.scan, viewpoints, edges)

    def _write(self, kind: str, graph: NavGraph, path: Path, force: bool) -> Path:
        from nvsim.figures import save_figure
        from nvsim.graph import exports

        if kind == "r2r":
            return self._write_r2r(graph, path, force)
        if kind == "graphml":
            return exports.write_graphml(graph, path)
        if kind == "geojson":
            return exports.write_geojson(graph, path)
        coloring = self.context.part(ColoringPart).coloring
        return save_figure(
            draw_figure(self._visible_graph(graph), self.context.document.contents.occupancy, coloring), path, kind
        )

    def _write_r2r(self, graph: NavGraph, folder: Path, force: bool) -> Path:
        from nvsim.graph import exports
        from nvsim.graph.connectivity import write_connectivity
        from nvsim.graph.findings import Context
        from nvsim.graph.sight import lines_of_sight

        document = self.context.document
        file, occupancy = document.editing.file, document.contents.occupancy
        if not force:
            exports.check_exportable(graph, None if file is None else file.context(Context()))
        if isinstance(file, ForeignGraph):  # keeps its poses and lists
            return file.export(graph, folder)
        return write_connectivity(graph, folder, lines_of_sight(graph, occupancy))

    ACTIONS = (
        Action("&File", 1, "export_graph", "&Export graph…", "Export the graph for agents, other tools, or as an image",
               show_form, "Ctrl+E", with_editing, icon="export"),
        Action("&File", 1, "export_scan", f"{WORK[VERB].title}…", sentence(WORK[VERB].summary)[:-1],
               lambda self: self.context.part(JobsPart).open_form(VERB),
               "Ctrl+Shift+E", reason_of_command(VERB)),
        Action("&File", 1, "export_tasks", f"{WORK[TASKS].title}…", sentence(WORK[TASKS].summary)[:-1], open_tasks_form,
               enabled=reason_of_command(TASKS)),
        Action("&File", 1, "export_dataset", f"{WORK[DATASET].title}…", sentence(WORK[DATASET].summary)[:-1],
               lambda self: self.context.part(JobsPart).open_form(DATASET), "Ctrl+Shift+D", reason_of_command(DATASET)),
        Action("&File", 1, "export_features", f"{WORK[FEATURES].title}…", sentence(WORK[FEATURES].summary)[:-1],
               open_features_form, enabled=reason_of_command(FEATURES)),
    )  # fmt: skip


_READ = frozenset({"graph", "submaps", "scene_stamp"})
"""Parts of the document that change the estimate."""


class ScanForm(QObject):
    """Adds the estimate to `form`, and exists as long as the form."""

    def __init__(self, form: CommandForm, context: WindowContext) -> None:
        super().__init__(form)
        self._form, self._context = form, context
        document = context.document
        assert document.project is not None  # the form exists only with a project
        self.panel = ScanEstimatePanel(document.project, form.verb, form)
        form.show_beside(self.panel)
        form.tried.connect(self.panel.show_arguments)
        form.finished.connect(self.panel.question.stop)
        self.panel.refused.connect(self._on_refused)
        self.panel.saveWanted.connect(document.editing.save)
        self.panel.findingsWanted.connect(self._show_findings)
        document.editing.stepsChanged.connect(self._show_unsaved)
        document.contentsChanged.connect(self._on_contents)
        self._unsaved = False
        self._show_unsaved()

    def _show_unsaved(self) -> None:
        editing = self._context.document.editing
        before, self._unsaved = self._unsaved, editing.dirty
        words = ""
        if editing.history is not None and self._unsaved:
            count = editing.history.edits_since_saved()
            are = "is" if count == 1 else "are"
            words = f"{count_text(count, 'edit')} of the graph {are} not saved; the scan is made from the saved graph."
        self.panel.show_unsaved(words, editing.writable)
        if before and not self._unsaved:
            self.panel.ask_again()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if parts & _READ:
            self.panel.ask_again()

    def _on_refused(self, sentence: str) -> None:
        """Disables the form with the refusal, unless a running or queued job may resolve it."""
        waits = bool(sentence) and any(h.state in ("running", "queued") for h in self._context.jobs.handles)
        if waits:
            self.panel.title.setText("Not possible yet; the running jobs may change that.")
        self._form.block_start("" if waits else sentence)
        self.panel.findings.setVisible("--force" in sentence)

    def _show_findings(self) -> None:
        self._form.reject()
        self._context.window.show_dock("validation")


class FeaturesForm(QObject):
    """Adds the panel to `form`, and exists as long as the form."""

    def __init__(self, form: CommandForm, context: WindowContext) -> None:
        super().__init__(form)
        self._form, self._context = form, context
        self.panel = FeatureMakersPanel(form)
        form.show_beside(self.panel)
        form.resize(form.width() + 120, form.height())  # its options have long help texts
        form.tried.connect(self._on_tried)

    def _on_tried(self, arguments: Sequence[str]) -> None:
        project = self._context.document.project
        if project is None:
            return
        a = parse(command_of(FEATURES), ["--project", str(project), *arguments], FEATURES)
        self.panel.show_makers(a.layout, a.model, a.projection)
        sentence = next((said for said in (missing_package_error(LAYOUTS[name]) for name in a.layout) if said), "")
        self._form.block_start(sentence or self._without_scan(a.folder or project.absolute().parent / "scans"))

    def _without_scan(self, folder: Path) -> str:
        """The reason to disable the form if there is no exported scan; "" if there is one, or if a job may write it."""
        if any(h.state in ("running", "queued") for h in self._context.jobs.handles):
            return ""
        if any((place / "scans.txt").is_file() for place in (folder / "connectivity", folder)):
            return ""
        return f"{folder} has no exported scan; export the scan first, or select another folder."


def draw_figure(graph: NavGraph, occupancy: OccupancyMap | None, coloring: Coloring | None) -> Figure:
    """Draws `graph` as the window shows it. Without a coloring, the colors show the origin of the edges. Raises
    InputError if there is nothing to draw."""
    unit = lengths.unit()
    return draw(graph, occupancy, groups=_groups(coloring), unit=(unit.symbol, unit.meters))


def _groups(coloring: Coloring | None) -> ColorGroups | None:
    """The groups of a coloring that have items, with their numbers."""
    if coloring is None:
        return None
    counts = coloring.counts.tolist()
    used = [i for i, count in enumerate(counts) if count]
    row = {number: i for i, number in enumerate(used)}
    keys = []
    for number in used:
        group = coloring.groups[number]
        shape = SHAPES[group.mark % len(SHAPES)] if number in coloring.viewpoints.values() else ""
        dash = group.mark % len(DASHES) if number in coloring.edges.values() else -1
        keys.append(LegendRow(f"{group.words} ({counts[number]:,})", group.color, shape, dash))
    return ColorGroups(
        coloring.title,
        tuple(keys),
        {id: row[n] for id, n in coloring.viewpoints.items() if n in row},
        {key: row[n] for key, n in coloring.edges.items() if n in row},
    )
