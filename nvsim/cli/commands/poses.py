"""Compute camera poses for a video, so that it becomes a capture: frames, focal length, poses and points.

The output folder is an ordinary COLMAP capture. `nvsim run FOLDER --project PROJECT --camera-height 1.4` continues with
it. `nvsim run VIDEO` does both. The unit of the poses is unknown, so the height of the camera above the floor sets the
scale.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from nvsim.cli.console import listening
from nvsim.events import Log


@dataclass(frozen=True)
class Arguments:
    source: Annotated[Path, tyro.conf.Positional]
    """A video (MP4, MOV, MKV, WebM), or a folder of videos of one building by one camera."""
    out: Path
    """The folder for frames, poses and report. An interrupted run continues there."""
    json: bool = False
    """Print typed events, and the result, as JSON."""


def run(arguments: Arguments) -> int:
    from nvsim.reconstruction.computing import compute_poses
    from nvsim.reconstruction.report import rows

    out = arguments.out.expanduser()
    with listening(arguments.json) as listen:
        report = compute_poses(arguments.source.expanduser(), out, listen)
        for name, words in rows(report).items():
            listen(Log(f"{name}: {words}", "poses"))
        listen(Log(f"Continue with `nvsim run {out} --project NAME.nvsim --camera-height METERS`.", "poses"))
    return 0
