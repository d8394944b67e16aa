"""Choose the views that are compared, for each submap: seen views that its models were trained on, and novel views.

Seen views are evenly spaced frames of the submap's core, without held-out frames. Novel views come from the ground
truth if it has any. Otherwise they are horizontal views from viewpoints of the graph, or from the trajectory if there
is no graph. Their heading differs by 45 to 180 degrees from that of the nearest frame.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.capture.types import Capture
from nvsim.evaluation.scores import Image
from nvsim.evaluation.views import NovelView, has_novel_views, novel_views
from nvsim.geometry.camera import Camera, camera_pose
from nvsim.project.config import held_out
from nvsim.project.project import Project
from nvsim.project.stages.imported import capture_config
from nvsim.submaps.split import Submap, nearest_submap

Kind = Literal["seen", "novel"]
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class JudgedView:
    """A view to compare.

    name    unique among views
    kind    "seen" or "novel"
    group   submap, "" if there is none
    camera  in the aligned frame
    photo   reads the photograph at this pose, (H, W, 3) float32, 0 to 1; None if there is none
    """

    name: str
    kind: Kind
    group: str
    camera: Camera
    photo: Callable[[], Image] | None

    @property
    def key(self) -> str:
        """8 hex digits: a hash of the camera."""
        k = self.camera.intrinsics
        words = (k.width, k.height, *(round(v, 3) for v in (k.fx, k.fy, k.cx, k.cy)))
        pose = np.round(self.camera.camera_to_world, 6).tolist()
        return hashlib.sha256(repr((words, pose)).encode()).hexdigest()[:8]


@dataclass(frozen=True)
class ViewCounts:
    """Numbers of views per submap, the seed of drawn novel views, and the longest side of the images in pixels."""

    seen: int = 5
    novel: int = 20
    seed: int = 0
    longest: int = 640


def judged_views(
    project: Project, submaps: Sequence[Submap], truth: Path | None, counts: ViewCounts
) -> list[JudgedView]:
    """The views of these submaps. Raises InputError if the capture or the ground truth cannot be read."""
    capture = project.need_capture()
    kept_out = held_out(len(capture.frames), capture_config(project).hold_out)
    everything = project.need_submaps()
    novel: dict[int, list[NovelView]] = {s.index: [] for s in everything}
    for view in novel_views(project, truth) if has_novel_views(truth) and counts.novel else ():
        novel[nearest_submap(everything, view.camera.position)].append(view)
    found = []
    for submap in submaps:
        trained = [i for i in submap.core if i not in kept_out]
        found += [_seen_view(capture, i, submap, counts) for i in _evenly_spaced_items(trained, counts.seen)]
        true = _evenly_spaced_items(novel[submap.index], counts.novel)
        found += [_photographed_view(view, submap, counts) for view in true]
        if not true:
            found += _novel_views(project, capture, submap, everything, counts)
    return found


def _seen_view(capture: Capture, index: int, submap: Submap, counts: ViewCounts) -> JudgedView:
    frame = capture.frames[index]
    camera = _limit_size(frame.camera, counts.longest)

    def photo() -> Image:
        return _resize(read_image(frame, frame.intrinsics) / np.float32(255), camera)

    return JudgedView(f"{submap.index:03d}_seen_{index:06d}", "seen", str(submap.index), camera, photo)


def _photographed_view(view: NovelView, submap: Submap, counts: ViewCounts) -> JudgedView:
    camera = _limit_size(view.camera, counts.longest)

    def photo() -> Image:
        return _resize(view.image(), camera)

    name = "".join(c if c.isalnum() or c in "-." else "_" for c in view.name)
    return JudgedView(f"{submap.index:03d}_novel_{name}", "novel", str(submap.index), camera, photo)


def _novel_views(
    project: Project, capture: Capture, submap: Submap, everything: Sequence[Submap], counts: ViewCounts
) -> list[JudgedView]:
    graph = project.graph()
    places = [] if graph is None else [np.array(v.position) for v in graph.viewpoints.values() if v.included]
    mine = [p for p in places if nearest_submap(list(everything), p) == submap.index]
    places = _evenly_spaced_items(mine or list(submap.positions), counts.novel)
    if not places:
        return []
    random = np.random.default_rng([counts.seed, submap.index])
    intrinsics = _limit_size(capture.frames[submap.core[0]].camera, counts.longest).intrinsics
    found = []
    for i in range(counts.novel):
        place = places[i % len(places)]
        nearest = submap.core[int(np.argmin(((submap.positions - place) ** 2).sum(axis=1)))]
        ahead = capture.frames[nearest].camera.rotation[:, 2]
        turn = random.uniform(math.pi / 4, math.pi) * random.choice([-1, 1])
        camera = Camera(intrinsics, camera_pose(place, math.atan2(ahead[0], ahead[1]) + turn))
        found.append(JudgedView(f"{submap.index:03d}_novel_{i:03d}", "novel", str(submap.index), camera, None))
    return found


def _evenly_spaced_items(items: Sequence[T], count: int) -> list[T]:
    """Up to `count` items, evenly spaced."""
    if count >= len(items):
        return list(items)
    return [items[int((k + 0.5) * len(items) / count)] for k in range(count)]


def _limit_size(camera: Camera, longest: int) -> Camera:
    k = camera.intrinsics.limited_to(longest)
    return camera.scaled(k.width, k.height)


def _resize(image: NDArray[np.floating], camera: Camera) -> Image:
    k = camera.intrinsics
    if image.shape[:2] == (k.height, k.width):
        return np.asarray(image, np.float32)
    return np.asarray(cv2.resize(image, (k.width, k.height), interpolation=cv2.INTER_AREA), np.float32)
