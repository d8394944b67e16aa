"""Opens the window on a project and runs it until it is closed. First checks whether a window can open, before Qt is
loaded, because Qt aborts the process if it cannot."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Mapping
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
    try:
        if (reason := why_no_window()) is not None:
            raise InputError(reason)
        if project is not None:
            check_openable(project)
        from nvsim_app.start.application import check_settings, run_application

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

    if (reason := why_no_window()) is not None:
        print(reason, file=sys.stderr)
        return 2
    from PySide6.QtCore import QSettings

    from nvsim_app.benchmarks.graphs import measure
    from nvsim_app.start.application import Collecting, make_application

    with tempfile.TemporaryDirectory(prefix="nvsim-window-") as folder:
        settings = QSettings(f"{folder}/window.ini", QSettings.Format.IniFormat)
        make_application("dark", settings)
        collecting = Collecting(lambda: False)
        try:
            print(json.dumps(measure(settings, edits, viewpoints)))
        finally:
            collecting.stop()
    return 0


# Shared library -> Debian package. QtGui and Qt's xcb plugin cannot load without these.
_ALWAYS = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libdbus-1.so.3": "libdbus-1-3",
    "libfontconfig.so.1": "libfontconfig1",
}
_XCB = {
    "libX11-xcb.so.1": "libx11-xcb1",
    "libxkbcommon-x11.so.0": "libxkbcommon-x11-0",
    "libxcb-cursor.so.0": "libxcb-cursor0",
    "libxcb-icccm.so.4": "libxcb-icccm4",
    "libxcb-image.so.0": "libxcb-image0",
    "libxcb-keysyms.so.1": "libxcb-keysyms1",
    "libxcb-randr.so.0": "libxcb-randr0",
    "libxcb-render-util.so.0": "libxcb-render-util0",
    "libxcb-shape.so.0": "libxcb-shape0",
    "libxcb-shm.so.0": "libxcb-shm0",
    "libxcb-sync.so.1": "libxcb-sync1",
    "libxcb-xfixes.so.0": "libxcb-xfixes0",
    "libxcb-xkb.so.1": "libxcb-xkb1",
}
_WINDOWLESS = ("offscreen", "minimal", "vnc")


def _can_load(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _display_answers() -> bool:
    """Whether the X server of DISPLAY accepts a connection."""
    try:
        xcb = ctypes.CDLL("libxcb.so.1")
    except OSError:
        return True  # Qt includes the library, or names the missing one
    xcb.xcb_connect.restype = ctypes.c_void_p
    xcb.xcb_connect.argtypes = (ctypes.c_char_p, ctypes.c_void_p)
    xcb.xcb_connection_has_error.argtypes = (ctypes.c_void_p,)
    xcb.xcb_disconnect.argtypes = (ctypes.c_void_p,)
    connection = xcb.xcb_connect(None, None)
    failed = bool(xcb.xcb_connection_has_error(connection))
    xcb.xcb_disconnect(connection)
    return not failed


def why_no_window(
    environment: Mapping[str, str] = os.environ,
    loads: Callable[[str], bool] = _can_load,
    display_answers: Callable[[], bool] = _display_answers,
    platform: str = sys.platform,
) -> str | None:
    """One sentence that says why no window can open here, or None."""
    if not platform.startswith("linux"):
        return None
    plugin = environment.get("QT_QPA_PLATFORM", "").split(":")[0].split(";")[0]
    windowless = plugin in _WINDOWLESS
    display, wayland = environment.get("DISPLAY"), environment.get("WAYLAND_DISPLAY")
    if not windowless and not display and not wayland:
        return (
            "There is no display for a window (DISPLAY and WAYLAND_DISPLAY are empty); "
            "start NVSim on a desktop, or under Xvfb with `xvfb-run -a nvsim app --project PATH`."
        )
    needed = dict(_ALWAYS)
    if not windowless and (plugin == "xcb" or not wayland):
        needed |= _XCB
    missing = [package for library, package in needed.items() if not loads(library)]
    if missing:
        noun = "a system library" if len(missing) == 1 else "system libraries"
        return f"The window needs {noun} that this machine lacks; run `sudo apt install {' '.join(missing)}`."
    if not windowless and display and not wayland and not display_answers():
        return f"The display {display} does not answer; check the variable DISPLAY, or start the X server."
    return None
