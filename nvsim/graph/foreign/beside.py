"""Find the files that belong to a connectivity file: images of its viewpoints, a map, a point cloud."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from nvsim.capture.types import Cloud
from nvsim.errors import InputError
from nvsim.files.placeholders import is_metadata_name
from nvsim.graph.skybox_files import FOLDER
from nvsim.occupancy.types import OccupancyMap


@dataclass(frozen=True)
class Beside:
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


def look_beside(path: Path, scan: str) -> Beside:
    """Search the folder of a connectivity file and its parent folder for these files:

    - skyboxes as the simulator has them (`[scans/]SCAN/matterport_skybox_images/ID_skybox*`), or a folder of 36 views
      per viewpoint (`SCAN/ID/0.jpg`)
    - a ROS map or OctoMap, named after the scan or `map`
    - a PLY or PCD cloud, named after the scan or `cloud`
    """
    found = Beside()
    for folder in (path.parent, path.parent.parent):
        pictures = next((p for p in _picture_folders(folder, scan) if p.is_dir()), None)
        if found.images is None and pictures is not None:
            found = Beside(_ids_in(pictures), pictures, found.map, found.cloud)
        files = [folder / f"{name}{suffix}" for name in (scan, "map") for suffix in (".yaml", ".bt", ".ot")]
        clouds = [folder / f"{name}{suffix}" for name in (scan, "cloud") for suffix in (".ply", ".pcd")]
        map = found.map or next((p for p in files if p.is_file()), None)
        cloud = found.cloud or next((p for p in clouds if p.is_file()), None)
        found = Beside(found.images, found.pictures, map, cloud)
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
