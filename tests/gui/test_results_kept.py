"""A canceled training leaves the trained model in the view; an earlier result comes back from the Jobs menu."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import tiny_capture
from pytestqt.qtbot import QtBot

from nvsim.project.earlier_results import replaced_result_sentence
from nvsim.project.project import Project
from nvsim_app.forms.form import CommandForm
from nvsim_app.panels.stages import EarlierResults
from nvsim_app.panels.submaps import is_training, model_words
from nvsim_app.session import Session
from nvsim_app.state.loading import Contents
from nvsim_app.wiring.jobs import JobsPart

SECONDS = 240_000  # milliseconds, the first kernels included
STEPS = 20


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with one trained submap."""
    from nvsim.cli.main import main

    folder = tmp_path_factory.mktemp("kept")
    capture, project = tiny_capture.write_capture(folder), folder / "rooms.nvsim"
    few = ["--steps", str(STEPS), "--image-size", "64", "--gaussian-cap", "1000", "--threads", "1"]
    for verb in (["import", str(capture)], ["submaps", "--count", "1"], ["floors"], ["train", *few]):
        assert main([*verb, "--project", str(project)]) == 0
    long = {**tiny_capture.SETTINGS["train"], "config.steps": 5000, "config.checkpoint_seconds": 0.1}
    (project / "settings.json").write_text(json.dumps({"train": long}))
    return project


def test_a_cancelled_training_leaves_the_trained_model_in_the_view(
    trained: Path, qtbot: QtBot, session: Session
) -> None:
    session.open(trained)
    document = session.window.document
    qtbot.waitUntil(lambda: session.window.scene.picture is not None, timeout=SECONDS)
    assert document.contents.model_info[0]["steps"] == STEPS
    part = session.window.part(JobsPart)

    form = part.open_form("train")
    assert isinstance(form, CommandForm)
    with Project.open(trained) as project:
        assert form.replaces.text().lower() == replaced_result_sentence(project, "train").lower() != ""
    form.reject()

    scene, blank = session.window.scene, []

    def words() -> str:
        return model_words(document.contents, 0, is_training(document))

    scene.feed.changed.connect(lambda: blank.append(scene.picture is None))
    handle = part.run_stage("train")
    assert handle is not None
    qtbot.waitUntil(lambda: 0 in document.contents.training, timeout=SECONDS)
    qtbot.waitUntil(
        lambda: f"trained, {STEPS} steps · training, step" in words(),
        timeout=SECONDS,
    )
    assert scene.picture is not None and not any(blank), "a training that starts leaves the view as it is"
    assert session.window.center.currentWidget() is scene
    # The model in the making may be seen before the job says how far it is.
    qtbot.waitUntil(lambda: any(r.handle is handle and r.share > 0 for r in part.panel.model.rows), timeout=SECONDS)
    session.window.jobs.cancel(handle)
    qtbot.waitUntil(lambda: handle.state == "cancelled", timeout=SECONDS)
    row = next(r for r in part.panel.model.rows if r.handle is handle)
    assert 0 < row.share < 1 and row.note.startswith("Stopped at "), "it says how far it came"
    session.window.refreshWanted.emit()
    qtbot.waitUntil(lambda: "unfinished training" in words(), timeout=SECONDS)
    assert document.contents.model_info[0]["steps"] == STEPS and not document.contents.live
    qtbot.waitUntil(lambda: session.window.scene.link.ready, timeout=SECONDS)
    assert not any("train this submap again" in text for text in session.window.notice_area.texts)
    with Project.open(trained) as project:
        scene = project.scene(live=True)  # what the process that draws has
        assert scene is not None and scene.model(0).info["steps"] == STEPS


def test_an_earlier_result_comes_back_from_the_jobs_menu(trained: Path, qtbot: QtBot, session: Session) -> None:
    from nvsim.cli.main import main

    more = ["--steps", str(STEPS + 5), "--image-size", "64", "--gaussian-cap", "1000", "--threads", "1"]
    assert main(["train", *more, "--project", str(trained)]) == 0
    session.open(trained)
    document = session.window.document
    qtbot.waitUntil(lambda: document.contents.restorable_stages == {"train"}, timeout=SECONDS)
    qtbot.waitUntil(lambda: 0 in document.contents.model_info, timeout=SECONDS)
    assert document.contents.model_info[0]["steps"] == STEPS + 5
    session.window.actions_table["earlier_results"].trigger()
    dialog = session.window.findChild(EarlierResults)
    assert dialog is not None and f"{STEPS} steps" in dialog.list.item(0).text() and "B" in dialog.list.item(0).text()
    dialog.restore_button.click()
    qtbot.waitUntil(lambda: document.contents.model_info[0]["steps"] == STEPS, timeout=SECONDS)


def test_the_words_name_the_model_that_is_shown() -> None:
    done = Contents(model_info={0: {"steps": 2000}}, training={0: 430})
    assert model_words(done, 0, False) == "trained, 2000 steps · unfinished training, step 430"
    assert model_words(done, 1, False) == "not trained"
    assert model_words(done, 0, True) == "trained, 2000 steps · training, step 430"
    former = Contents(stages_of_previous_cut=frozenset({"train"}))
    assert model_words(former, 2, False) == "models of the previous submaps are shown"
