"""The measurements of a card run, with gsplat's torch reference in its place."""

from __future__ import annotations

import importlib.util
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gsplat_reference import INSTALLED, stand_in

from nvsim.benchmarks import render_card, train
from nvsim.benchmarks.random_room import random_room
from nvsim.benchmarks.render import inside_view
from nvsim.cli.main import main
from nvsim.training.devices import choice

needs_gsplat = pytest.mark.skipif(not INSTALLED, reason="gsplat is not installed")


@needs_gsplat
def test_a_view_is_measured_and_held_to_the_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch)
    figures = render_card.measure(random_room(400), inside_view(48, 32), rounds=1, device="cpu")
    assert figures["frame_ms"] > 0 and figures["fps"] > 0 and figures["gaussians"] == 400
    assert min(figures[name] for name in ("psnr_db", "alpha_psnr_db", "depth_db", "normal_db")) > 40


@needs_gsplat
def test_a_training_step_is_measured_beside_the_plain_one(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch)
    monkeypatch.setattr(choice, "gpu_name", lambda device: "cpu")
    monkeypatch.setattr(train, "SIMPLE_STEPS", 2)
    figures = train.measure(200, 40, 30, 1, steps=2, warm_up=1)
    assert figures["step_ms"] > 0 and figures["simple_step_ms"] > 0 and figures["visible"] > 0


@needs_gsplat
def test_the_plain_step_learns(monkeypatch: pytest.MonkeyPatch) -> None:
    import torch

    stand_in(monkeypatch)
    camera, g = inside_view(32, 24), random_room(150)
    white = np.full((24, 32, 3), 255, np.uint8)
    losses: list[float] = []
    backward = torch.Tensor.backward

    def heard(tensor: torch.Tensor, *given: object, **named: object) -> None:
        losses.append(float(tensor.detach()))
        backward(tensor, *given, **named)

    monkeypatch.setattr(torch.Tensor, "backward", heard)
    train.measure_simple_step(g, [camera], [white], "cpu", steps=12)
    assert losses[-1] < losses[0]


@pytest.mark.parametrize("verb", [["bench", "train"], ["bench", "render"]])
def test_a_measurement_of_a_card_that_is_not_there_is_refused(
    verb: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(choice, "missing_for_gsplat", lambda: "PyTorch sees no CUDA card")
    assert main([*verb, "--device", "cuda", "--json"]) == 2
    assert "no CUDA card" in capsys.readouterr().err


@needs_gsplat
def test_ten_minutes_on_a_card_compare_images_gradients_and_statistics(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch)
    rows = on_a_card().agreement("cpu", 300, 40, 30)
    assert len(rows) == 6
    for row in rows:
        assert min(row["psnr_db"], row["depth_db"]) > 40 and row["seen_share"] == 1.0
        assert max(value for name, value in row.items() if name.endswith("_error")) < 0.05


def test_ten_minutes_on_a_card_go_on_after_a_failure_and_say_what_they_left_out() -> None:
    def broken() -> None:
        raise ValueError("no")

    measured = on_a_card().measured
    found, failed, left = measured([("a", broken), ("b", lambda: 1)], time.monotonic() + 60)
    assert (found, failed, left) == ({"b": 1}, {"a": "ValueError: no"}, [])
    assert measured([("a", broken)], time.monotonic() - 1) == ({}, {}, ["a"])


def test_ten_minutes_on_a_card_need_a_card(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    script = on_a_card()
    monkeypatch.setattr(script, "missing_for_gsplat", lambda: "PyTorch sees no CUDA card")
    monkeypatch.setattr(sys, "argv", ["on_a_card.py"])
    assert script.main() == 2
    assert "no CUDA card" in capsys.readouterr().err


def on_a_card() -> Any:
    path = Path(__file__).parents[1] / "benchmarks" / "on_a_card.py"
    spec = importlib.util.spec_from_file_location("on_a_card", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["on_a_card"] = module  # its dataclass looks itself up there
    spec.loader.exec_module(module)
    return module
