"""Panoramas of a 360 degree camera: decode and choose them, and store them as perspective views with carrier masks.

A panorama is an equirectangular image, twice as wide as high. Alternatively, it is one frame of each of several videos
side0, side1, ... whose cameras look around in equal steps.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.images import decode_pixels
from nvsim.files.opening import read_bytes
from nvsim.files.reading import reading
from nvsim.footage.carrier import PanoramaSamples, as_png, cut_mask, read_panorama_mask
from nvsim.footage.cut_options import MASKS, WHOLE, CutOptions
from nvsim.footage.decoding import video_facts, video_frames
from nvsim.footage.extraction import QUALITY
from nvsim.footage.sources import Footage, is_equirectangular
from nvsim.footage.tracking import TrackedFrame, frame_without_points, shrunk_gray, track_points, with_new_points
from nvsim.footage.views import Views, cut_views, views_of

_RATE = 6.0  # panoramas per second that are decoded
_THINNED = 3.0  # panoramas per second; in a video with no more, each one is chosen
_STEP = 2.5  # degrees by which points move relative to each other until the next panorama is chosen
_EARLY = 0.6  # share of the step after which a panorama may be chosen
_ALIVE, _FEWEST = 0.4, 60  # share and number of the last chosen panorama's points that are still tracked, at least
_TRACKED = 160  # size of the views in which points are tracked, pixels
_BLURRED = 0.6  # sharpness over that of the previous panoramas below which a panorama is blurred
_LIST = "frames.json"


@dataclass(frozen=True, eq=False)
class ExtractedPanoramas:
    """Panoramas that were chosen and stored as views.

    folder     folder of the images: side0/NAME, side1/NAME, ...
    names      names of the N panoramas, in order of time
    views      the views of each panorama
    clips      (N,) int64, index of the video of each panorama; all 0 for photos
    seconds    (N,) float64, time of each panorama in its video
    blurred    (N,) bool, whether the panorama is blurred
    looked_at  number of decoded panoramas
    masks      masks of the views, each (size, size) bool, False where pixels are ignored; empty without masks
    """

    folder: Path
    names: tuple[str, ...]
    views: Views
    clips: NDArray[np.int64]
    seconds: NDArray[np.float64]
    blurred: NDArray[np.bool_]
    looked_at: int
    masks: tuple[NDArray[np.bool_], ...] = ()

    @property
    def masked(self) -> float:
        """Percentage of the pixels of the views that are ignored."""
        return round(100 * float(np.mean([np.mean(~mask) for mask in self.masks])), 2) if self.masks else 0.0


def extract_panoramas(
    footage: Footage,
    folder: Path,
    options: CutOptions | None = None,
    looked_at: Callable[[int, int], None] = lambda done, total: None,
) -> ExtractedPanoramas:
    """Writes the chosen panoramas of `footage` to `folder` as views, and their masks to a folder next to it.

    If an earlier run finished them, they are read. Raises InputError for files that cannot be decoded, for sizes that
    do not match, and if writing fails."""
    options = CutOptions() if options is None else options
    stamp = [[str(f.absolute()), f.stat().st_size, f.stat().st_mtime_ns] for f in footage.files]
    views, masks = _views(footage, options.count), folder.parent / MASKS
    listed = {"footage": stamp, "views": [views.around, views.size, *views.tilts], "mask": [*map(list, options.stamp)]}
    if (folder / _LIST).exists():
        found = _read(folder, listed, views)
        if found is not None:
            return found
    given = None if options.mask is None else read_panorama_mask(options.mask)
    for old in (folder / _LIST, masks, folder):
        _remove(old)
    for name in views.names(""):
        atomic.make_folder(folder / name)
    counted = 0

    def count(done: int, total: int) -> None:
        nonlocal counted
        counted = done
        looked_at(done, total)

    chosen = _photographs(footage, count) if footage.kind == "photographs" else _choose_panoramas(footage, count)
    names, clips, seconds, blurred = [], [], [], []
    samples = PanoramaSamples(views if footage.sides else None)
    for panorama in chosen:
        for place, image in zip(views.names(panorama.name), panorama.views(views), strict=True):
            encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
            atomic.write_bytes(folder / place, encoded.tobytes())
        samples.add(panorama.image)
        names.append(panorama.name)
        clips.append(panorama.clip)
        seconds.append(panorama.seconds)
        blurred.append(panorama.blurred)
    usable = samples.usable() if given is None else given
    if usable is not None:
        _write_masks(usable, views, names, masks)
    chosen_list = {"names": names, "clips": clips, "seconds": seconds, "blurred": blurred, "looked_at": counted}
    atomic.write_text(folder / _LIST, json.dumps({**listed, **chosen_list}))
    found = _read(folder, listed, views)
    assert found is not None
    return found


def _remove(path: Path) -> None:
    try:
        atomic.remove(path)
    except OSError as error:
        raise atomic.as_input_error(path, error) from error


def _write_masks(usable: NDArray[np.bool_], views: Views, names: list[str], folder: Path) -> None:
    """Writes the mask of the equirectangular image, and the masks of the views in which it ignores pixels."""
    atomic.make_folder(folder)
    atomic.write_bytes(folder / WHOLE, as_png(usable))
    for k, mask in enumerate(cut_mask(usable, views)):
        if not mask.all():
            atomic.make_folder(folder / views.names("")[k])
            for name in names:
                atomic.write_bytes((folder / views.names(name)[k]).with_suffix(".png"), as_png(mask))


def _read(folder: Path, wanted: dict[str, object], views: Views) -> ExtractedPanoramas | None:
    """The panoramas in `folder` if they belong to the files, the views, and the mask that `wanted` lists."""
    path = folder / _LIST
    with reading(path, "a list of panoramas", "remove the folder and run the command again"):
        listed = json.loads(read_bytes(path).decode())
        if any(listed.get(key) != value for key, value in wanted.items()):
            return None
        names = tuple(listed["names"])
        if any(not (folder / view).is_file() for name in names for view in views.names(name)):
            return None
        whole = folder.parent / MASKS / WHOLE
        masks = tuple(cut_mask(read_panorama_mask(whole), views)) if whole.is_file() else ()
        clips, blurred = np.array(listed["clips"], np.int64), np.array(listed["blurred"], bool)
        seconds = np.array(listed["seconds"], np.float64)
        return ExtractedPanoramas(folder, names, views, clips, seconds, blurred, int(listed["looked_at"]), masks)


def _views(footage: Footage, count: int) -> Views:
    """The views of all panoramas, `count` for each equirectangular image. Raises InputError if the sizes, frame counts,
    or proportions of the files do not match."""
    if footage.kind == "photographs":
        return views_of(_decode(footage.files[0]).shape[0], count)
    facts = [video_facts(file) for file in footage.files]
    for file, other in zip(footage.files, facts, strict=True):
        if (other.width, other.height) != (facts[0].width, facts[0].height):
            raise InputError(
                f"{file} is {other.width}x{other.height} pixels and {footage.files[0].name} {facts[0].width}x"
                f"{facts[0].height}; use videos of one 360 degree camera, exported in one size."
            )
        if footage.sides and other.frames != facts[0].frames:
            raise InputError(
                f"{file} has {other.frames} frames and {footage.files[0].name} {facts[0].frames}; the videos of the "
                "sides of a rig must be synchronous, so export them again together."
            )
    if not footage.sides:
        return views_of(facts[0].height, count)
    if facts[0].width != facts[0].height:
        raise InputError(
            f"{footage.files[0]} is {facts[0].width}x{facts[0].height} pixels, but the sides of a 360 degree rig are "
            "square; export square views, or rename videos of an ordinary camera."
        )
    return Views(footage.sides, facts[0].width)


@dataclass(eq=False)
class _Panorama:
    """One panorama: an equirectangular image (H, 2H, 3), or a list of views (S, S, 3), all uint8 BGR."""

    name: str
    clip: int
    image: NDArray[np.uint8] | list[NDArray[np.uint8]]
    seconds: float = 0.0
    blurred: bool = False
    rays: dict[int, NDArray[np.float64]] = field(default_factory=dict)
    sharpness: float = 0.0

    def views(self, views: Views) -> list[NDArray[np.uint8]]:
        return self.image if isinstance(self.image, list) else cut_views(self.image, views)


def _photographs(footage: Footage, count: Callable[[int, int], None]) -> Iterator[_Panorama]:
    """Yields each photo as a panorama. Raises InputError for a photo that is not twice as wide as high."""
    stems = [file.stem for file in footage.files]
    for number, file in enumerate(footage.files, 1):
        image = _decode(file)
        height, width = image.shape[:2]
        if not is_equirectangular(width, height):
            raise InputError(
                f"{file} is {width}x{height} pixels, but other images in this folder are 360 degree panoramas, twice "
                "as wide as high; use a folder with panoramas only."
            )
        count(number, len(footage.files))
        name = file.stem if stems.count(file.stem) == 1 else file.name.replace(".", "_")
        yield _Panorama(f"{name}.jpg", 0, image)


def _decode(file: Path) -> NDArray[np.uint8]:
    return decode_pixels(read_bytes(file), file, cv2.IMREAD_COLOR, then="copy it again from the camera")


def _moments(footage: Footage) -> Iterator[_Panorama]:
    """Yields the panoramas of all videos in order."""
    if footage.sides:
        for frames in zip(*(video_frames(file, _RATE) for file in footage.files), strict=False):
            if len({frame.number for frame in frames}) > 1:
                raise InputError(
                    f"The videos in {footage.source} have frames at different times; export all sides of the rig again."
                )
            first = frames[0]
            yield _Panorama(f"0_{first.number:06d}.jpg", 0, [frame.image for frame in frames], first.seconds)
        return
    for clip, file in enumerate(footage.files):
        for frame in video_frames(file, _RATE):
            yield _Panorama(f"{clip}_{frame.number:06d}.jpg", clip, frame.image, frame.seconds)


def _choose_panoramas(footage: Footage, count: Callable[[int, int], None]) -> Iterator[_Panorama]:
    """Yields the panoramas of videos that get a camera pose: the sharpest ones, between which the camera moved far
    enough. A rotation alone seldom requires another one, because a panorama shows every direction. If a video has at
    most 3 frames per second, all its frames are chosen."""
    facts = [video_facts(file) for file in footage.files[: 1 if footage.sides else None]]
    total, before = sum(f.frames for f in facts), 0
    chooser: _Chooser | None = None
    for panorama in _moments(footage):
        if chooser is None or chooser.clip != panorama.clip:
            if chooser is not None:
                yield from chooser.choose_last()
                before += facts[chooser.clip].frames
            chooser = _Chooser(panorama.clip, footage.sides)
        yield from [panorama] if 0 < facts[panorama.clip].rate <= _THINNED else chooser.looked_at(panorama)
        count(before + int(panorama.name[:-4].rpartition("_")[2]) + 1, total)
    if chooser is not None:
        yield from chooser.choose_last()


class _Chooser:
    """Chooses panoramas of one video by points that are tracked in all of their views."""

    def __init__(self, clip: int, sides: int) -> None:
        self.clip = clip
        self._views = Views(sides or 4, _TRACKED)
        self._tracked: list[TrackedFrame] = []
        self._next_id = 0
        self._anchor: dict[int, NDArray[np.float64]] = {}  # rays of the last chosen panorama, by point number
        self._best: _Panorama | None = None  # the sharpest candidate for the next one; the others are not kept
        self._sharp = 0.0  # running mean of the sharpness of the previous panoramas

    def looked_at(self, panorama: _Panorama) -> Iterator[_Panorama]:
        """Yields the panorama that is chosen after this one was decoded, if any."""
        grays = [shrunk_gray(view, _TRACKED) for view in panorama.views(self._views)]
        panorama.sharpness = float(np.mean([cv2.Laplacian(gray, cv2.CV_32F).std() for gray in grays]))
        panorama.blurred = panorama.sharpness < _BLURRED * self._sharp
        self._sharp = panorama.sharpness if not self._sharp else 0.8 * self._sharp + 0.2 * panorama.sharpness
        first = not self._tracked
        before = [frame_without_points(gray) for gray in grays] if first else self._tracked
        self._tracked = [track_points(old, gray) for old, gray in zip(before, grays, strict=True)]
        panorama.rays = self._rays()
        moved, share, shared = self._motion_since_chosen(panorama.rays)
        if first:
            yield self._choose(panorama)
            return
        is_lost = share < _ALIVE or shared < _FEWEST
        if is_lost or moved >= _EARLY * _STEP:
            best = self._best
            self._best = best = panorama if best is None or panorama.sharpness > best.sharpness else best
            if is_lost or moved >= _STEP:
                yield self._choose(best)

    def choose_last(self) -> Iterator[_Panorama]:
        """Yields the last panorama if it shows more than the last chosen one."""
        if self._best is not None:
            yield self._choose(self._best)

    def _choose(self, panorama: _Panorama) -> _Panorama:
        self._best = None
        renewed = []
        for tracked in self._tracked:
            renewed.append(with_new_points(tracked, self._next_id))
            self._next_id = max(self._next_id, int(renewed[-1].ids.max(initial=-1)) + 1)
        self._tracked = renewed
        rays = self._rays()
        # New points start in the last decoded panorama, which is at most one step later.
        self._anchor = rays | {i: ray for i, ray in panorama.rays.items() if i in rays}
        return panorama

    def _rays(self) -> dict[int, NDArray[np.float64]]:
        """Unit vectors (3,) in the axes of the panorama, by point number."""
        found: dict[int, NDArray[np.float64]] = {}
        for tracked, turn in zip(self._tracked, self._views.turns, strict=True):
            flat = (tracked.places.astype(np.float64) + 0.5 - self._views.size / 2) / self._views.focal
            rays = np.column_stack([flat, np.ones(len(flat))]) @ turn
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            found.update(zip(tracked.ids.tolist(), rays, strict=True))
        return found

    def _motion_since_chosen(self, rays: dict[int, NDArray[np.float64]]) -> tuple[float, float, int]:
        """Motion of the points of the last chosen panorama, without its rotation: the median in degrees. Also returns
        the share and the number of these points that are still tracked."""
        shared = [i for i in self._anchor if i in rays]
        if len(shared) < 3:
            return 0.0, 0.0, 0
        one, other = (np.array([of[i] for i in shared]) for of in (self._anchor, rays))
        weight = np.ones(len(one))
        for _ in range(4):
            u, _, vt = np.linalg.svd((other * weight[:, None]).T @ one)
            off = np.linalg.norm(one @ (u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt).T - other, axis=1)
            weight = 1 / (off + 0.02)
        return float(np.degrees(np.median(off))), len(shared) / len(self._anchor), len(shared)
