"""Compute the poses of a 360 degree capture: choose panoramas, cut them into views, and estimate poses of rigs."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nvsim.events import Log
from nvsim.footage.cut_options import CutOptions
from nvsim.footage.sources import Footage, says_spherical
from nvsim.reconstruction.report import SETTINGS, PosesReport, Stamp

if TYPE_CHECKING:
    import pycolmap


def pose_panoramas(
    footage: Footage,
    options: CutOptions,
    stamp: Stamp,
    images: Path,
    work: Path,
    report_progress: Callable[[str, int, int], None],
    say: Callable[[Log], None],
) -> tuple[PosesReport, pycolmap.Reconstruction]:
    """Computes the poses of panoramas. Returns the report and the reconstruction.

    Views are written to `images`, their masks to a folder next to it, and intermediate files to `work`. Raises
    InputError if the files cannot be decoded, do not match, or have too little in common."""
    from nvsim.footage.panoramas import extract_panoramas
    from nvsim.footage.views import nearest_pixels

    started = time.monotonic()
    if not footage.sides and not says_spherical(footage.files[0]):
        say(Log(f"{footage.files[0].name} is twice as wide as high, so it is read as a 360 degree panorama.", "poses"))
    found = extract_panoramas(footage, images, options, lambda done, total: report_progress("frames", done, total))
    blurred = int(np.count_nonzero(found.blurred))
    views, count = found.views, len(found.names)
    say(
        Log(
            f"{count} of {found.looked_at} panoramas are used, each as {views.count} views of {views.size} x "
            f"{views.size} pixels; {blurred} of them are blurred.",
            "poses",
        )
    )
    if found.masks:
        say(Log(f"{found.masked:.1f} % of the pixels of the views are masked.", "poses"))
    usable = nearest_pixels(views)
    if found.masks:
        usable = [own & mask for own, mask in zip(usable, found.masks, strict=True)]
    from nvsim.poses.image_set import ImageSet, RigOfViews, UnknownCamera, times_of
    from nvsim.poses.rigs import find_rig_poses

    times = times_of(found.seconds, found.clips)
    camera = UnknownCamera(views.size, views.size, views.focal)
    posed, pieces = find_rig_poses(
        ImageSet(
            found.folder,
            tuple(view for name in found.names for view in views.names(name)),
            (camera,) * views.count,
            np.tile(np.arange(views.count), count),
            np.repeat(found.clips, views.count),
            np.repeat(times if footage.kind == "video" else times[:0], views.count),
            rig=RigOfViews(views.turns, np.repeat(np.arange(count), views.count)),
            usable=tuple(usable),
        ),
        work,
        report_progress,
    )
    report = PosesReport(
        source=str(footage.source.absolute()),
        footage=footage.description if footage.sides else f"{footage.description} of a 360 degree camera",
        stamp=stamp,
        settings=SETTINGS,
        looked_at=found.looked_at,
        frames=count,
        blurred=blurred,
        with_pose=pieces[0],
        pieces=pieces,
        focal_px=(round(views.focal, 2),),
        size_px=(views.size, views.size),
        residual_px=round(posed.residual, 3),
        loops=posed.loops,
        left_out=tuple(name.partition("/")[2] for name in posed.left_out),
        seconds=round(time.monotonic() - started, 1),
        views=views.count,
        upright=posed.upright,
        masked=found.masked,
        mask=options.stamp,
    )
    return report, posed.model
