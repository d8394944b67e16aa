"""Finds the output folder of a job."""

from __future__ import annotations

import os
from pathlib import Path

from nvsim.cli.arguments import given
from nvsim.files.opening import is_folder
from nvsim.project.jobs.joblist import Job
from nvsim.project.work import EXPORTS


def folder_of(job: Job) -> Path | None:
    """The output folder of an export job of this user. None for other jobs, and if the folder does not exist yet."""
    if job.order.verb not in EXPORTS or not job.ours:
        return None
    words = list(job.order.arguments)
    named = given(words, "--out", "")
    if not named and job.order.verb == "export features":
        named = os.path.join(given(words, "--folder", ""), "features")
    folder = Path(named).absolute()
    return folder if named and "\0" not in named and is_folder(folder) else None
