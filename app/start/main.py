"""Opens the window on a project and runs it until it is closed."""

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
    """Opens the window and returns the exit code 0. If the window cannot open (InputError), prints one sentence to
    stderr and returns 2.

    project      the file to open, None for the one that was open last
    screenshot   saves the window to this file when it has settled, then closes
    seconds      closes the window after this time
    theme        "dark" or "light" instead of the stored theme
    bench        measures the window, prints one JSON object, and closes; number of times the project is opened again
    memory       GiB for trained models in memory, stored for later windows; 0 removes the setting
    renderer     renderer of colors, "automatic", "cpu", or "opengl", stored for later windows
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
    """Measures how long a window with a graph of `viewpoints` viewpoints takes to paint each of `edits` edits. Prints
    one JSON object and returns the exit code."""
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
