"""Export features from the window: the form shows layouts and their networks, and a job writes the files."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from demo_project import write_project
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from nvsim.graph.connectivity import write_connectivity
from nvsim.project.jobs.joblist import JobList
from nvsim.project.project import Project
from nvsim.r2r.features.layouts import LAYOUTS
from nvsim_app.forms.form import CommandForm
from nvsim_app.jobs.history import folder_of
from nvsim_app.panels.scan_estimate import FeatureMakersPanel
from nvsim_app.session import Session

SECONDS = 120_000


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_project(tmp_path_factory.mktemp("project") / "room.nvsim", count=300)


@pytest.fixture
def project(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("NVSIM_MODELS", str(tmp_path / "models"))
    return Path(shutil.copytree(made, tmp_path / "room.nvsim"))


@pytest.fixture
def session(session: Session, project: Path, qtbot: QtBot) -> Iterator[Session]:
    session.open(project)
    qtbot.waitUntil(session.window.actions_table["export_features"].isEnabled, timeout=SECONDS)
    yield session
    for job in JobList(project).jobs():
        JobList(project).kill(job.number)


def opened_form(session: Session) -> CommandForm:
    session.window.actions_table["export_features"].trigger()
    form = next(f for f in session.window.findChildren(CommandForm) if f.isVisible())
    form.finish_building()
    return form


def makers(form: CommandForm) -> dict[str, str]:
    panel = form.findChild(FeatureMakersPanel)
    assert panel is not None
    return {name: label.text() for name, label in panel.makers.items()}


def test_layouts_and_what_is_installed_stand_beside_the_options(
    session: Session, project: Path, tmp_path: Path, qtbot: QtBot
) -> None:
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "features.clip-b16.onnx").write_bytes(b"")
    form = opened_form(session)
    assert form.rows["folder"].editor.value() == str(project.parent / "scans")
    qtbot.waitUntil(lambda: "has no exported scan" in form.problem.text(), timeout=SECONDS)
    assert not form.start_button.isEnabled()
    found = makers(form)
    assert list(found) == list(LAYOUTS)
    assert found["clip-b16"] == "by features.clip-b16.onnx of the models folder"
    assert found["vit-b16"].startswith(("by EfficientNet-Lite0", "by fixed projection"))
    form.rows["projection"].editor.box.setChecked(True)
    qtbot.waitUntil(lambda: "nothing was trained" in makers(form)["clip-b16"], timeout=SECONDS)
    form.reject()


def test_a_job_writes_the_features_of_an_exported_scan(session: Session, project: Path, qtbot: QtBot) -> None:
    scans = project.parent / "scans"
    with Project.open(project) as opened:
        graph = opened.need_graph()
    write_connectivity(graph, scans / "connectivity")
    for id in graph.viewpoints:
        folder = scans / "views" / graph.scan / id
        folder.mkdir(parents=True)
        for i in range(36):
            cv2.imwrite(str(folder / f"{i}.jpg"), np.full((48, 64, 3), 7 * i, np.uint8))
    form = opened_form(session)
    form.rows["projection"].editor.box.setChecked(True)
    qtbot.waitUntil(lambda: form.start_button.isEnabled() and not form._try.isActive(), timeout=SECONDS)
    qtbot.mouseClick(form.start_button, Qt.MouseButton.LeftButton)
    handle = session.window.jobs.handles[-1]
    qtbot.waitUntil(lambda: handle.state in ("done", "failed"), timeout=SECONDS)
    assert handle.state == "done", handle.message
    with h5py.File(scans / "features" / LAYOUTS["vit-b16"].file) as file:
        assert set(file) == {f"{graph.scan}_{id}" for id in graph.viewpoints}
    assert folder_of(handle.job) == scans / "features"
