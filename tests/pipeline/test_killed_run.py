"""A run that is killed, and resumed, ends with the result of an undisturbed run."""

from __future__ import annotations

from pathlib import Path

import pytest

from nvsim.building import BuildingConfig, generate


def test_a_killed_run_resumes_and_ends_with_the_same_graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    import kill_and_resume

    building = BuildingConfig(size="small", width=160, height=120, step=0.8, turn=30.0, people=False)
    generate(tmp_path / "building", building)
    result = kill_and_resume.measure(tmp_path / "building" / "capture", tmp_path, kills=2, seed=5, steps=60)
    # On a machine that is busy at times, a moment that was drawn may lie behind the end of the run.
    assert result["killed_in"] and result["nodes"] > 2, result
    assert result["same_graph"], result
