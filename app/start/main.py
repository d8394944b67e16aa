"""Starts the window on a project and runs it until it is closed."""

from __future__ import annotations

import sys
from pathlib import Path

from nvsim.errors import InputError
from nvsim.project.path_kind import check_openable


def run(
    project: Path | None,
    *,
    screenshot: Path | None = None,
    seconds: float | None = None,
    theme: str | None = None,
    bench: int | None = None,
    memory: float | None = None,
    renderer: str | None = None,
) -> int:
    """Opens the window, without a project on the one that was open last; returns the exit code: 0, or 2 after one
    sentence on stderr when it cannot open.

    screenshot   the whole window is saved there once it has settled, then it closes
    seconds      it closes by itself after that time
    theme        "dark" or "light" in place of the remembered one
    bench        measures itself, prints one JSON object and closes; the project is closed and opened again so often
    memory       GiB for the trained models in memory, remembered for the next window; 0 forgets it
    renderer     who draws colours, "automatic", "cpu" or "opengl", remembered for the next window
    """
    from app.start.preflight import obstacle

    try:
        if (reason := obstacle()) is not None:
            raise InputError(reason)
        if project is not None:
            check_openable(project)
        from app.start.application import check_settings, run_application

        check_settings()
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return run_application(
        project, screenshot=screenshot, seconds=seconds, theme=theme, bench=bench, memory=memory, renderer=renderer
    )


def run_edits(edits: int, viewpoints: int) -> int:
    """Edits a graph of so many viewpoints in a window so often, prints as one JSON object how long until it was
    painted, and closes."""
    import json
    import tempfile

    from app.start.preflight import obstacle

    if (reason := obstacle()) is not None:
        print(reason, file=sys.stderr)
        return 2
    from PySide6.QtCore import QSettings

    from app.benchmarks.edits import measure
    from app.start.application import make_application
    from app.start.collecting import Collecting

    with tempfile.TemporaryDirectory(prefix="nvsim-window-") as folder:
        settings = QSettings(f"{folder}/window.ini", QSettings.Format.IniFormat)
        make_application("dark", settings)
        collecting = Collecting(lambda: False)
        try:
            print(json.dumps(measure(settings, edits, viewpoints)))
        finally:
            collecting.stop()
    return 0
