"""One table of the work on a project, from which the command line, the jobs and the pipeline read."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from nvsim.cli.main import COMMANDS
from nvsim.errors import InputError
from nvsim.files.records import record_of
from nvsim.project import pipeline
from nvsim.project.config import CaptureConfig, RunConfig
from nvsim.project.jobs.files import JobStatus
from nvsim.project.jobs.joblist import JobList
from nvsim.project.project import Project
from nvsim.project.stages import depths, floors, imported, mapped, submaps, trained
from nvsim.project.state.results import CONTENT, StagePart, StageResult, StageResults, first_outdated_stage
from nvsim.project.work import FROM_A_CUT, PIPELINE, STAGE, STAGES, WORK, sentence


def test_every_work_is_a_command_that_helps_with_the_words_of_the_table() -> None:
    assert {verb: COMMANDS[verb][1] for verb in WORK} == {verb: row.summary for verb, row in WORK.items()}


def test_a_stage_needs_the_one_before_it_and_depth_may_be_left_out() -> None:
    needed = [stage for stage in STAGES if stage != "depth"]
    assert [WORK[stage].needs for stage in needed] == [None, *needed[:-1]]
    assert WORK["depth"].needs == "import"
    assert STAGES[1:] == PIPELINE


def test_the_modules_of_the_stages_call_themselves_by_the_names_of_the_table() -> None:
    assert tuple(m.STAGE for m in (imported, submaps, depths, floors, trained, mapped)) == STAGES


def test_the_main_job_runs_the_stages_in_the_order_of_the_table(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    ran: list[str] = []
    for module in (mapped, trained, floors, depths, submaps, imported):
        monkeypatch.setattr(module, "run", lambda *_, name=module.STAGE, **__: ran.append(name))
    with Project.create_or_open(tmp_path / "house.nvsim") as project:
        pipeline.run(project, tmp_path, CaptureConfig(), RunConfig(), lambda _: None)
    assert tuple(ran) == STAGES


@pytest.mark.parametrize("verb", WORK)
def test_what_the_window_may_order_can_be_a_job(verb: str, tmp_path: Path) -> None:
    assert JobList(tmp_path / "house.nvsim").add(verb, [], WORK[verb].title).order.verb == verb


@pytest.mark.parametrize("verb", ["app", "bench train", "graph edit", "run"])
def test_nothing_else_can_be_a_job(verb: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be a job"):
        JobList(tmp_path / "house.nvsim").add(verb, [], "Anything")


def test_what_is_said_of_a_stage_is_whole() -> None:
    for stage in PIPELINE:
        assert STAGE[stage].outdated().endswith(".") and STAGE[stage].missing.endswith("yet")
    assert FROM_A_CUT == ("floors", "train")
    assert sentence(STAGE["submaps"].missing) == "The trajectory is not divided into submaps yet."


def test_the_first_stale_stage_is_the_one_to_run_again() -> None:
    assert first_outdated_stage(frozenset(), frozenset()) is None
    assert first_outdated_stage(frozenset({"map", "train"}), frozenset({"floors"})) == (
        "floors",
        STAGE["floors"].from_previous_cut,
    )
    assert first_outdated_stage(frozenset({"map", "floors"}), frozenset({"floors"})) == (
        "floors",
        "The capture has changed since the floor was found.",
    )
    assert first_outdated_stage(frozenset({"map"}), frozenset(), "splat") == (
        "map",
        "The splat has changed since the map was built.",
    )


def test_a_result_is_outdated_if_it_was_computed_from_another_capture_than_the_one_in_use() -> None:
    def result(made_from: str, at: float) -> StageResult:
        return StageResult({0: StagePart("k", 1.0, at, json.dumps({CONTENT: made_from}))})

    def imported(key: str, at: float) -> StageResults:
        return found.with_result("in use", "import", StageResult({0: StagePart(key, 1.0, at)}))

    found = StageResults().with_result("in use", "floors", result("A", 20.0))
    assert imported("A", 10.0).outdated("A") == frozenset()
    assert imported("A", 40.0).outdated("A") == frozenset(), "it was imported again, without a change"
    assert imported("B", 30.0).outdated("B") == {"floors"}
    found = found.with_result("in use", "map", result("B", 35.0))
    assert imported("A", 10.0).outdated("A") == {"map"}, "the earlier capture was restored"
    assert imported("A", 10.0).outdated("") == frozenset()


def test_what_ended_before_the_import_is_outdated_in_projects_of_earlier_versions(tmp_path: Path) -> None:
    with Project.create_or_open(tmp_path / "house.nvsim") as project:
        found = project.stage_results()
        assert found == StageResults()
        for stage, at in (("import", 20.0), ("submaps", 10.0), ("floors", 30.0)):
            found = found.with_result("in use", stage, StageResult({0: StagePart("k", 1.0, at)}))
        project.set_stage_results(found)
        assert project.stage_results() == found
    assert found.finished_stages == {"import", "submaps", "floors"} and found.outdated("k") == {"submaps"}


def test_the_help_loads_nothing_heavy() -> None:
    code = "import sys, nvsim.cli.main; print(*sorted({'numpy', 'torch', 'dataclasses', 'sqlite3'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == ""


def test_a_number_that_is_text_with_control_characters_is_named_in_one_printable_line() -> None:
    with pytest.raises(ValueError) as raised:
        record_of(JobStatus, {"state": "done", "worked": "\x00\x1b[31m\n" * 30})
    assert str(raised.value).isprintable() and len(str(raised.value)) < 100
