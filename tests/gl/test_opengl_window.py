"""The OpenGL renderer inside a context of Qt, in a real window."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from opengl_scenes import CAMERA, MODELS
from opengl_window import LABEL

from nvsim.render.model import render_model

pytestmark = pytest.mark.gl
HERE = Path(__file__).resolve().parent


def test_a_qt_widget_shows_what_the_kernels_draw(display: str, tmp_path: Path) -> None:
    out = tmp_path / "shown.npz"
    environment = {
        **os.environ,
        "DISPLAY": display,
        "QT_QPA_PLATFORM": "xcb",
        "PYTHONPATH": os.pathsep.join([*filter(None, sys.path), str(HERE)]),
    }
    done = subprocess.run(
        [sys.executable, str(HERE / "opengl_window.py"), str(out)],
        env=environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    shown = np.load(out)
    assert str(shown["error"]) == "GL_NO_ERROR" and int(shown["contexts"]) == 1
    for name, camera in (("first", CAMERA), ("second", CAMERA.scaled(201, 150))):
        rgb = render_model(MODELS["stairs and ramp"], camera, frozenset({"rgb"})).rgb
        assert rgb is not None and shown[name].shape == rgb.shape
        error = shown[name][LABEL:] / 255 - np.clip(rgb[LABEL:], 0, 1)
        assert -10 * np.log10(np.mean(error**2)) > 45
        assert (shown[name][: LABEL - 1] == [255, 0, 255]).all()  # Qt's painter still works after it


def test_the_window_shows_the_same_reconstruction_with_either_renderer(display: str, tmp_path: Path) -> None:
    """Above the line of status, which names the renderer, the views differ by rounding only."""
    import demo_project
    from PySide6.QtGui import QImage

    project = demo_project.write_project(tmp_path / "demo.nvsim", count=8000, models=1, with_graph=False)
    views = {}
    for renderer in ("cpu", "opengl"):
        picture = tmp_path / f"{renderer}.png"
        environment = {
            **os.environ,
            "DISPLAY": display,
            "QT_QPA_PLATFORM": "xcb",
            "XDG_CONFIG_HOME": str(tmp_path / "config"),
        }
        done = subprocess.run(
            [sys.executable, "-m", "nvsim_app", str(project), f"--renderer={renderer}", f"--screenshot={picture}"],
            cwd=HERE.parents[1], env=environment, capture_output=True, text=True, timeout=240, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        image = QImage(str(picture)).convertToFormat(QImage.Format.Format_RGB888)
        lines = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
        views[renderer] = lines[:, : 3 * image.width()].reshape(image.height(), image.width(), 3).astype(int)
    height, width = views["cpu"].shape[:2]
    middle = (slice(height // 8, height // 2), slice(width // 3, 2 * width // 3))
    assert views["cpu"][middle].std() > 10
    assert np.abs(views["cpu"][middle] - views["opengl"][middle]).max() <= 3
    assert (views["cpu"] != views["opengl"]).any()  # the name of the renderer, at least
