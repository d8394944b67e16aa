"""Ground truth of floor and normals for the frames of a project: images in a folder, or labels from its point cloud."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.errors import InputError
from nvsim.evaluation.truth import read_true_mask, true_mask, truth_folder
from nvsim.files.images import decode_pixels
from nvsim.files.opening import read_bytes
from nvsim.perception.cloud_labels import FLOOR, UNKNOWN, CloudLabels
from nvsim.perception.segment import SegmentConfig, read_mask
from nvsim.project.floor_heights import floors_seen
from nvsim.project.project import Project

Mask = NDArray[np.bool_]


def labels_of(project: Project) -> CloudLabels:
    """The labels that the project's cloud gives to images. Raises InputError if the project has no dense cloud."""
    cloud = project.scan()
    if cloud is None or not cloud.is_dense:
        raise InputError(f"{project.root} has no dense point cloud to label its images; choose another project.")
    return CloudLabels(cloud)


@dataclass(frozen=True, eq=False)
class FrameTruth:
    """Ground truth of floor and normals.

    folder   folder of images, None if the truth comes from the point cloud
    labels   labels from the point cloud, None if the truth comes from images
    frames   indices of the frames with true floor
    normals  indices of the frames with true normals
    """

    project: Project
    folder: Path | None
    labels: CloudLabels | None
    frames: tuple[int, ...]
    normals: tuple[int, ...]
    _floors: dict[int, Any]

    def size(self, index: int) -> tuple[int, int]:
        """Width and height at which a frame is compared: those of its true mask, or with a cloud those of computed
        masks. Raises InputError if the true mask is missing."""
        frame = self.project.need_capture().frames[index]
        if self.labels is not None:
            small = frame.intrinsics.limited_to(SegmentConfig.longest_side)
            return small.width, small.height
        height, width = frame.lens.upright(read_mask(self._file("floor", frame.name))).shape
        return width, height

    def floor(self, index: int, width: int, height: int) -> tuple[Mask, Mask]:
        """(H, W) bool: the true floor, and the pixels where it is known. With a cloud, pixels whose color differs from
        the frame are unknown. Raises InputError if the true mask is missing."""
        frame = self.project.need_capture().frames[index]
        if self.labels is not None:
            said, _ = self._labels_and_normals(index, width, height)
            return said == FLOOR, said != UNKNOWN
        floor = read_true_mask(self._file("floor", frame.name), frame, width, height)
        return floor, np.ones((height, width), bool)

    def normal_map(self, index: int, width: int, height: int) -> NDArray[np.float32]:
        """(H, W, 3) float32 unit normals, world, toward the camera; zero if unknown. With a cloud, pixels whose color
        differs from the frame are unknown. Raises InputError if the map is missing or unreadable."""
        frame = self.project.need_capture().frames[index]
        if self.labels is not None:
            return self._labels_and_normals(index, width, height)[1]
        path = self._file("normals", frame.name)
        again = "a map of normals is a PNG of (n + 1) * 127.5, black where unknown"
        stored = decode_pixels(read_bytes(path), path, cv2.IMREAD_COLOR, what="a map of normals", then=again)[..., ::-1]
        upright = np.ascontiguousarray(frame.lens.upright(stored))
        sized = cv2.resize(upright, (width, height), interpolation=cv2.INTER_NEAREST)
        found = sized.astype(np.float32) / 127.5 - 1
        length = np.linalg.norm(found, axis=-1, keepdims=True)
        there = (sized.max(axis=-1, keepdims=True) > 0) & (np.abs(length - 1) < 0.1)
        return np.where(there, found / np.maximum(length, 1e-6), 0).astype(np.float32)

    def _labels_and_normals(self, index: int, width: int, height: int) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Labels and normals from the point cloud, see CloudLabels.of. Raises InputError."""
        assert self.labels is not None
        frame = self.project.need_capture().frames[index]
        camera = frame.camera.scaled(width, height)
        return self.labels.of(camera, self._floors[index], read_image(frame, camera.intrinsics))

    def _file(self, kind: str, name: str) -> Path:
        assert self.folder is not None
        path = true_mask(self.folder, kind, name)
        if path is None:
            raise InputError(f"{self.folder} no longer has the true {kind} of {name}; restore the file.")
        return path


def frame_truth(project: Project, truth: Path | None, from_scan: bool) -> FrameTruth:
    """The ground truth of a project. Without `from_scan`, it comes from the images in the folder `truth`, or from the
    built-in building. With `from_scan`, it comes from the project's point cloud. Raises InputError if both are given,
    or if the ground truth is missing."""
    frames = project.need_capture().frames
    if from_scan:
        if truth is not None:
            raise InputError("--truth and --from-scan contradict each other; name one of them.")
        floors = floors_seen(project)
        every = tuple(sorted(floors))
        return FrameTruth(project, None, labels_of(project), every, every, floors)
    folder = truth_folder(project, truth)
    floor, normals = (
        tuple(i for i, f in enumerate(frames) if true_mask(folder, kind, f.name) is not None)
        for kind in ("floor", "normals")
    )
    if not floor:
        raise InputError(f"{folder} has no mask for any frame (looked for floor/{Path(frames[0].name).stem}.png).")
    return FrameTruth(project, folder, None, floor, normals, {})
