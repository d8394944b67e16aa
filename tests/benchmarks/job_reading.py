"""Measure how long reading jobs blocks the event loop of the window: python tests/benchmarks/job_reading.py."""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path

from harness import report, times

from nvsim.events import Metric, Progress
from nvsim.project.jobs.files import EventFile, event_line
from nvsim.project.jobs.joblist import JobList
from nvsim_app.jobs.history import JobReport
from nvsim_app.jobs.queue import BYTES_A_LOOK

EVENTS, JOBS = 20_000, 40


def measure(folder: Path) -> dict[str, float]:
    """Median milliseconds to read one piece of a long history, and to read a list of jobs."""
    path = folder / "events.jsonl"
    with open(path, "w") as file:
        for i in range(EVENTS):
            event = Metric("train", "psnr", 20.123, i, 0) if i % 5 else Progress("train", i, EVENTS, "1 of 3 submaps")
            file.write(event_line(event, 1e9 + i))
    events, history, pieces = EventFile(path), JobReport(), list[float]()

    def read_piece(_: int) -> None:
        for at, event in events.read(BYTES_A_LOOK):
            history.receive(at, event)

    while events.has_unread_events:
        pieces += times(read_piece, 1)
    jobs = JobList(folder / "p.nvsim")
    for _ in range(JOBS):
        jobs.add("train", [], "Train")
    looks = times(lambda _: jobs.jobs(), 50)
    return {"piece_ms": statistics.median(pieces), "pieces": len(pieces), "look_ms": statistics.median(looks)}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        report(measure(Path(name)), as_json=True)
