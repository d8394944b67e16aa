"""Compute the camera poses of a video or of photos in a child process. The folder becomes a COLMAP capture.

pycolmap runs for minutes without returning to Python. A child process ends at once when the user stops the command, and
when its parent process ends. The extracted frames stay in the folder, so the next run continues with them.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Progress, Warning
from nvsim.files import atomic
from nvsim.files.opening import is_regular, read_json
from nvsim.files.reading import as_reading_error, reading
from nvsim.footage.cut_options import MASKS, CutOptions, refuse_mask_in_output, refuse_unless_cut
from nvsim.footage.sources import Footage, Stamp, is_panoramic, need_footage
from nvsim.plain_text import count_text
from nvsim.processes.child import Child
from nvsim.reconstruction.pose_networks import SAME_NETWORKS, Digest, PoseNetworks
from nvsim.reconstruction.report import (
    FRAMES,
    REPORT,
    SETTINGS,
    PosesReport,
    WeakPlace,
    read_report,
    stamp_of,
    write_report,
)

if TYPE_CHECKING:
    import pycolmap

STAGE = "poses"
IMAGES = "images"
_MODEL = "sparse"
WORK = ".poses"
"""Folder of intermediate files. It is hidden, so that no unfinished model is mistaken for a capture."""
_BEGUN = "begun.json"
_PERIOD = 0.1  # seconds between two progress events of one step, at least
_NAMED = 20
_STEPS = {
    "frames": (0.0, 0.35, "choose sharp frames and track points"),
    "photographs": (0.0, 0.35, "read photographs"),
    "people": (0.33, 0.35, "mask people"),
    "features": (0.35, 0.45, "find features"),
    "comparison": (0.45, 0.45, "compare the network with SIFT"),
    "matches": (0.45, 0.55, "match images"),
    "relative poses": (0.55, 0.7, "estimate poses of image pairs"),
    "mapping": (0.7, 0.9, "estimate poses of all images"),
    "loops": (0.9, 1.0, "close loops"),
}
"""For each step, the approximate share of the work at its start and at its end, and its name for users."""
_WHOLE = 1000  # units of progress


def compute_poses(
    source: Path,
    folder: Path,
    listen: Listener,
    chosen: bool = False,
    options: CutOptions | None = None,
    networks: PoseNetworks = SAME_NETWORKS,
) -> PosesReport:
    """Computes the camera poses of the video, or of the folder of videos or photos, at `source`. Returns the report.

    `folder` becomes a COLMAP capture with the report in `poses.json`. It has a model for each piece with enough frames,
    the largest in `sparse/0`. If the folder is finished for these files, settings, `options` for panoramas, and
    `networks`, it is reused. If it is unfinished, the computation continues. Without `options`, or without a name in
    `networks`, those of the folder are kept. Progress goes to `listen` as events of the stage "poses".

    Raises InputError if the video cannot be decoded, if the folder contains something else, or if there are `options`
    but no panoramas. Also raises it if a network is not installed, or is given for panoramas, which use none. Also
    raises it if fewer than half of the frames have a pose, unless the user has `chosen` a piece.
    """
    footage = need_footage(source)
    if footage.others:
        listen(Log(f"{footage.others_text}.", STAGE))
    refuse_mask_in_output(options, folder)
    stamp = _stamp(footage)
    known = read_report(folder)
    if networks.is_given and is_panoramic(footage):
        raise InputError(f"{source} is a 360 degree capture, to which --features and --people do not apply; omit them.")
    if known is not None and _is_current(known, footage, stamp, options, networks) and _is_whole(folder, known):
        listen(Log(f"The poses in {folder} are up to date.", STAGE))
        return _report_end(_usable(_add_measured_scales(known, footage, folder), chosen), listen)
    begun = _begun(folder)
    _refuse_other(folder, stamp, known, begun)
    settings = begun.settings if begun is not None else SETTINGS if known is None else known.settings
    if options is None:
        options = begun.options if begun is not None else None if known is None else _options_of(known, footage)
    networks = networks.completed_by(begun.networks if begun is not None else () if known is None else known.networks)
    digests = networks.digests
    if settings != SETTINGS:
        discard(folder)
    listen(Progress(STAGE, 0, _WHOLE, _STEPS["frames" if footage.kind == "video" else "photographs"][2]))
    report = _computed_in_child(_Request(footage, folder, stamp, options, networks, digests), listen)
    return _report_end(_usable(_add_measured_scales(report, footage, folder), chosen), listen)


def _add_measured_scales(report: PosesReport, footage: Footage, folder: Path) -> PosesReport:
    """Adds the scales from recorded positions to `report` and to its file in `folder`."""
    from nvsim.reconstruction.metric_scale import with_measured_scales

    found = with_measured_scales(report, footage, folder)
    if found != report:
        write_report(found, folder)
    return found


def is_finished(
    folder: Path, footage: Footage, options: CutOptions | None = None, networks: PoseNetworks = SAME_NETWORKS
) -> bool:
    """Whether `folder` has finished poses of these files, for the settings of this version, and for `options` and
    `networks`, if given."""
    try:
        known = read_report(folder)
        return known is not None and _is_current(known, footage, _stamp(footage), options, networks)
    except InputError:
        return False


def _is_current(
    known: PosesReport, footage: Footage, stamp: Stamp, options: CutOptions | None, networks: PoseNetworks
) -> bool:
    if known.stamp != stamp or known.settings != SETTINGS or not networks.match_earlier(known.networks):
        return False
    return options is None or options.agrees(known.views, known.mask, footage.sides)


def _options_of(known: PosesReport, footage: Footage) -> CutOptions | None:
    """The options with which the panoramas of a report were cut. None if the images are not panoramas."""
    if known.views == 1:
        return None
    return CutOptions(None if footage.sides else known.views, Path(known.mask[0][0]) if known.mask else None)


def has_poses_of_other_files(folder: Path, footage: Footage) -> bool:
    """Whether `folder` has unfinished poses of files other than these."""
    begun = _begun(folder)
    return begun is not None and begun.stamp != _stamp(footage)


def discard(folder: Path) -> None:
    """Removes the output of `compute_poses` from `folder`; other files stay. Raises InputError if removing fails."""
    try:
        for name in (IMAGES, MASKS, _MODEL, REPORT, WORK):  # WORK is last: it marks the folder as an output folder
            atomic.remove(folder / name)
    except OSError as error:
        raise atomic.as_input_error(folder, error) from error


def _stamp(footage: Footage) -> Stamp:
    try:
        return stamp_of(footage)
    except OSError as error:
        raise as_reading_error(footage.source, error) from error


def _is_whole(folder: Path, report: PosesReport) -> bool:
    models = all((folder / _MODEL / str(number)).is_dir() for number in range(report.models))
    return not report.models or (models and (folder / IMAGES).is_dir())


def _usable(report: PosesReport, chosen: bool) -> PosesReport:
    if not report.usable and not (chosen and report.models):
        raise InputError(report.refusal)
    return report


def _report_end(report: PosesReport, listen: Listener) -> PosesReport:
    """Reports the end of the stage."""
    if report.left_out:
        names = ", ".join(report.left_out[:_NAMED]) + (", ..." if len(report.left_out) > _NAMED else "")
        count = len(report.left_out)
        images = f"{count_text(count, report.image_noun.removesuffix('s'))} {'has' if count == 1 else 'have'}"
        listen(Warning(f"{images} no pose: {names}.", STAGE))
    summary = (
        f"{report.with_pose} of {report.frames} {report.image_noun} have a pose "
        f"(residual {report.residual_px:.2f} pixels, {report.loops} loops)"
    )
    figures = {"frames": report.frames, "with_pose": report.with_pose, "blurred": report.blurred}
    figures |= {"looked_at": report.looked_at, "loops": report.loops, "pieces": len(report.pieces)}
    listen(Done(STAGE, summary, {**figures, "residual_px": report.residual_px, "seconds": report.seconds}))
    return report


def _refuse_other(folder: Path, stamp: Stamp, known: PosesReport | None, begun: _UnfinishedPoses | None) -> None:
    """Raises InputError if `folder` has files that the computation would replace but that belong to other footage."""
    if begun is not None:
        if begun.stamp != stamp:
            raise InputError(f"{folder} contains unfinished poses of other images; choose another folder or remove it.")
    elif known is not None:
        if known.stamp != stamp:
            raise InputError(f"{folder} contains the poses of {known.source}; choose another folder or remove it.")
    elif there := [name for name in (IMAGES, MASKS, _MODEL) if os.path.lexists(folder / name)]:
        raise InputError(f"{folder} contains another capture ({', '.join(there)}); choose another folder.")


@dataclass(frozen=True)
class _UnfinishedPoses:
    """The files of an unfinished computation, the version of its settings, its options for panoramas, and its
    networks."""

    stamp: Stamp
    settings: int
    options: CutOptions | None
    networks: tuple[Digest, ...]


def _begun(folder: Path) -> _UnfinishedPoses | None:
    """The unfinished computation in `folder`, or None. Raises InputError if its record is damaged."""
    path = folder / WORK / _BEGUN
    if not is_regular(path):
        return None
    then = f"remove {folder / WORK}"
    data = read_json(path, "a record of unfinished poses", then)
    with reading(path, "a record of unfinished poses", then):
        stamp = tuple((str(name), int(size), int(changed)) for name, size, changed in data["stamp"])
        views, mask = data.get("views"), data.get("mask")
        given = None if views is None and mask is None else CutOptions(views and int(views), mask and Path(str(mask)))
        networks = tuple((str(use), str(name), str(digest)) for use, name, digest in data.get("networks", ()))
        return _UnfinishedPoses(stamp, int(data["settings"]), given, networks)


@dataclass(frozen=True)
class _Request:
    footage: Footage
    folder: Path
    stamp: Stamp
    options: CutOptions | None
    networks: PoseNetworks
    digests: tuple[Digest, ...]


def _computed_in_child(request: _Request, listen: Listener) -> PosesReport:
    def forward_event(event: object) -> None:
        if isinstance(event, Progress | Log | Warning):
            listen(event)

    then = "film a shorter video, or compute on a machine with more memory"
    child: Child[_Request, PosesReport] = Child(PoseWorker, str(request.footage.source), then)
    try:
        return child.ask(request, hear=forward_event)
    finally:
        child.close()


class PoseWorker:
    """Computes poses in the child process."""

    def send_event(self, event: Progress | Log | Warning) -> None:
        """Sends an event to the parent. The child process replaces this method."""

    def __call__(self, request: _Request) -> PosesReport:
        return _compute(request, self.send_event)


def _compute(request: _Request, tell: Callable[[Progress | Log | Warning], None]) -> PosesReport:
    from nvsim.reconstruction.image_sets import store_images

    started, footage, folder = time.monotonic(), request.footage, request.folder
    from nvsim.footage.decoding import refuse_different_sizes

    if footage.kind == "video":
        refuse_different_sizes(footage.files)  # before anything is written
    options = request.options
    if options is not None:
        refuse_unless_cut(footage, options)
    work = folder / WORK
    atomic.make_folder(work)
    begun: dict[str, object] = {"stamp": request.stamp, "settings": SETTINGS, "networks": request.digests}
    if options is not None:
        begun |= {"views": options.views, "mask": options.mask and str(options.mask)}
    atomic.write_text(work / _BEGUN, json.dumps(begun))
    for part in (folder / REPORT, folder / _MODEL, *(p for p in work.iterdir() if p.name != _BEGUN)):
        atomic.remove(part)
    progress = _ProgressForwarder(tell)
    if is_panoramic(footage):
        from nvsim.reconstruction.panoramas import pose_panoramas

        report, model = pose_panoramas(
            footage, options or CutOptions(), request.stamp, folder / IMAGES, work, progress, tell
        )
        return _store_report(report, [model], folder)
    atomic.remove(folder / MASKS)
    stored = store_images(footage, folder / IMAGES, progress, tell)
    images, masked = request.networks.without_people(stored.images, folder / MASKS, progress)

    from nvsim.poses.from_images import find_poses  # imported after decoding: the import takes seconds
    from nvsim.poses.pieces import without_bridges
    from nvsim.reconstruction.growing_trajectory import write_growing
    from nvsim.reconstruction.weak_places import find_weak_places

    camera, network = images.cameras[0], request.networks.feature_network()
    found = find_poses(images, work, progress, lambda models: write_growing(models, work), network)
    bridges: list[str] = []
    weak: tuple[WeakPlace, ...] = ()
    if stored.frames is not None:
        weak = find_weak_places(stored.frames, found.pieces, found.focal[0])
        blurred = {name for name, is_blurred in zip(images.names, stored.frames.blurred, strict=True) if is_blurred}
        bridges = [name for model in found.models for name in without_bridges(model, blurred)]
    report = PosesReport(
        source=str(footage.source.absolute()),
        footage=FRAMES if stored.frames is not None and footage.kind == "photographs" else footage.description,
        stamp=request.stamp,
        settings=SETTINGS,
        looked_at=stored.looked_at,
        frames=len(images.names) + len(stored.unreadable) - len(bridges),
        blurred=stored.blurred - len(bridges),
        bridges=len(bridges),
        with_pose=int(found.model.num_reg_images()),
        pieces=tuple(len(names) for names in found.pieces),
        focal_px=tuple(round(float(f), 2) for f in found.focal),
        size_px=(camera.width, camera.height),
        residual_px=round(float(found.residual), 3),
        loops=int(found.loops),
        left_out=(*found.left_out, *stored.unreadable),
        seconds=round(time.monotonic() - started, 1),
        members=found.pieces,
        upright=found.upright,
        weak=weak,
        fisheye=stored.fisheye,
        masked=masked,
        networks=request.digests,
        compared=found.compared,
    )
    report = _store_report(report, found.models, folder)
    for name in bridges:  # otherwise the check of the capture warns of images without a pose
        (folder / IMAGES / name).unlink(missing_ok=True)
    return report


def _store_report(report: PosesReport, models: Sequence[pycolmap.Reconstruction], folder: Path) -> PosesReport:
    """Writes the report and the models of the pieces that can be imported to `folder`. Returns the report."""
    work = folder / WORK
    for number, model in enumerate(models[: report.models]):
        model.write(atomic.make_folder(work / "finished" / str(number)))
    if report.models:
        os.replace(work / "finished", folder / _MODEL)
    write_report(report, folder)
    shutil.rmtree(work, ignore_errors=True)
    return report


class _ProgressForwarder:
    """Forwards progress as a share of all steps that never decreases, at most ten times per second within a step."""

    def __init__(self, tell: Callable[[Progress | Log | Warning], None]) -> None:
        self._tell = tell
        self._step, self._at, self._done = "", 0.0, 0

    def __call__(self, step: str, done: int, total: int) -> None:
        now = time.monotonic()
        if step == self._step and now - self._at < _PERIOD:
            return
        self._step, self._at = step, now
        first, last, words = _STEPS.get(step, (0.0, 0.0, step))
        share = first + (last - first) * min(done / total, 1.0) if total > 0 else first
        self._done = max(self._done, round(_WHOLE * share))
        self._tell(Progress(STAGE, self._done, _WHOLE, words))
