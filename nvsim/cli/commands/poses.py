"""Compute camera poses for a video or photographs, so that they become a capture: images, focal length, poses, points.

The output folder is an ordinary COLMAP capture. `nvsim run FOLDER --project PROJECT --camera-height 1.4` continues with
it. `nvsim run VIDEO` does both. The unit of the poses is unknown, so the height of the camera above the floor sets the
scale. If there is an ARKit or GPS log next to the images, the log sets the scale.
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
    """A video (MP4, MOV, MKV, WebM), a folder of videos of one building by one camera, or a folder of photographs.
    Images of a 360 degree camera are equirectangular (twice as wide as high), or its sides: side0.mp4, side1.mp4, ...
    A transforms.json of posed panoramas (camera_model EQUIRECTANGULAR) is cut into perspective views."""
    out: Path
    """The folder for frames, poses and report. An interrupted run continues there."""
    views: int | None = None
    """Number of views into which panoramas of a 360 degree camera are cut: 4 level ones, 8 with four more that look 45
    degrees down, or 12 with four more that look 45 degrees up. Default: the number of the previous run, else 4."""
    mask: str = ""
    """A PNG file with the proportions of the panoramas, whose black pixels are ignored. It replaces the mask of the
    camera carrier that NVSim computes."""
    json: bool = False
    """Print events and the result as JSON."""


def run(arguments: Arguments) -> int:
    from nvsim.footage.cut_options import cut_options
    from nvsim.reconstruction.computing import compute_poses
    from nvsim.reconstruction.posed_panoramas import cut_posed_panoramas, find_posed_panoramas
    from nvsim.reconstruction.report import rows

    out, source = arguments.out.expanduser(), arguments.source.expanduser()
    panoramas = find_posed_panoramas(source)
    options = cut_options(arguments.views, arguments.mask)
    with listening(arguments.json) as listen:
        if panoramas is not None:
            cut_posed_panoramas(panoramas, out, listen, options)
            listen(Log(f"Continue with `nvsim run {out} --project NAME.nvsim`.", "poses"))
            return 0
        report = compute_poses(source, out, listen, options=options)
        for name, words in rows(report).items():
            listen(Log(f"{name}: {words}", "poses"))
        is_measured = any(not measured.refused for measured in report.measured[:1])
        scale = "" if is_measured else " --camera-height METERS"
        listen(Log(f"Continue with `nvsim run {out} --project NAME.nvsim{scale}`.", "poses"))
    return 0
