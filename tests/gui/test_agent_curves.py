"""The Jobs panel shows the curves of an agent in training, and no empty plots beside them."""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from nvsim.events import Metric
from nvsim_app.forms.fields import arguments_of, fields_of
from nvsim_app.jobs.history import JobReport
from nvsim_app.panels.job_plots import JobPlots


def test_loss_and_success_of_an_agent_are_drawn_alone(qtbot: Any) -> None:
    plots = JobPlots()
    qtbot.addWidget(plots)
    plots.resize(700, 200)
    plots.show()
    report = JobReport()
    plots.show_job(cast(Any, SimpleNamespace(number=1, history=report)))
    assert plots.empty.isVisible()
    for step in range(10, 210, 10):
        report.receive(time.time(), Metric("r2r train", "loss", 3 / step, step))
    report.receive(time.time(), Metric("r2r train", "success", 0.4, 200))
    plots.refresh()
    qtbot.waitUntil(lambda: "success" in plots.plots and not plots.empty.isVisible(), timeout=5000)
    assert [name for name, plot in plots.plots.items() if plot.isVisible()] == ["loss", "success"]
    (curve,) = plots.plots["loss"].listDataItems()
    assert list(curve.getData()[0]) == list(range(10, 210, 10))
    plots.resize(160, 200)  # only the first curve fits
    assert [name for name, plot in plots.plots.items() if plot.isVisible()] == ["loss"]
    plots.resize(700, 200)
    assert [name for name, plot in plots.plots.items() if plot.isVisible()] == ["loss", "success"]


def test_the_form_of_the_training_of_an_agent_gives_its_command(tmp_path: Path) -> None:
    fields = fields_of("r2r train")
    words = arguments_of(fields, {"scans": (str(tmp_path),), "learning.iterations": 100, "model.blind": True})
    assert words == ["--scans", str(tmp_path), "--blind", "--iterations", "100"]
