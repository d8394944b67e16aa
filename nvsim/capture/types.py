"""A capture: the frames of a trajectory, their lenses and poses, and an optional point cloud.

All data is in the aligned frame (right-handed, z up, meters). `alignment` maps the frame of the files to it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics
from nvsim.geometry.cells import near_places
from nvsim.geometry.lens import Lens

CloudKind = Literal["lidar", "sfm", "images", "depth"]
"""Source of a point cloud: a scanner; image features, which miss bare walls; the estimated depth of images, which is as
dense as a LiDAR scan but noisier; or the depth images of a depth camera."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """points   (N, 3) float32, meters, world
    colors   (N, 3) uint8 RGB, or None
    kind     source of the points
    normals  (N, 3) float32 unit vectors that point to the cameras, for points from estimated depth; 0 for other points.
             None if there are no such points
    """

    points: NDArray[np.float32]
    colors: NDArray[np.uint8] | None = None
    kind: CloudKind = "lidar"
    normals: NDArray[np.float32] | None = None

    @property
    def is_dense(self) -> bool:
        """Whether the point cloud shows surfaces, which reveal obstacles and floor."""
        return self.kind != "sfm"

    @property
    def is_estimated(self) -> NDArray[np.bool_]:
        """(N,) bool, True for points from the estimated depth of images."""
        if self.normals is None:
            return np.zeros(len(self.points), bool)
        return np.asarray(self.normals.any(axis=1))

    def merged_with(self, added: Cloud) -> Cloud:
        """These points and those of `added`, which must have colors."""
        assert added.colors is not None
        colors = None if self.colors is None else np.concatenate([self.colors, added.colors])
        normals = None if added.normals is None else np.concatenate([np.zeros_like(self.points), added.normals])
        return Cloud(np.concatenate([self.points, added.points]), colors, self.kind, normals)

    def near(self, places: NDArray[np.floating], reach: float) -> Cloud:
        """The points less than `reach` meters, measured horizontally, from any of `places` (P, 2 or 3), and some points
        a meter or two farther. Returns this object itself if it has no other points."""
        kept = near_places(self.points, places, reach)
        return self if kept.all() else self.only(kept)

    def only(self, kept: NDArray[np.bool_]) -> Cloud:
        """The points where `kept` (N,) is True."""
        colors = None if self.colors is None else self.colors[kept]
        normals = None if self.normals is None else self.normals[kept]
        return Cloud(self.points[kept], colors, self.kind, normals)


@dataclass(frozen=True)
class MaskFile:
    """The mask of an image: the pixels to ignore (people, the device, the sky).

    path     absolute path of the mask, an image of any size with the aspect ratio of its frame
    ignored  the value of ignored pixels: "black" (nerfstudio, COLMAP), "white" (instant-ngp), or "transparent" if the
             image is its own mask (Blender)
    """

    path: Path
    ignored: Literal["black", "white", "transparent"] = "black"


@dataclass(frozen=True, eq=False)
class Frame:
    """One image with its pose.

    name             unique in the capture: the path in the source, with forward slashes
    image_path       absolute path of the image, which is not copied
    lens             the camera model of the image as stored (with distortion)
    camera_to_world  (4, 4) float64, rigid, OpenCV axes, aligned frame, meters
    sensor           the camera's id in the source
    timestamp        in the source's own unit, or the running number if it has none
    mask             the pixels of the image to ignore, None for none
    rig              id of the rig that carries this camera and others, "" if there is none
    """

    name: str
    image_path: Path
    lens: Lens
    camera_to_world: NDArray[np.float64]
    sensor: str = "camera"
    timestamp: float = 0.0
    mask: MaskFile | None = None
    rig: str = ""

    @property
    def intrinsics(self) -> Intrinsics:
        """The pinhole camera of the undistorted image."""
        return self.lens.pinhole

    @property
    def camera(self) -> Camera:
        return Camera(self.intrinsics, self.camera_to_world)


@dataclass(frozen=True, eq=False)
class ScanFile:
    """The point cloud of one LiDAR scan, in the frame of its scanner.

    path      the file, PLY or PCD
    sensor    the scanner's id in the source
    to_world  (4, 4) float64, rigid: pose of the scanner, aligned frame, meters
    scale     meters per unit of the file
    """

    path: Path
    sensor: str
    to_world: NDArray[np.float64]
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class DepthFile:
    """A depth image: depth measured by a depth camera along its optical axis, 0 where nothing was measured.

    path             the file: a 16-bit image, a float TIFF, a .npy array, or if `is_raw`, float32 row by row
    lens             of the depth camera; it is scaled if the depth image has another size
    camera_to_world  (4, 4) float64, rigid, OpenCV axes, aligned frame, meters
    frame            name of the frame to which the depth image belongs, "" for none
    is_raw           see `path`
    scale            meters of the aligned frame per source unit
    unit             source units per value of the file: 0.001 for millimeters
    confidence       8-bit image of the same size; depth where it is at its lowest value, 0, is ignored; None for none
    """

    path: Path
    lens: Lens
    camera_to_world: NDArray[np.float64]
    frame: str = ""
    is_raw: bool = False
    scale: float = 1.0
    unit: float = 1.0
    confidence: Path | None = None


@dataclass(frozen=True, eq=False)
class Alignment:
    """aligned = scale * (rotation @ (source - origin)): an origin, a rotation about it, and a scale.

    rotation      (3, 3) float64, the identity if the capture's up direction was within 2 degrees of z
    scale         meters per source unit
    scale_known   False until the user or the source gives the unit
    origin        (x, y, z) source units, subtracted if the coordinates are far from the source's own origin (UTM)
    """

    rotation: NDArray[np.float64]
    scale: float = 1.0
    scale_known: bool = True
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @staticmethod
    def identity() -> Alignment:
        return Alignment(np.eye(3))

    @property
    def is_identity(self) -> bool:
        return bool(self.scale == 1.0 and not any(self.origin) and np.array_equal(self.rotation, np.eye(3)))


@dataclass(frozen=True, eq=False)
class Capture:
    """A recording with camera poses. `source` is the folder or file it was read from, and `format` the name of its
    format ("nerfstudio", ...). `scans` are the LiDAR scans with poses; a stored capture has none. `depths` are the
    depth images. `places` (N, 3), meters, are used instead of cameras if there are no images, as for a splat file: over
    the free floor, at the height of viewpoints."""

    source: Path
    format: str
    frames: tuple[Frame, ...]
    cloud: Cloud | None
    alignment: Alignment
    scans: tuple[ScanFile, ...] = ()
    depths: tuple[DepthFile, ...] = ()
    places: NDArray[np.float64] | None = None

    @property
    def has_images(self) -> bool:
        """Whether there are frames; a capture from splat files has none."""
        return self.places is None

    @cached_property
    def positions(self) -> NDArray[np.float64]:
        """(N, 3) float64 camera positions, meters, aligned frame, in frame order; `places` if there are no images."""
        if self.places is not None:
            return self.places
        return np.array([f.camera_to_world[:3, 3] for f in self.frames]).reshape(-1, 3)

    @cached_property
    def depth_of_frames(self) -> dict[int, DepthFile]:
        """The depth image of each frame that has one, by the index of the frame."""
        by_name = {depth.frame: depth for depth in self.depths if depth.frame}
        return {i: by_name[frame.name] for i, frame in enumerate(self.frames) if frame.name in by_name}

    @property
    def has_measured_depth(self) -> bool:
        """Whether most frames have a depth image, so that the fused cloud is measured rather than estimated."""
        return len(self.frames) > 0 and 2 * len(self.depth_of_frames) >= len(self.frames)

    @property
    def is_scanned(self) -> bool:
        """Whether the capture has a dense LiDAR scan, which shows glass, and floor that no image shows."""
        return self.cloud is not None and self.cloud.is_dense

    @property
    def trajectory_counts(self) -> bool:
        """Whether the trajectory is evidence of free space: a camera was carried, and there is no LiDAR scan, which is
        better evidence. The places of splat files are none."""
        return self.has_images and not self.is_scanned

    @property
    def is_measured(self) -> bool:
        """Whether a scanner or a depth camera measured the surfaces; otherwise they are estimated from images."""
        return self.is_scanned or self.has_measured_depth
