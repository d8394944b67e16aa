"""The table of capture formats and their readers. A new reader is one file and one row in this table."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from nvsim.capture import colmap, kapture, multi_capture, nerfstudio, pose_files, trajectory_files
from nvsim.capture.colmap_layout import child_folders, model_named
from nvsim.capture.findings import Findings
from nvsim.capture.image_folder import IMAGE_ENDINGS, find_moved_measurements
from nvsim.capture.multi_capture import SUFFIX
from nvsim.capture.raw import RawCapture, RawFrame
from nvsim.errors import InputError, value_text
from nvsim.files.opening import PROJECT_DATABASE, is_regular
from nvsim.files.reading import reading

_OTHER_PROGRAMS = (
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
_MOST_FILES = 100_000  # files that are counted


def describe_content(path: Path) -> str:
    """A sentence about the actual content of `path`, which is not a capture; "" if the content is unknown."""
    if not path.is_dir():
        return _video(path) if path.suffix.lower() in _VIDEO_ENDINGS else ""
    if sentence := describe_export(path):
        return sentence
    lists = sorted(p.name for p in path.glob(f"*{SUFFIX}"))
    if lists:
        return f"{value_text(path)} holds a list of captures; name the file itself ({value_text(lists[0])})."
    endings = _count_extensions(path)
    images = sum(endings[ending] for ending in IMAGE_ENDINGS)
    videos = sum(endings[ending] for ending in _VIDEO_ENDINGS)
    if images:
        found = f"{value_text(path)} holds no capture: {images} {'image' if images == 1 else 'images'}, but no poses"
        return f"{found}; name the folder that holds the images, and NVSim computes their poses."
    if videos:
        words = "a video" if videos == 1 else f"{videos} videos"
        return f"{value_text(path)} holds no capture: {words}, but no poses; name the folder that holds the video."
    return ""


def _video(path: Path) -> str:
    if path.suffix.lower() in _ALL_AROUND:
        return f"{value_text(path)} is a 360 degree video, which NVSim reads as equirectangular MP4; export it as such."
    return (
        f"{value_text(path)} is a video without camera poses; if it is one of several, put all of them into one "
        "folder and name that folder."
    )


def describe_export(folder: Path) -> str:
    """A sentence about the export of another program in `folder`; "" if there is none."""
    for inside, what, convert in _OTHER_PROGRAMS:
        if (folder / inside).exists():
            return f"{value_text(folder)} is {what} ({inside}), which NVSim does not read; convert it with {convert}."
    return ""


def _count_extensions(path: Path) -> Counter[str]:
    """Number of files in and below `path` for each file extension, in lower case."""
    found: Counter[str] = Counter()
    for _, folders, files in os.walk(path):
        folders[:] = [folder for folder in folders if not folder.startswith(".")]
        found.update(os.path.splitext(name)[1].lower() for name in files)
        if found.total() > _MOST_FILES:
            break
    return found


_DEEPEST, _MOST = 3, 1000  # search depth in folders, and folders that are searched on each level
_LISTED = 10  # captures that a message names


def _complete(folder: Path) -> str:
    return ""


@dataclass(frozen=True)
class Format:
    """One file format of captures.

    name              for a list of names
    description       noun phrase for a sentence: "a capture is ..."
    find              a folder, or a file of it -> the argument of `read`, judged by file names only; None for other
                      formats
    read              (result of `find`, findings) -> the capture. Tolerable problems are added to the findings. Raises
                      InputError if nothing can be read
    preferred_format  name of the format that is read instead if both are present and this one has no point cloud
    explain_missing   a folder or file without a recognized format -> a sentence about the missing parts of this format;
                      "" if it does not resemble this format
    """

    name: str
    description: str
    find: Callable[[Path], Path | None]
    read: Callable[[Path, Findings], RawCapture]
    preferred_format: str = ""
    explain_missing: Callable[[Path], str] = _complete


def _read_list(path: Path, findings: Findings) -> RawCapture:
    return multi_capture.read_several(path, read_raw, findings)


FORMATS: tuple[Format, ...] = (
    Format(
        "kapture",
        "a kapture tree (sensors/sensors.txt)",
        kapture.find,
        kapture.read,
        explain_missing=kapture.explain_missing,
    ),
    Format(
        "nerfstudio transforms.json",
        "a transforms.json (nerfstudio, instant-ngp) or transforms_train.json (Blender)",
        nerfstudio.find,
        nerfstudio.read,
        explain_missing=nerfstudio.explain_missing,
        preferred_format="COLMAP",  # the one of both with a point cloud has more information
    ),
    Format("a .captures list", "a file NAME.captures that lists several in one world", multi_capture.find, _read_list),
    Format(
        "COLMAP",
        "a COLMAP model (cameras, images, points3D as .bin or .txt)",
        colmap.find,
        colmap.read,
        explain_missing=colmap.explain_missing,
    ),
    Format(
        "Polycam",
        "a raw export of Polycam (keyframes/cameras)",
        pose_files.find_polycam,
        pose_files.read_polycam,
        explain_missing=pose_files.explain_missing_polycam,
    ),
    Format(
        "RGB-D",
        "an RGB-D recording with pose files (frame-000000.pose.txt, or pose/0.txt)",
        pose_files.find_depth_recording,
        pose_files.read_depth_recording,
    ),
    Format(
        "TUM RGB-D",
        "a recording in TUM's format (rgb.txt and groundtruth.txt)",
        trajectory_files.find_tum,
        trajectory_files.read_tum,
    ),
    Format(
        "ARKitScenes",
        "a recording of ARKitScenes (lowres_wide and lowres_wide.traj)",
        trajectory_files.find_arkit,
        trajectory_files.read_arkit,
    ),
    Format(
        "Replica",
        "a Replica scene of NICE-SLAM (results and traj.txt)",
        trajectory_files.find_replica,
        trajectory_files.read_replica,
    ),
)
"""In the order of the search. The first format that matches is read."""


def names() -> str:
    """The formats for a title: "A, B or C"."""
    return _list_names([format.name for format in FORMATS])


def formats_in_words() -> str:
    """The formats for a sentence: "a ..., a ... or a ..."."""
    return _list_names([format.description for format in FORMATS])


def is_capture(path: Path) -> bool:
    """Whether a folder or a file is recognized as a capture, by the names of its files only."""
    return any(format.find(path) is not None for format in FORMATS)


def resembles_capture(path: Path) -> bool:
    """Whether `path` holds a capture, several captures, a part of one, or the export of another program. Only the names
    of files are checked."""
    if not path.is_dir():
        return is_capture(path)
    if describe_export(path):
        return True
    level = [path]
    for depth in range(_DEEPEST + 1):
        if any(is_capture(folder) for folder in level):
            return True
        if depth < 2 and any(format.explain_missing(folder) for folder in level for format in FORMATS):
            return True
        level = _without_projects(level)
    return False


def read_raw(path: Path, findings: Findings, model: str = "") -> RawCapture:
    """The capture as stored in its files. Of several COLMAP models, `model` names the one to read.

    Problems are added to `findings`. Raises InputError if nothing can be read."""
    path = Path(path)
    try:
        resolved = path.expanduser().resolve()
        exists, is_folder = resolved.exists(), resolved.is_dir()
        is_empty = is_folder and next(resolved.iterdir(), None) is None
    except (OSError, ValueError, RuntimeError) as error:
        reason = error.strerror if isinstance(error, OSError) else value_text(error)
        raise InputError(f"{value_text(path)} cannot be opened ({reason}); check the path.") from error
    if not exists:
        raise InputError(f"{value_text(path)} does not exist; check the path.")
    if is_empty:
        raise InputError(f"{value_text(path)} is an empty folder; a capture is {formats_in_words()}.")
    with reading(path, "a capture"):
        place = _capture_in(resolved, findings)
        raw = _checked_capture(_read(model_named(place, model) if model else place, findings), findings)
        return find_moved_measurements(raw, findings)


def _capture_in(path: Path, findings: Findings) -> Path:
    """`path`, or if it is not a capture, the only capture in the folders below it. Raises InputError if there are
    several."""
    level = [path] if path.is_dir() and not is_capture(path) else []
    for _ in range(_DEEPEST):
        level = _without_projects(level)
        found = [folder for folder in level if is_capture(folder)]
        if len(found) == 1:
            message = f"{value_text(path.name)} is not a capture itself; the only one below it is read"
            findings.note(message, found[0].relative_to(path).as_posix(), "name that folder to be sure")
            return found[0]
        if found:
            names = ", ".join(value_text(folder.relative_to(path).as_posix()) for folder in found[:_LISTED])
            more = f" and {len(found) - _LISTED} more" if len(found) > _LISTED else ""
            raise InputError(
                f"{value_text(path)} holds {len(found)} captures in the folders below it ({names}{more}); name one "
                f"of them, or list them in a file NAME{multi_capture.SUFFIX} if they share one world."
            )
    return path


def _without_projects(folders: list[Path]) -> list[Path]:
    """The folders in `folders` except NVSim projects, whose content is not a capture of its own."""
    children = (child for folder in folders for child in child_folders(folder)[:_MOST])
    return [child for child in children if not is_regular(child / PROJECT_DATABASE)][:_MOST]


def _read(path: Path, findings: Findings) -> RawCapture:
    found = [(format, at) for format in FORMATS if (at := format.find(path)) is not None]
    if not found:
        raise _unknown_format_error(path)
    (first, at), *others = found
    for other, beside in others:
        if other.name == first.preferred_format:
            return _capture_with_cloud(first, at, other, beside, path, findings)
    return first.read(at, findings)


def _capture_with_cloud(
    first: Format, at: Path, other: Format, beside: Path, folder: Path, findings: Findings
) -> RawCapture:
    """The capture of `first` if it has a point cloud, otherwise the capture of `other`."""
    own = Findings()
    raw = first.read(at, own)
    if raw.cloud is None:
        findings.note(
            f"{at.name} has no point cloud and {other.description} is beside it",
            folder.name,
            f"the {other.name} capture is read; name {at.name} to read it instead",
        )
        return other.read(beside, findings)
    for finding in own:
        findings.add(finding)
    return raw


def _unknown_format_error(path: Path) -> InputError:
    for place in (path, *(child_folders(path)[:_MOST] if path.is_dir() else ())):
        for format in FORMATS:
            if sentence := format.explain_missing(place):
                return InputError(sentence)
    if sentence := describe_content(path):
        return InputError(f"{sentence} A capture is {formats_in_words()}.")
    if path.is_dir():
        return InputError(f"{value_text(path)} holds no capture; a capture is {formats_in_words()}.")
    return InputError(f"{value_text(path)} is not a capture; name the folder of {formats_in_words()}.")


def _checked_capture(raw: RawCapture, findings: Findings) -> RawCapture:
    """The capture. Findings report an empty list of frames, and names that occur twice."""
    if not raw.frames:
        findings.error("the capture lists no frame", raw.source.name, "there is nothing to work on")
    seen: dict[str, RawFrame] = {}
    for frame in raw.frames:
        if frame.name in seen:
            findings.error(
                "the image is listed twice", f"{frame.where} and {seen[frame.name].where}", "its pose is ambiguous"
            )
        seen.setdefault(frame.name, frame)
    return raw


def _list_names(parts: list[str]) -> str:
    return " or ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)
