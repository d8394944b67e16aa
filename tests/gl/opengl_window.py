"""A QOpenGLWidget that draws a model, a label over it by QPainter, then another view at another size; what it showed
is saved as arrays. Run as a program, because Qt's platform is chosen once per process: opengl_window.py OUT.npz"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import moderngl
import numpy as np
from opengl_scenes import CAMERA, MODELS
from PySide6.QtCore import QCoreApplication, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QImage, QPainter, QSurfaceFormat
from PySide6.QtOpenGLWidgets import QOpenGLWidget
from PySide6.QtWidgets import QApplication

from nvsim.geometry.camera import Camera
from nvsim.render.opengl.renderer import OpenGLRenderer

MODEL = MODELS["stairs and ramp"]
LABEL = 12  # pixels at the top that the painter covers


class Window(QOpenGLWidget):
    prepared = Signal()  # from the preparing thread

    def __init__(self, camera: Camera) -> None:
        super().__init__()
        self.camera = camera
        self.exact = False
        self.contexts = 0
        self.prepared.connect(self.update)
        k = camera.intrinsics
        self.setFixedSize(k.width, k.height)

    def initializeGL(self) -> None:
        self.contexts += 1
        self.context_ = moderngl.create_context(require=330)
        self.renderer = OpenGLRenderer(self.context_, on_ready=self.prepared.emit)

    def paintGL(self) -> None:
        target = self.context_.detect_framebuffer(self.defaultFramebufferObject())
        target.viewport = (0, 0, self.width(), self.height())
        self.exact = self.renderer.draw(MODEL, self.camera, target) is self.camera
        painter = QPainter(self)
        painter.fillRect(0, 0, self.width(), LABEL, QColor("magenta"))
        painter.end()

    def look(self, camera: Camera) -> None:
        self.camera, self.exact = camera, False
        self.setFixedSize(QSize(camera.intrinsics.width, camera.intrinsics.height))
        self.update()

    def pixels(self) -> np.ndarray:
        image = self.grabFramebuffer().convertToFormat(QImage.Format.Format_RGB888)
        lines = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
        return lines[:, : 3 * image.width()].reshape(image.height(), image.width(), 3).copy()

    def release(self) -> str:
        self.makeCurrent()
        self.renderer.release()
        error = self.context_.error
        self.context_.release()
        self.doneCurrent()
        return error


def main() -> int:
    wanted = QSurfaceFormat()
    wanted.setVersion(3, 3)
    wanted.setProfile(QSurfaceFormat.OpenGLContextProfile.CoreProfile)
    QSurfaceFormat.setDefaultFormat(wanted)
    QCoreApplication.setAttribute(Qt.ApplicationAttribute.AA_ShareOpenGLContexts)
    app = QApplication(sys.argv[:1])
    window = Window(CAMERA)
    window.show()

    def until_exact() -> np.ndarray:
        while not window.exact:
            app.processEvents()
            time.sleep(0.01)  # each call of processEvents takes one reference of None too many (PySide 6.12)
        return window.pixels()

    QTimer.singleShot(60_000, lambda: sys.exit("the window never showed its view"))
    first = until_exact()
    window.look(replace(CAMERA, intrinsics=CAMERA.intrinsics.scaled(201, 150)))
    second = until_exact()
    error = window.release()
    window.close()
    np.savez(sys.argv[1], first=first, second=second, error=error, contexts=window.contexts)
    return 0


if __name__ == "__main__":
    sys.exit(main())
