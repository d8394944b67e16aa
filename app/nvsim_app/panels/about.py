"""The About window: a description of NVSim, and the system report to copy."""

from __future__ import annotations

import os
import platform
import sys
from importlib import metadata
from pathlib import Path

import psutil
from PySide6.QtCore import Qt, qVersion
from PySide6.QtGui import QFontDatabase, QGuiApplication, QIcon, QOffscreenSurface, QOpenGLContext
from PySide6.QtWidgets import QDialogButtonBox, QPlainTextEdit, QWidget

from nvsim.kernel_threads import cores
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.icons import FOLDER
from nvsim_app.look.labels import Label
from nvsim_app.look.theme import type_font
from nvsim_app.look.widgets import Dialog, DialogButtons

_WHAT = (
    "Turns images of a building with their camera poses into a simulator for vision-and-language navigation: "
    "floor-aware Gaussian models, a navigation graph with the evidence for every edge, and R2R data that existing "
    "agents load."
)


class AboutWindow(Dialog):
    """A non-modal window about NVSim."""

    def __init__(self, project: Path | None, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("About NVSim")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.resize(620, 480)
        picture = Label(self)
        picture.setPixmap(QIcon(str(FOLDER / "app.svg")).pixmap(64, 64))
        name = Label(f"NVSim {version_of('nvsim')}", self, font=type_font("large", bold=True))
        what = Label(_WHAT, self, wordWrap=True)
        words = vbox(name, what)
        head = hbox((picture, 0, Qt.AlignmentFlag.AlignTop), (words, 1), spacing=16)
        self.report = QPlainTextEdit(
            report(project), self, readOnly=True, lineWrapMode=QPlainTextEdit.LineWrapMode.NoWrap
        )
        self.report.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.report.setAccessibleName("System report")
        buttons = DialogButtons(QDialogButtonBox.StandardButton.Close, self)
        self.copy = buttons.addButton("Copy system report", QDialogButtonBox.ButtonRole.ActionRole)
        self.copy.clicked.connect(self._copy)
        buttons.rejected.connect(self.close)
        vbox(head, (self.report, 1), buttons, on=self, spacing=8)

    def _copy(self) -> None:
        QGuiApplication.clipboard().setText(self.report.toPlainText())
        self.copy.setText("Copied")


PACKAGES = (
    "nvsim", "PySide6-Essentials", "pyqtgraph", "moderngl", "numpy", "numba", "scipy", "torch",
    "opencv-contrib-python-headless", "onnxruntime", "networkx", "matplotlib", "safetensors",
)  # fmt: skip
_NO_WINDOWS = ("offscreen", "minimal", "vnc", "linuxfb")  # Qt platforms without OpenGL
_GL_VENDOR, _GL_RENDERER, _GL_VERSION = 0x1F00, 0x1F01, 0x1F02


def version_of(package: str) -> str:
    """The installed version of a package. Does not import the package, because many are not loaded yet."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def processor() -> str:
    """The name of the processor, as the system reports it."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass  # not Linux
    return platform.processor() or platform.machine()


def opengl() -> str:
    """Renderer, version, and vendor of OpenGL, read from a temporary context; or "none" with the reason."""
    if QGuiApplication.platformName() in _NO_WINDOWS:
        return f"none: Qt runs on the platform “{QGuiApplication.platformName()}”"
    before, surface_before = QOpenGLContext.currentContext(), None
    if before is not None:
        surface_before = before.surface()
    context, surface = QOpenGLContext(), QOffscreenSurface()
    surface.create()
    if not context.create() or not context.makeCurrent(surface):
        return "none: no OpenGL context could be created"
    functions = context.functions()
    words = [str(functions.glGetString(name)) for name in (_GL_RENDERER, _GL_VERSION, _GL_VENDOR)]
    context.doneCurrent()
    if before is not None and surface_before is not None:
        before.makeCurrent(surface_before)
    return ", ".join(words)


def facts(project: Path | None = None) -> dict[str, str]:
    """The facts of the report by name, in display order."""
    memory, own = psutil.virtual_memory(), psutil.Process().memory_info().rss
    gib = 2**30
    screen = QGuiApplication.primaryScreen()
    size = screen.size()
    threads = os.environ.get("NUMBA_NUM_THREADS", "") or f"{cores()} (all cores)"
    found = {
        "NVSim": version_of("nvsim"),
        "Python": f"{sys.version.split()[0]} ({platform.python_implementation()})",
        "System": platform.platform(),
        "Processor": f"{processor()}, {cores()} cores for this program",
        "Memory": f"{memory.total / gib:.1f} GiB, {memory.available / gib:.1f} free; this window {own / gib:.2f} GiB",
        "Threads of the kernels": threads,
        "OpenGL": opengl(),
        "Qt": f"{qVersion()} on {QGuiApplication.platformName()}",
        "Screen": f"{size.width()}×{size.height()}, scale {screen.devicePixelRatio():g}",
    }
    if project is not None:
        found["Project"] = str(project)
    return found | {package: version_of(package) for package in PACKAGES[1:]}


def report(project: Path | None = None) -> str:
    """The report as text, one line for each fact."""
    return "\n".join(f"{name}: {value}" for name, value in facts(project).items()) + "\n"
