"""Compute camera poses for a video, so that it becomes a capture: frames, focal length, poses and points.

The output folder is an ordinary COLMAP capture. `nvsim run FOLDER --project PROJECT --camera-height 1.4` continues with
it. The unit of the poses is unknown, so the height of the camera above the floor sets the scale.
"""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from nvsim.cli.console import listening
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Progress, Warning

STAGE = "poses"
_FEWEST = 0.5  # share of the chosen frames that must have a pose
_NAMED = 20


@dataclass(frozen=True)
class Arguments:
    source: Annotated[Path, tyro.conf.Positional]
    """A video (MP4, MOV, MKV, WebM), or a folder of videos of one building by one camera."""
    out: Path
    """The folder for frames, poses and report. An interrupted run continues there."""
    json: bool = False
    """Print typed events, and the result, as JSON."""


def run(arguments: Arguments) -> int:
    with listening(arguments.json) as listen:
        return _run(arguments.source, arguments.out, listen)


def _run(source: Path, out: Path, listen: Listener) -> int:
    from nvsim.files import atomic
    from nvsim.footage.extraction import extract_frames
    from nvsim.footage.sources import need_footage
    from nvsim.poses.from_images import find_poses
    from nvsim.poses.image_set import ImageSet, UnknownCamera
    from nvsim.poses.tracks import Tracks

    started = time.monotonic()
    footage = need_footage(source)
    if footage.kind != "video":
        raise InputError(
            f"{source} holds photographs; `nvsim poses` computes poses of videos only, so use COLMAP for photographs."
        )
    frames = extract_frames(footage, out / "images", lambda done, total: listen(Progress(STAGE, done, total, "frames")))
    blurred = int(np.count_nonzero(frames.blurred))
    listen(Log(f"{len(frames.names)} of {frames.looked_at} frames are used; {blurred} of them are blurred.", STAGE))
    points = np.unique(frames.point, return_inverse=True)[1].astype(np.int64)
    images = ImageSet(
        frames.folder,
        frames.names,
        (UnknownCamera(frames.width, frames.height),),
        np.zeros(len(frames.names), np.int64),
        frames.clips,
        True,
        Tracks(points, frames.frame, frames.places),
    )
    work = atomic.make_folder(out / "work")
    found = find_poses(images, work, lambda step, done, total: listen(Progress(STAGE, done, total, step)))
    used = found.model.num_reg_images()
    report = {
        "frames": len(frames.names),
        "with_pose": used,
        "blurred": blurred,
        "pieces": found.pieces,
        "focal_px": found.focal,
        "residual_px": round(found.residual, 3),
        "loops": found.loops,
        "left_out": found.left_out,
        "seconds": round(time.monotonic() - started, 1),
    }
    if used < _FEWEST * len(frames.names):
        raise InputError(
            f"Only {used} of {len(frames.names)} frames of {source} hold together (pieces of "
            f"{', '.join(map(str, found.pieces[:6]))} frames); film more slowly, turn on the spot less, and keep "
            "furniture or other texture in view."
        )
    written = atomic.make_folder(work / "model")
    found.model.write(written)
    atomic.make_folder(out / "sparse" / "0")
    for file in sorted(written.iterdir()):
        atomic.write_bytes(out / "sparse" / "0" / file.name, file.read_bytes())
    atomic.write_text(out / "poses.json", json.dumps(report, indent=1))
    shutil.rmtree(work, ignore_errors=True)
    if found.left_out:
        names = ", ".join(found.left_out[:_NAMED]) + (", ..." if len(found.left_out) > _NAMED else "")
        listen(Warning(f"{len(found.left_out)} frames have no pose: {names}.", STAGE))
    summary = (
        f"{used} of {len(frames.names)} frames have a pose; continue with `nvsim run {out} --camera-height METERS`"
    )
    listen(Done(STAGE, summary, report))
    return 0
