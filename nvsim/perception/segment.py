"""The floor mask stage: writes a mask for every frame as soon as it is found, so that a stopped run can continue."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.capture.images import read_image
from nvsim.capture.masks import usable_pixels
from nvsim.capture.types import Capture, Cloud
from nvsim.depth.floor_noise import flatten_floor
from nvsim.errors import InputError
from nvsim.events import Listener, Progress, ignore_event
from nvsim.files.atomic import make_folder, write_bytes
from nvsim.files.images import decode_pixels
from nvsim.files.opening import read_bytes
from nvsim.geometry.camera import Camera, Intrinsics
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.perception.failures import Failures
from nvsim.perception.fused import View
from nvsim.perception.geometric import GeometricConfig, GeometricFloor
from nvsim.perception.obstacles import BuildingObstacles
from nvsim.perception.roles import Failure, Float32, FloorSegmenter, Image, Mask

_NEAR = 6.0  # meters
_DOUBTFUL = 96  # value of doubtful floor in a mask image


@dataclass(frozen=True)
class SegmentConfig:
    """longest_side  masks have the image's size, reduced if necessary so that neither side exceeds this many pixels
    threads       number of frames that are processed in parallel
    again         also process the frames that already have a mask
    geometric     settings of the geometric provider
    """

    longest_side: int = 640
    threads: int = 2
    again: bool = False
    geometric: GeometricConfig = field(default_factory=GeometricConfig)


@dataclass(frozen=True)
class Surroundings:
    """What is around the frames of a submap.

    cloud    gives the point cloud, with its floor smoothed
    views    the frames that see the floor of the submap, at the size of masks
    threads  number of frames that may be processed in parallel
    """

    cloud: Callable[[], Cloud | None]
    views: Sequence[View]
    threads: int


def mask_path(folder: Path, index: int) -> Path:
    """The path of the mask of frame `index`."""
    return folder / f"{index:06d}.png"


def segment_capture(
    capture: Capture,
    surfaces_of: Callable[[int], FloorSurface],
    folder: Path,
    config: SegmentConfig | None = None,
    listen: Listener = ignore_event,
    todo: Iterable[int] | None = None,
    depth_of: Callable[[int], Float32] | None = None,
    other_of: Callable[[GeometricFloor, Surroundings], FloorSegmenter] | None = None,
) -> dict[int, Failure]:
    """Writes the floor mask of every frame index in `todo` (default: all frames) to `folder`/NNNNNN.png. Pixels are 255
    for floor, 96 for doubtful floor (see `FloorMask.doubtful`), and 0 elsewhere, also where the frame's mask is False.

    surfaces_of  gives the floor surface around a frame; frames with an identical object are processed together
    depth_of     gives the depth (h, w) of a frame, meters (see `GeometricFloor.segment`), or None
    other_of     makes another provider from the geometric one and the surroundings of its frames

    Returns frame index -> reason for the failed masks. The file `failures.json` in `folder` has them too. Frames with a
    mask are skipped unless `config.again`. Raises InputError for an image that cannot be read and for a folder that
    cannot be written; masks written so far stay.
    """
    config = config or SegmentConfig()
    make_folder(folder)
    wanted = range(len(capture.frames)) if todo is None else sorted(set(todo))
    missing = [i for i in wanted if config.again or not mask_path(folder, i).exists()]
    failures = Failures(folder)
    failures.remove_frames(missing)
    done, total = len(wanted) - len(missing), len(wanted)
    listen(Progress("floors", done, total))
    if not missing:
        return failures.of_frames

    def view(index: int) -> tuple[Camera, Intrinsics]:
        frame = capture.frames[index]
        intrinsics = frame.intrinsics.limited_to(config.longest_side)
        return frame.camera.scaled(intrinsics.width, intrinsics.height), intrinsics

    # The floor color is learned from the whole trajectory, also in a resumed run, so that both give equal masks.
    surfaces = [surfaces_of(i) for i in range(len(capture.frames))]
    walks: dict[int, list[int]] = {}
    for i, surface in enumerate(surfaces):
        walks.setdefault(id(surface), []).append(i)

    def segment_frame(index: int, provider: FloorSegmenter) -> int:
        camera, intrinsics = view(index)
        image = read_image(capture.frames[index], intrinsics)
        depth = None if depth_of is None else depth_of(index)
        found = provider.segment(camera, image, depth)
        picture = found.mask.astype(np.uint8) * 255
        if found.doubtful is not None:
            picture[found.doubtful] = _DOUBTFUL
        usable = usable_pixels(capture.frames[index], intrinsics)
        if usable is not None:
            picture[~usable] = 0
        encoded = cv2.imencode(".png", picture)[1]
        if found.failure:
            failures.add(index, found.failure)  # first the reason: a mask without one would count as good
        write_bytes(mask_path(folder, index), encoded.tobytes())
        return index

    obstacles = BuildingObstacles(capture, surfaces, config.geometric.obstacles)

    def segment_frames(frames: list[int]) -> Iterator[int]:
        # The provider is freed before the next one is made, because each holds the obstacles around its frames.
        surface = surfaces[frames[0]]
        floor, around = learnt_floor(capture, walks[id(surface)], surface, obstacles, config, depth_of)
        provider = floor if other_of is None else other_of(floor, around)
        jobs = [pool.submit(segment_frame, i, provider) for i in frames]
        for job in as_completed(jobs):
            yield job.result()

    with ThreadPoolExecutor(config.threads) as pool:
        for key in dict.fromkeys(id(surfaces[i]) for i in missing):
            try:
                for index in segment_frames([i for i in missing if id(surfaces[i]) == key]):
                    done += 1
                    listen(Progress("floors", done, total, capture.frames[index].name))
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
    return failures.of_frames


def learnt_floor(
    capture: Capture,
    members: list[int],
    surface: FloorSurface,
    obstacles: BuildingObstacles,
    config: SegmentConfig,
    depth_of: Callable[[int], Float32] | None = None,
) -> tuple[GeometricFloor, Surroundings]:
    """The provider for the frames `members`, which share a floor surface, and their surroundings. The provider has
    learned the color of the floor. `depth_of` gives the depth (h, w) of a frame, meters. Raises InputError for an image
    that cannot be read."""
    near = _frames_near_submap(capture.positions, members, surface)

    def view(index: int) -> View:
        frame = capture.frames[index]
        size = frame.intrinsics.limited_to(config.longest_side)
        depth = None if depth_of is None else partial(depth_of, index)
        camera = frame.camera.scaled(size.width, size.height)
        return View(camera, partial(read_image, frame, size), partial(usable_pixels, frame, size), depth)

    def read_small(k: int) -> Image:
        frame = capture.frames[near[k]]
        return read_image(frame, frame.intrinsics.limited_to(config.geometric.longest_side))

    def usable_of(k: int) -> Mask | None:
        frame = capture.frames[near[k]]
        return usable_pixels(frame, frame.intrinsics.limited_to(config.geometric.longest_side))

    def near_cloud() -> Cloud | None:
        if capture.cloud is None:
            return None
        return flatten_floor(capture.cloud.near(capture.positions[near], config.geometric.obstacles.farthest), surface)

    views = [view(i) for i in near]
    floor = GeometricFloor(capture.cloud, surface, config.geometric, obstacles.near(members, near))
    floor.learn([v.camera for v in views], read_small, config.threads, usable_of)
    return floor, Surroundings(near_cloud, views, config.threads)


def _frames_near_submap(positions: NDArray[np.float64], members: list[int], surface: FloorSurface) -> list[int]:
    """The frames at `positions` (N, 3) that see the floor of the `members`: the members, and frames near them on their
    storey. The floor behind a glass wall can belong to the next submap."""
    above = positions[:, 2] - surface.height_at(positions[:, :2])
    distance, _ = cKDTree(positions[members]).query(positions, distance_upper_bound=_NEAR)
    same = (distance < _NEAR) & (above > 0.1) & (above < 3.0)
    same[members] = True
    return [int(i) for i in np.flatnonzero(same)]


def read_mask(path: Path, width: int | None = None, height: int | None = None) -> Mask:
    """(height, width) bool, True on floor, by default at the image's own size. Raises InputError if the file is missing
    or not an image."""
    return read_mask_and_doubt(path, width, height)[0]


def read_mask_and_doubt(path: Path, width: int | None = None, height: int | None = None) -> tuple[Mask, Mask | None]:
    """The mask of `read_mask`, and the doubtful floor (height, width) bool at that size, None if there is none. Raises
    InputError if the file is missing or not an image."""
    if not path.is_file():
        raise InputError(f"The floor mask {path} is missing; make the floor masks first.")
    again = "delete it and run `nvsim floors --project` again"
    picture = decode_pixels(read_bytes(path), path, cv2.IMREAD_GRAYSCALE, what="a floor mask", then=again)
    doubtful = picture == _DOUBTFUL
    layers = [np.where(doubtful, 0, picture).astype(np.uint8)]
    if doubtful.any():
        layers.append(doubtful.astype(np.uint8) * 255)
    if width is not None and height is not None and picture.shape != (height, width):
        is_smaller = picture.shape[0] > height or picture.shape[1] > width
        way = cv2.INTER_AREA if is_smaller else cv2.INTER_LINEAR
        layers = [np.asarray(cv2.resize(layer, (width, height), interpolation=way), np.uint8) for layer in layers]
    mask: Mask = layers[0] > 127
    return mask, (layers[1] > 127) & ~mask if len(layers) > 1 else None
