"""Describe a folder that is not a capture: an export of another program, images without poses, or videos."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

from nvsim.capture.multi_capture import SUFFIX
from nvsim.capture.unused_images import IMAGE_ENDINGS
from nvsim.errors import shown

_OTHER_PROGRAMS = (
    ("keyframes/cameras", "a raw Polycam export", "ns-process-data polycam"),
    ("keyframes/corrected_cameras", "a raw Polycam export", "ns-process-data polycam"),
    ("keyframes", "a raw Polycam export", "ns-process-data polycam"),
    ("rgbd", "a Record3D export", "ns-process-data record3d"),
    ("EXR_RGBD", "a Record3D export", "ns-process-data record3d"),
    ("meta_data.json", "a capture of SDFStudio", "SDFStudio's scripts, to a transforms.json"),
    ("reconstruction.json", "an OpenSfM reconstruction", "OpenSfM's export_colmap"),
    ("poses_bounds.npy", "a capture of LLFF", "colmap on its images"),
    ("cameras.sfm", "a Meshroom reconstruction", "ns-process-data or Meshroom's export to COLMAP"),
    ("cameras.xml", "a Metashape project", "Metashape's export to COLMAP, or ns-process-data metashape"),
)
"""A path in a folder, its description, and the program that converts it to a capture."""
_VIDEO_ENDINGS = frozenset({".mp4", ".mov", ".avi", ".mkv", ".webm", ".insv", ".360"})
_ALL_AROUND = frozenset({".insv", ".360"})
_MOST = 100_000  # files that are counted


def seen_in(path: Path) -> str:
    """A sentence about the actual content of `path`, which is not a capture; "" if the content is unknown."""
    if not path.is_dir():
        return _video(path) if path.suffix.lower() in _VIDEO_ENDINGS else ""
    if sentence := export_in(path):
        return sentence
    lists = sorted(p.name for p in path.glob(f"*{SUFFIX}"))
    if lists:
        return f"{shown(path)} holds a list of captures; name the file itself ({shown(lists[0])})."
    endings = _endings(path)
    images = sum(endings[ending] for ending in IMAGE_ENDINGS)
    videos = sum(endings[ending] for ending in _VIDEO_ENDINGS)
    if images:
        found = f"{shown(path)} holds no capture: {images} {'image' if images == 1 else 'images'}, but no poses"
        return f"{found}; name the folder that holds the images, and NVSim computes their poses."
    if videos:
        words = "a video" if videos == 1 else f"{videos} videos"
        return f"{shown(path)} holds no capture: {words}, but no poses; name the folder that holds the video."
    return ""


def _video(path: Path) -> str:
    if path.suffix.lower() in _ALL_AROUND:
        return f"{shown(path)} is a 360 degree video, which NVSim reads as equirectangular MP4; export it as such."
    return (
        f"{shown(path)} is a video without camera poses; if it is one of several, put all of them into one "
        "folder and name that folder."
    )


def export_in(folder: Path) -> str:
    """A sentence about the export of another program in `folder`; "" if there is none."""
    for inside, what, convert in _OTHER_PROGRAMS:
        if (folder / inside).exists():
            return f"{shown(folder)} is {what} ({inside}), which NVSim does not read; convert it with {convert}."
    return ""


def _endings(path: Path) -> Counter[str]:
    """Number of files in and below `path` for each file extension, in lower case."""
    found: Counter[str] = Counter()
    for _, folders, files in os.walk(path):
        folders[:] = [folder for folder in folders if not folder.startswith(".")]
        found.update(os.path.splitext(name)[1].lower() for name in files)
        if found.total() > _MOST:
            break
    return found
