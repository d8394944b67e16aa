"""The results of evaluations, collected from the jobs and from the project."""

from __future__ import annotations

from PySide6.QtCore import Signal

from app.jobs.queue import JobHandle
from app.panels.results import ResultPanel
from app.state.reasons import with_results
from app.state.results import Result, result_of_job, stored_result
from app.wiring.part import Dock, Part
from nvsim.project.work import EVALUATIONS


class ResultPart(Part):
    """Collects and shows results. gathered(list of Result): all results."""

    gathered = Signal(object)

    def docks(self) -> tuple[Dock, ...]:
        w = self.context
        self.panel = ResultPanel(w.notices)
        self.panel.frameWanted.connect(self._go_to_frame)
        self.panel.submapWanted.connect(lambda index: w.document.select(submap=index))
        self._read: dict[int, Result | None] = {}  # number of a finished job -> its result
        w.document.contentsChanged.connect(self._on_contents)
        w.document.projectChanged.connect(self._on_project)
        w.jobs.changed.connect(self._gather)
        w.jobs.ended.connect(self._on_ended)
        return (
            Dock("results", "Results", self.panel, "bottom", tab="jobs", needs=with_results,
                 workspaces=("train", "compare")),
        )  # fmt: skip

    def _on_project(self) -> None:
        self._read.clear()
        self._gather()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "results" in parts:
            self._gather()

    def _on_ended(self, handle: JobHandle) -> None:
        if handle.job.order.verb in EVALUATIONS and handle.state == "done":
            self._read.pop(handle.number, None)  # the job may have run again
            self._gather()
            self.context.window.front_dock("results")

    def _gather(self) -> None:
        found = []
        for handle in self.context.jobs.handles:
            if handle.state == "done":
                if handle.number not in self._read:
                    self._read[handle.number] = result_of_job(handle.job)
                found.append(self._read[handle.number])
        stored = self.context.document.contents.results
        fresh = [stored_result(name, at, figures) for name, (at, figures) in stored.items()]
        results = [r for r in (*found, *fresh) if r is not None]
        self.panel.show_results(results)
        self.gathered.emit(results)

    def _go_to_frame(self, frame: int) -> None:
        self.context.document.select(frame=frame)
        self.context.scene.snap_to_frame(frame)
