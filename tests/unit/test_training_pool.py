"""How submaps share cores and memory when several are trained at once."""

from __future__ import annotations

from nvsim.project.stages.training_pool import TrainingTask, count_that_fit, needed_bytes, plan
from nvsim.training.config import TrainingConfig


def test_every_submap_gets_its_share_and_the_rest_gets_all() -> None:
    assert plan([0, 1, 2], 2, 2) == [TrainingTask(0, 1, False), TrainingTask(1, 1, False), TrainingTask(2, 2, True)]
    assert plan([4, 7], 8, 3) == [TrainingTask(4, 4, False), TrainingTask(7, 4, False)]
    assert plan([5], 4, 4) == [TrainingTask(5, 4, True)]
    assert plan([0, 1], 4, 1) == [TrainingTask(0, 4, True), TrainingTask(1, 4, True)]


def test_as_many_as_fit_into_memory_but_one_in_any_case() -> None:
    each = needed_bytes(200, 540 * 360, TrainingConfig(gaussian_cap=200_000))
    assert 1 << 30 < each < 2 << 30
    assert count_that_fit(16 << 30, each) > 3
    assert count_that_fit(1 << 30, each) == 1
