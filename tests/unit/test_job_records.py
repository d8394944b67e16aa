"""What ran on a project from a terminal, as its database tells it."""

from pathlib import Path

import pytest

from nvsim.project.jobs.commands import JobJournal
from nvsim.project.project import Project


@pytest.mark.parametrize("state", ["done", "failed", "stopped"])
def test_a_job_that_ended_stands_as_it_ended(state: str, tmp_path: Path) -> None:
    with Project.create_or_open(tmp_path / "house.nvsim") as project:
        JobJournal(project.connection, "train", lambda _: None).end(state)  # type: ignore[arg-type]
        assert project.jobs()[0].state == state


def test_a_state_that_no_version_writes_counts_as_interrupted(tmp_path: Path) -> None:
    with Project.create_or_open(tmp_path / "house.nvsim") as project:
        JobJournal(project.connection, "train", lambda _: None)
        project.connection.execute("UPDATE jobs SET state = '<b>splendid</b>'")
        assert project.jobs()[0].state == "interrupted"
