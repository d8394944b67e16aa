"""Measure the task browser with a file of 14,000 instructions: `python -m tests.benchmarks.task_browser`.

It prints the seconds until the tasks are listed, and until broken tasks and trajectories are marked. It also prints how
long the window is blocked meanwhile, and the milliseconds for scrolling, filtering, selecting, and judging."""

from __future__ import annotations

import os
import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
sys.path.insert(0, str(Path(__file__).parents[1] / "gui"))

import demo_room  # noqa: E402
import networkx as nx  # noqa: E402
from PySide6.QtCore import QSettings, Qt  # noqa: E402
from PySide6.QtTest import QTest  # noqa: E402
from PySide6.QtWidgets import QApplication  # noqa: E402

from nvsim.graph.types import NavGraph  # noqa: E402
from nvsim.r2r.metrics.submission import write_submission  # noqa: E402
from nvsim.r2r.tasks.task import Task, write_tasks  # noqa: E402
from nvsim_app.look.notices import Notices  # noqa: E402
from nvsim_app.state.document import Document  # noqa: E402
from nvsim_app.wiring.tasks import TaskPart  # noqa: E402
from nvsim_app.wiring.window import MainWindow  # noqa: E402
from tests.benchmarks.frame_browser import step_times  # noqa: E402

PATHS = 4667
WORDS = "turn left right walk through the door past red sofa table stop stairs"


def make_tasks(graph: NavGraph, folder: Path) -> None:
    """Writes PATHS paths with three instructions each, and a random trajectory for each instruction."""
    chance, ways = random.Random(0), nx.Graph(list(graph.edges))
    tasks, walked = [], {}
    for i in range(PATHS):
        start, goal = chance.choice(list(ways.edges)) if i % 2 else chance.sample(sorted(ways), 2)
        path = nx.shortest_path(ways, start, goal) if nx.has_path(ways, start, goal) else [start]
        texts = tuple(" ".join(chance.choices(WORDS.split(), k=26)) for _ in range(3))
        tasks.append(Task(i, graph.scan, tuple(path), 0.0, texts, 8.0))
        for id in tasks[-1].instr_ids:
            at = [path[0]]
            for _ in range(8):
                at.append(chance.choice(sorted(ways[at[-1]])))
            walked[id] = [(v, 0.0, 0.0) for v in at]
    write_tasks(folder / "R2R_train.json", tasks)
    write_submission(folder / "submission.json", walked)


def waited(until: Callable[[], bool]) -> str:
    """Seconds until a condition holds, and the longest time without event handling."""
    begin = last = time.perf_counter()
    longest = 0.0
    while not until():
        QApplication.processEvents()
        now = time.perf_counter()
        longest, last = max(longest, now - last), now
        time.sleep(0.002)
    return f"{time.perf_counter() - begin:5.2f} s, longest block {1e3 * longest:.0f} ms"


def main() -> None:
    app = QApplication.instance() or QApplication([])
    document = Document()
    document.set_contents(demo_room.contents(Path("demo.nvsim")))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        settings = QSettings(str(folder / "window.ini"), QSettings.Format.IniFormat)
        window = MainWindow(document, settings, Notices())
        window.show()
        assert document.graph is not None
        make_tasks(document.graph, folder)
        part = window.part(TaskPart)
        panel = part.panel
        QTest.qWait(300)
        part.open(folder)
        print("opens:       ", waited(lambda: panel.model.rowCount() == PATHS))
        part.read_submission(folder / "submission.json")
        print("trajectories:", waited(lambda: bool(panel.model.episodes)))
        bar = panel.table.verticalScrollBar()

        def scroll(i: int) -> None:
            bar.setValue(bar.maximum() * i // 300)
            app.processEvents()

        def choose(i: int) -> None:
            panel.table.selectRow(i)
            app.processEvents()

        def write(i: int) -> None:
            panel.text.setText("red sofa table stop"[: i % 19])
            app.processEvents()

        def judge(i: int) -> None:
            QTest.keyClick(panel.table, Qt.Key.Key_A)
            QTest.keyClick(panel.table, Qt.Key.Key_Down)
            app.processEvents()

        for what, step, count in (("scrolls", scroll, 300), ("chooses", choose, 60), ("filters", write, 60)):
            print(f"{what}:     ", step_times(step, count))
        panel.text.clear()
        print("judges:      ", step_times(judge, 60))
        panel.order.setCurrentIndex(1)
        panel.state.setCurrentIndex(1)
        print("judges, worst first of the unread:", step_times(judge, 20))
        window.close()


if __name__ == "__main__":
    main()
