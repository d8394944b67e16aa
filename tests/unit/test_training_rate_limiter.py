"""Checkpoints cost a training little, and the loss of its machine little more."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nvsim.training import trainer
from nvsim.training.checkpoint import RateLimiter
from nvsim.training.config import TrainingConfig
from nvsim.training.synthetic import synthetic_room
from nvsim.training.trainer import train_submap


def times(limiter: RateLimiter, cost: float, until: float) -> list[float]:
    """When something that takes `cost` seconds is begun, asked for every 0.1 s."""
    found, now = [], 0.0
    while now < until:
        if limiter.is_due(now):
            found.append(now)
            limiter.record_run(now, now + cost)
            now += cost
        now += 0.1
    return found


@pytest.mark.fast
@pytest.mark.parametrize(("cost", "pause"), [(0.0, 3.0), (0.02, 3.0), (0.2, 10.0), (5.0, 15.0)])
def test_what_costs_little_is_done_often_and_what_costs_much_seldom_but_in_time(cost: float, pause: float) -> None:
    found = times(RateLimiter(0.0, 3.0, 0.02, 15.0), cost, 200.0)
    assert found[0] == pytest.approx(3.0, abs=0.11)
    assert np.diff(found) == pytest.approx(np.full(len(found) - 1, pause + cost), abs=0.11)
    if pause < 15:
        assert cost * len(found) <= 0.02 * 200 + cost


@pytest.mark.fast
def test_what_shall_be_done_all_the_time_is_and_the_first_time_may_be_at_once() -> None:
    assert RateLimiter(0.0, 3.0, 0.02, 0.0).is_due(0.0)
    assert RateLimiter(-math.inf, 5.0).is_due(0.0)
    assert not RateLimiter(0.0, 5.0).is_due(4.9)


def test_a_training_is_saved_every_few_seconds_where_that_costs_next_to_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, saved = [0.0], list[float]()

    class Clock:
        time, monotonic = staticmethod(lambda: 0.0), staticmethod(lambda: clock[0])

    class Run(trainer._TrainingRun):
        def _advance(self) -> trainer.LossValues:
            clock[0] += 0.5
            return super()._advance()

        def _save(self, path: Path) -> None:
            saved.append(clock[0])
            super()._save(path)

    monkeypatch.setattr(trainer, "time", Clock)
    monkeypatch.setattr(trainer, "_TrainingRun", Run)
    room = synthetic_room(4, 64, 48, 400)
    config = replace(TrainingConfig(), steps=20, gaussian_cap=500, checkpoint_seconds=15.0)
    train_submap(room.views, room.cloud, room.floor, config, checkpoint=tmp_path / "submap.ckpt")
    assert saved == [3.0, 6.0, 9.0, 10.0]  # the last at the end


def test_a_process_that_trains_reads_no_library_of_symbols() -> None:
    program = (
        "import sys; from dataclasses import replace; from nvsim.training.config import TrainingConfig;"
        "from nvsim.training.synthetic import synthetic_room; from nvsim.training.trainer import train_submap;"
        "room = synthetic_room(4, 64, 48, 400);"
        "config = replace(TrainingConfig(), steps=2, gaussian_cap=500, device='cpu');"
        "train_submap(room.views, room.cloud, room.floor, config); sys.exit('sympy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], timeout=120).returncode == 0
