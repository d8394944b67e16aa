"""Checks whether a window can open, before Qt is loaded, because Qt aborts the process if it cannot. Does not use
Qt."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable, Mapping

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


def _loads(library: str) -> bool:
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


def obstacle(
    environment: Mapping[str, str] = os.environ,
    loads: Callable[[str], bool] = _loads,
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
