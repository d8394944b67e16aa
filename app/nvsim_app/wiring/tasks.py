"""The tasks of the scan: their paths in both views, their review, and the trajectories of agents."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QPainter
from PySide6.QtWidgets import QFileDialog

from nvsim.graph.selection import GraphSelection
from nvsim.project.layout import Layout
from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.metrics.submission import Pose, read_submission
from nvsim.r2r.reviewing import Review, TaskEntry, TaskFolder, export_reviewed, read_folder, scored_episodes, task_error
from nvsim_app.actions import Action
from nvsim_app.jobs.history import folder_of
from nvsim_app.jobs.queue import JobHandle
from nvsim_app.look import colors
from nvsim_app.modes.mode import dots, line
from nvsim_app.panels.tasks import TaskPanel
from nvsim_app.processes.background import BackgroundWork
from nvsim_app.state.reasons import with_editing
from nvsim_app.views.graph_surface import GraphSurface
from nvsim_app.wiring.part import Dock, Part, WindowContext
from nvsim_app.wiring.selecting import SelectPart

EXPORT = "export tasks"
SETTLE = 250  # milliseconds after an edit until the tasks are checked


class TaskPart(Part):
    """Reads, reviews, and exports tasks, and draws their paths."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.panel = panel = TaskPanel()
        self._review_file: Path | None = None
        self._trajectories: dict[str, list[Pose]] = {}
        self._all: tuple[TaskEntry, ...] = ()  # tasks of all scans
        self._reading, self._playing, self._checking = (
            BackgroundWork(name, self) for name in ("tasks", "trajectories", "checks of tasks")
        )
        panel.opened.connect(self._choose)
        panel.picked.connect(self._choose_files)
        panel.played.connect(self._choose_trajectories)
        panel.undone.connect(self.undo)
        panel.exported.connect(self.export)
        panel.chosen.connect(context.modes.refresh)
        panel.judged.connect(self.judge)
        panel.written.connect(self.rewrite)
        panel.stepped.connect(self.step)
        panel.visited.connect(self.visit)
        self._soon = QTimer(self, singleShot=True, interval=SETTLE)
        self._soon.timeout.connect(self.update_findings)
        context.document.graphChanged.connect(self._on_graph)
        context.document.projectChanged.connect(self._close_tasks)
        context.document.unitsChanged.connect(panel.show_summary)
        context.jobs.ended.connect(self._on_ended)
        context.modes.layers.append(self.paint)

    def _on_graph(self, _: object) -> None:
        self._soon.start()

    def _on_ended(self, handle: JobHandle) -> None:
        """Opens the tasks that a job exported."""
        folder = folder_of(handle.job) if handle.job.order.verb == EXPORT and handle.state == "done" else None
        if folder is not None:
            self.open(folder)

    def _choose(self) -> None:
        name = QFileDialog.getExistingDirectory(self.context.window, "Folder of tasks")
        if name:
            self.open(Path(name))

    def _choose_files(self) -> None:
        names, _ = QFileDialog.getOpenFileNames(self.context.window, "Task files", "", "Tasks (*.json)")
        if names:
            self.open(*map(Path, names))

    def _choose_trajectories(self) -> None:
        name, _ = QFileDialog.getOpenFileName(self.context.window, "Trajectories", "", "Submission (*.json)")
        if name:
            self.read_submission(Path(name))

    def docks(self) -> tuple[Dock, ...]:
        return (Dock("tasks", "Tasks", self.panel, "bottom", tab="jobs", needs=with_editing),)

    def show(self) -> None:
        """Shows the tasks, and gives the keys to the list."""
        self.context.window.show_dock("tasks")
        self.panel.table.setFocus()

    def store(self, settings: object) -> None:
        self.panel.keep()

    def open(self, *paths: Path) -> None:
        """Reads files or a folder of tasks in the background. A read error becomes a notice."""
        self._reading.start(lambda: read_folder(*paths), self._show, self.context.notices.error)

    def read_submission(self, path: Path) -> None:
        """Reads a submission in the background. A read error becomes a notice."""
        self._playing.start(lambda: read_submission(path), self._set_trajectories, self.context.notices.error)

    def _show(self, folder: TaskFolder) -> None:
        graph, project = self.context.document.graph, self.context.document.project
        # Exports name the scan after the folder; the map keeps the name that the folder had when it was built.
        names = [] if project is None else [Layout(project).scan_name]
        names += [] if graph is None or graph.scan in names else [graph.scan]
        mine = tuple(e for e in folder.entries if e.task.scan in names)
        if not mine:
            scans = ", ".join(sorted({e.task.scan for e in folder.entries})[:4])
            here = " or ".join(names)
            self.context.notices.warning(f"No task belongs to the scan {here}; the tasks belong to {scans}.")
            return
        self.panel.keep()
        self._review_file, self._all = folder.review_file, folder.entries
        self.panel.show_entries(mine, folder.review)
        self.context.window.show_dock("tasks")
        self.update_findings()

    def _set_trajectories(self, trajectories: dict[str, list[Pose]]) -> None:
        self._trajectories = trajectories
        self.update_findings()

    def update_findings(self) -> None:
        """Finds broken tasks and scores the trajectories, in the background."""
        graph, entries, walked = self.context.document.graph, self.panel.entries, self._trajectories
        if graph is None or not entries:
            return

        def work() -> tuple[Any, Any]:
            distances = Distances(graph)
            return (
                {e.key: why for e in entries if (why := task_error(e.task, distances))},
                scored_episodes([e.task for e in entries], walked, distances) if walked else {},
            )

        self._checking.start(work, self._mark, self.context.notices.error)

    def _mark(self, found: tuple[Any, Any]) -> None:
        model = self.panel.model
        model.faults, model.episodes = found
        self.panel.refilter()

    def _close_tasks(self) -> None:
        self.panel.keep()
        for work in (self._reading, self._playing, self._checking):
            work.drop()
        self._review_file, self._all, self._trajectories = None, (), {}
        self.panel.show_entries((), Review())

    # Verdicts ----------------------------------------------------------------------------------------------------

    def judge(self, state: str) -> None:
        """Sets the state of the selected task. A repeated state is removed."""
        entry, review = self.panel.current, self.panel.model.review
        if entry is not None:
            review.set_state(entry.key, "" if review[entry.key].state == state else state)
            self._keep()

    def rewrite(self, texts: list[str]) -> None:
        entry, review = self.panel.edited, self.panel.model.review
        if entry is not None:
            review.set_instructions(entry.key, None if tuple(texts) == entry.task.instructions else texts)
            self._keep()

    def undo(self) -> None:
        self.panel.keep()
        if self.panel.model.review.undo() is not None:
            self._keep()
            self.panel.refilter()
            self.panel.fill()

    def _keep(self) -> None:
        with self.context.notices.reporting():
            if self._review_file is not None:
                self.panel.model.review.write(self._review_file)
        self.panel.refresh()

    def export(self) -> None:
        """Writes the accepted tasks of all scans beside the review file."""
        self.panel.keep()
        if self._review_file is None:
            return
        with self.context.notices.reporting(about="tasks"):
            folder = self._review_file.parent
            files = export_reviewed(self._all, self.panel.model.review, folder, overwrite=True)
            words = f"Wrote {', '.join(f.name for f in files)} into {self._review_file.parent}."
            self.context.notices.info(words, about="tasks")

    # Views -------------------------------------------------------------------------------------------------------

    def _places(self, ids: list[str]) -> NDArray[np.float64]:
        """(N, 3) world positions on the floor in meters, of the ids that are in the visible graph."""
        arrays = self.context.document.shown_arrays
        rows = [arrays.index[id] for id in ids if id in arrays.index]
        return arrays.feet[rows].reshape(-1, 3)

    def _shown_path(self, entry: TaskEntry) -> list[str]:
        did = self.panel.shown
        return [pose[0] for pose in did.poses] if did else list(entry.task.path)

    def step(self, number: int) -> None:
        """Goes to a step of the trajectory or the path, and looks in the direction of travel."""
        entry, graph = self.panel.current, self.context.document.graph
        ids = [] if entry is None else self._shown_path(entry)
        if entry is None or graph is None or number >= len(ids) or ids[number] not in graph.viewpoints:
            return
        here, heading = np.array(graph.viewpoints[ids[number]].position), entry.task.heading
        did = self.panel.shown
        if did is not None:
            heading = did.poses[number][1]
        elif number and ids[number - 1] in graph.viewpoints:
            way = here - np.array(graph.viewpoints[ids[number - 1]].position)
            heading = math.atan2(way[0], way[1])
        self.context.scene.places.go_to_position(here, heading)
        self.context.modes.refresh()

    def visit(self) -> None:
        """Selects the viewpoints of the path and brings them into view."""
        entry, document = self.panel.current, self.context.document
        if entry is not None:
            there = frozenset(id for id in entry.task.path if id in document.graph_arrays.index)
            self.context.part(SelectPart).show_selection(GraphSelection(there))

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        entry = self.panel.current
        if entry is None or not self.panel.isVisible():
            return
        path, did = self._places(list(entry.task.path)), self.panel.shown
        if not len(path):
            return
        line(painter, surface, path[:-1], path[1:], colors.SELECTED, 4.0, Qt.PenStyle.SolidLine)
        heading = entry.task.heading
        ahead = path[0] + 0.9 * np.array([math.sin(heading), math.cos(heading), 0.0])
        line(painter, surface, path[0], ahead, colors.CAMERA, 3.0, Qt.PenStyle.SolidLine)
        dots(painter, surface, path[:1], colors.OPEN, 6.0)
        dots(painter, surface, path[-1:], colors.BLOCKED, 7.0)
        if did is not None:
            walked = self._places(self._shown_path(entry))
            line(painter, surface, walked[:-1], walked[1:], colors.AGENT, 2.6)
        at = self._shown_path(entry)[self.panel.slider.value() : self.panel.slider.value() + 1]
        dots(painter, surface, self._places(at), colors.AGENT, 8.0, filled=False)

    ACTIONS = (
        Action("&Graph", 2, "tasks", "&Tasks", "Review paths and instructions of the scan, and trajectories of agents",
               lambda self: self.show(), "Shift+F9", with_editing),
    )  # fmt: skip
