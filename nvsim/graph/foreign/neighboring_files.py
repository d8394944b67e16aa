"""The files that belong to a connectivity file: images of its viewpoints, a map, a point cloud; and one panorama of a
viewpoint from its images.

Skyboxes have six faces of 90 degrees in the frame of the viewpoint's pose (`nvsim.geometry.directions`), as a strip
or as single files. The 36 discretized views are in the world frame (`nvsim.geometry.directions`)."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim.errors import InputError
from nvsim.files.images import decode_pixels, image_size_of
from nvsim.files.opening import is_regular, read_bytes
from nvsim.files.placeholders import is_metadata_name
from nvsim.geometry.directions import VFOV, VIEWS, face_axes, sweep
from nvsim.graph.skybox_files import FOLDER, SkyboxFiles
from nvsim.occupancy.types import OccupancyMap


@dataclass(frozen=True)
class FilesBeside:
    """Files found near a connectivity file.

    images      ids of the viewpoints that have images, None if no folder of images was found
    pictures    that folder
    map, cloud  files, None if there are none
    """

    images: frozenset[str] | None = None
    pictures: Path | None = None
    map: Path | None = None
    cloud: Path | None = None

    def occupancy(self) -> OccupancyMap | None:
        """Read the map; None if there is none. Raises InputError if it cannot be read."""
        if self.map is None:
            return None
        from nvsim.occupancy.read import read_map

        return read_map(self.map)

    def points(self) -> Cloud | None:
        """Read the point cloud; None if there is none. Raises InputError if it cannot be read."""
        if self.cloud is None:
            return None
        from nvsim.capture.findings import Findings
        from nvsim.capture.pointcloud import read_cloud

        return read_cloud(self.cloud, Findings())


def find_files_beside(path: Path, scan: str) -> FilesBeside:
    """Search the folder of a connectivity file and its parent folder for these files:

    - skyboxes as the simulator has them (`[scans/]SCAN/matterport_skybox_images/ID_skybox*`), or a folder of 36 views
      per viewpoint (`SCAN/ID/0.jpg`)
    - a ROS map or OctoMap, named after the scan or `map`
    - a PLY or PCD cloud, named after the scan or `cloud`
    """
    found = FilesBeside()
    for folder in (path.parent, path.parent.parent):
        pictures = next((p for p in _picture_folders(folder, scan) if p.is_dir()), None)
        if found.images is None and pictures is not None:
            found = FilesBeside(_ids_in(pictures), pictures, found.map, found.cloud)
        files = [folder / f"{name}{suffix}" for name in (scan, "map") for suffix in (".yaml", ".bt", ".ot")]
        clouds = [folder / f"{name}{suffix}" for name in (scan, "cloud") for suffix in (".ply", ".pcd")]
        map = found.map or next((p for p in files if p.is_file()), None)
        cloud = found.cloud or next((p for p in clouds if p.is_file()), None)
        found = FilesBeside(found.images, found.pictures, map, cloud)
    return found


def _picture_folders(folder: Path, scan: str) -> tuple[Path, ...]:
    places = (folder / "scans" / scan, folder / "v1" / "scans" / scan, folder / scan, folder)
    return (*(p / FOLDER for p in places), folder / scan, folder / "images" / scan)


def _ids_in(pictures: Path) -> frozenset[str]:
    try:
        with os.scandir(pictures) as rows:
            names = [(row.name, row.is_dir()) for row in rows if not is_metadata_name(row.name)]
    except OSError as error:
        raise InputError(f"Cannot list the images in {pictures}: {error.strerror}; check the folder.") from error
    ids = {name.split("_skybox")[0] for name, is_dir in names if not is_dir and "_skybox" in name}
    return frozenset(ids | {name for name, is_dir in names if is_dir})


_FREE_PIXELS, _PIXELS_PER_BYTE = 20_000_000, 8
"""Maximum pixels of all images of a viewpoint together: a base amount, and an amount per byte of the files."""


@dataclass(frozen=True)
class _View:
    """image (H, W, 3) uint8; axes (3, 3) right, down and forward in the world; focal in pixels"""

    image: NDArray[np.uint8]
    axes: NDArray[np.float64]
    focal: float


def panorama(beside: FilesBeside, id: str, rotation: NDArray[np.float64], width: int) -> NDArray[np.uint8] | None:
    """Return the panorama of a viewpoint: (W / 2, W, 3) uint8, blue, green, red, with north (+y) in the middle, east to
    its right, and up at the top. Pixels without a view are black. `rotation` (3, 3) is that of the viewpoint's pose.

    Returns None if the viewpoint has no image. Raises InputError if an image cannot be read.
    """
    views = _views(beside, id, rotation)
    return _sample_panorama(views, width) if views else None


def _views(beside: FilesBeside, id: str, rotation: NDArray[np.float64]) -> list[_View]:
    folder = beside.pictures
    if folder is None or id not in (beside.images or ()):
        return []  # also refuses ids that would lead out of the folder
    files = SkyboxFiles(folder)
    strip, faces = files.strip(id), files.faces(id)
    if is_regular(strip):
        pixels = _read(strip)
        side = pixels.shape[0]
        if pixels.shape[1] != 6 * side:
            size = f"{pixels.shape[1]} x {side}"
            raise InputError(f"{strip} is {size} pixels; a skybox has six square faces side by side.")
        images = [np.ascontiguousarray(pixels[:, k * side : (k + 1) * side]) for k in range(6)]
    elif is_regular(faces[0]):
        images = [_read(face, len(faces)) for face in faces]
    else:
        return _thirty_six(folder / id)
    axes = np.swapaxes(face_axes(), 1, 2) @ rotation.T
    return [_View(image, axes[k], image.shape[1] / 2) for k, image in enumerate(images)]


def _thirty_six(folder: Path) -> list[_View]:
    views: list[_View] = []
    names = _names_in(folder)
    for k, camera in enumerate(sweep(np.zeros(3))):
        path = folder / f"{k}.jpg"
        if path.name not in names:
            continue
        image = _read(path, len(names))
        focal = image.shape[0] / 2 / math.tan(VFOV / 2)
        views.append(_View(image, camera.camera_to_world[:3, :3].T, focal))
    return views


def _names_in(folder: Path) -> set[str]:
    return {f"{k}.jpg" for k in range(VIEWS) if is_regular(folder / f"{k}.jpg")}


def _read(path: Path, together: int = 1) -> NDArray[np.uint8]:
    """Read one of `together` images that are held in memory at once."""
    import cv2

    data = read_bytes(path)
    found = image_size_of(data)
    if found is not None and found.width * found.height > _FREE_PIXELS // together + _PIXELS_PER_BYTE * len(data):
        raise InputError(
            f"{path} has {found.width} x {found.height} pixels, too many for its {len(data)} bytes; save it again."
        )
    image = decode_pixels(data, path, cv2.IMREAD_COLOR, what="an image", then="save it again as JPEG")
    return np.asarray(image, np.uint8)


def _sample_panorama(views: list[_View], width: int) -> NDArray[np.uint8]:
    """Sample each pixel from the view whose axis is nearest to its ray."""
    import cv2

    height = width // 2
    heading = (np.arange(width) + 0.5) / width * 2 * math.pi - math.pi
    elevation = math.pi / 2 - (np.arange(height) + 0.5) / height * math.pi
    flat = np.cos(elevation)[:, None]
    up = np.broadcast_to(np.sin(elevation)[:, None], (height, width))
    rays = np.stack([np.sin(heading) * flat, np.cos(heading) * flat, up], axis=-1).astype(np.float32)
    result = np.zeros((height, width, 3), np.uint8)
    best = np.full((height, width), 1e-3, np.float32)
    owner = np.full((height, width), -1, np.int8)
    for k, view in enumerate(views):
        ahead = rays @ view.axes[2].astype(np.float32)
        nearer = ahead > best
        best[nearer], owner[nearer] = ahead[nearer], k
    for k, view in enumerate(views):
        rows, columns = np.nonzero(owner == k)
        if not len(rows):
            continue
        seen = rays[rows, columns] @ view.axes.T.astype(np.float32)
        lines, across = view.image.shape[:2]
        u = view.focal * seen[:, 0] / seen[:, 2] + across / 2 - 0.5
        v = view.focal * seen[:, 1] / seen[:, 2] + lines / 2 - 0.5
        inside = (u > -1) & (u < across) & (v > -1) & (v < lines)
        rows, columns = rows[inside], columns[inside]
        # OpenCV allows fewer than 32,768 lines in a map, so the pixels are arranged as a rectangle.
        count = len(rows)
        lot = math.ceil(count / 16384) * 16384
        u, v = (np.resize(part[inside], lot).reshape(-1, 16384) for part in (u, v))
        taken = cv2.remap(view.image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        result[rows, columns] = taken.reshape(-1, 3)[:count]
    return result
