"""The workers of a job that runs on a cluster, and the part that each one computes. Hidden for other jobs."""

from __future__ import annotations

from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.jobs.queue import JobHandle
from app.look import colors
from app.look.table import Column, TableModel, table
from app.panels.job_table import clock

Worker = tuple[str, str, str, str]
"""Name, work, state, and time of the last event."""
_COLORS = {"works": "running", "lost": "blocked"}
COLUMNS: tuple[Column[Worker], ...] = (
    Column("Worker", lambda row: row[0]),
    Column("Works on", lambda row: row[1]),
    Column("State", lambda row: row[2], ink=lambda row: colors.text(_COLORS.get(row[2], "quiet"))),
    Column("Since", lambda row: row[3]),
)
_WORDS = {"works": "works", "ended": "idle", "lost": "lost"}


class WorkerModel(TableModel[Worker]):
    """One row for each worker, working ones first."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(COLUMNS, parent, about=lambda row: f"{row[0]}: {row[1]}, {row[2]}")


class JobWorkers(QWidget):
    """The table of the selected job's workers."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._handle: JobHandle | None = None
        self.model = WorkerModel(self)
        self.table = table(self.model, self)
        self.table.setAccessibleName("Workers")
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.table)

    def show_job(self, handle: JobHandle | None) -> None:
        """Shows the workers of this job."""
        self._handle = handle
        self.refresh()

    @property
    def any(self) -> bool:
        """Whether the job has workers."""
        return self._handle is not None and bool(self._handle.history.workers)

    def refresh(self) -> None:
        """Updates the rows."""
        handle = self._handle
        found = [] if handle is None else list(handle.history.workers.values())
        running = handle is not None and handle.running
        rows = []
        for at, worker in sorted(found, key=lambda row: (row[1].state != "works", row[1].name)):
            state = _WORDS.get(worker.state, worker.state) if running or worker.state == "lost" else "gone"
            rows.append((worker.name, worker.words if state in ("works", "lost") else "–", state, clock(at)))
        self.model.show(rows)
