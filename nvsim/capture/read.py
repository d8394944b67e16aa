"""The door for captures: recognises the format of a path, reads it, aligns it. Writes nothing."""

from __future__ import annotations

from pathlib import Path

from nvsim.capture.alignment import align, apply
from nvsim.capture.colmap import read_colmap
from nvsim.capture.far_frames import without
from nvsim.capture.findings import Findings, shown
from nvsim.capture.kapture import find_kapture, read_kapture
from nvsim.capture.multi_capture import read_several
from nvsim.capture.nerfstudio import read_nerfstudio
from nvsim.capture.raw import LOST_FRAME, RawCapture, RawFrame, file_size
from nvsim.capture.recognition import CaptureFolder, format_of_file
from nvsim.capture.types import Alignment, Capture
from nvsim.errors import InputError
from nvsim.files.reading import reading

FORMATS = (
    "a transforms.json (nerfstudio, instant-ngp), a COLMAP model (cameras, images, points3D as .bin or .txt), a "
    "kapture tree (sensors/sensors.txt), or a file NAME.captures that lists several in one world"
)


def read(
    path: Path,
    *,
    scale: float | None = None,
    camera_height: float | None = None,
    alignment: Alignment | None = None,
    leave_out: str = "",
) -> Capture:
    """The capture at `path`, a folder or a file of it, in the aligned frame.

    scale          metres per unit of the source, when the source does not know
    camera_height  metres of the cameras above the floor; gives the scale of a source that has none
    alignment      known already, so that nothing is estimated
    leave_out      names of frames that are left out, with commas between them

    A capture of unknown scale still loads, with `alignment.scale_known` False. Raises InputError that names every
    error found, missing and empty images among them; images are not decoded (`check` does that).
    """
    findings = Findings()
    raw = without(read_raw(path, findings), leave_out, findings)
    for frame in raw.frames:
        report_absent_image(frame, findings)
    findings.raise_errors(path)
    if alignment is None:
        alignment, _ = align(raw, scale, camera_height, findings)
    return apply(raw, alignment)


def read_raw(path: Path, findings: Findings) -> RawCapture:
    """The capture as its files say it. What is wrong goes to `findings`; raises InputError when nothing can be read."""
    path = Path(path)
    try:
        resolved = path.expanduser().resolve()
        exists, is_folder = resolved.exists(), resolved.is_dir()
        is_empty = is_folder and next(resolved.iterdir(), None) is None
    except (OSError, ValueError, RuntimeError) as error:
        reason = error.strerror if isinstance(error, OSError) else shown(error)
        raise InputError(f"{shown(path)} cannot be opened ({reason}); check the path.") from error
    if not exists:
        raise InputError(f"{shown(path)} does not exist; check the path.")
    if is_empty:
        raise InputError(f"{shown(path)} is an empty folder; a capture is {FORMATS}.")
    with reading(path, "a capture"):
        raw = _read_folder(resolved, findings) if is_folder else _read_file(resolved, findings)
        return _settled(raw, findings)


def report_absent_image(frame: RawFrame, findings: Findings) -> bool:
    """Whether the image is missing or empty, which becomes an error finding."""
    size = file_size(frame.image_path)
    if size is None:
        findings.error("the image is missing", frame.where, f"{LOST_FRAME}; looked for {frame.image_path}")
    elif size == 0:
        findings.error("the image is empty (0 bytes)", frame.where, LOST_FRAME)
    return not size


def _read_file(path: Path, findings: Findings) -> RawCapture:
    format = format_of_file(path)
    if format == "nerfstudio":
        return read_nerfstudio(path, findings)
    if format == "several":
        return read_several(path, read_raw, findings)
    if format == "colmap":
        return read_colmap(path.parent, path.parent, findings)
    if format == "kapture" and (root := find_kapture(path.parent)) is not None:
        return read_kapture(root, findings)
    raise InputError(f"{shown(path)} is not a capture; name the folder of {FORMATS}.")


def _read_folder(folder: Path, findings: Findings) -> RawCapture:
    """kapture, transforms.json or COLMAP. Where a folder has the last two, they tell of the same walk, and the one that
    brings a cloud says more."""
    found = CaptureFolder.of(folder)
    if found.kapture is not None:
        return read_kapture(found.kapture, findings)
    transforms, model = found.transforms, found.model
    if transforms is not None:
        if model is None:
            return read_nerfstudio(transforms, findings)
        own = Findings()
        raw = read_nerfstudio(transforms, own)
        if raw.cloud is not None:
            for finding in own:
                findings.add(finding)
            return raw
        findings.note(
            "transforms.json has no point cloud and a COLMAP model lies beside it",
            folder.name,
            "the COLMAP model is read; name transforms.json to read that instead",
        )
    if model is not None:
        return read_colmap(model, folder, findings)
    if (folder / "sensors").is_dir():
        raise InputError(f"{folder / 'sensors' / 'sensors.txt'} is missing; a kapture capture needs it.")
    raise InputError(f"{shown(folder)} holds no capture that is known; a capture is {FORMATS}.")


def _settled(raw: RawCapture, findings: Findings) -> RawCapture:
    """The capture with findings about the list of frames as a whole: none, some without pose, names twice."""
    if not raw.frames:
        findings.error("the capture lists no frame", raw.source.name, "there is nothing to work on")
    seen: dict[str, RawFrame] = {}
    for frame in raw.frames:
        if frame.name in seen:
            findings.error(
                "the image is listed twice", f"{frame.where} and {seen[frame.name].where}", "its pose is ambiguous"
            )
        seen.setdefault(frame.name, frame)
    if raw.format == "kapture" and raw.frames:
        unposed = [f for f in raw.frames if f.camera_to_world is None]
        for frame in unposed:
            findings.warning("the frame has no pose at its timestamp", frame.where, "the frame is left out")
        if len(unposed) == len(raw.frames):
            findings.error("no frame has a pose", "trajectories.txt", "no frame can be placed")
    return raw
