"""The file locations of a scan below the folder of an export, which may contain many scans.

Matterport3DSimulator uses the folder as its dataset path and `connectivity` as its path of navigation graphs.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.geometry.view_sweep import VIEWS
from nvsim.graph.connectivity import SUFFIX
from nvsim.graph.skybox_files import FOLDER, SkyboxFiles


@dataclass(frozen=True)
class ScanPlaces:
    """The folder `root` of an export, and one scan in it."""

    root: Path
    scan: str

    @property
    def folder(self) -> Path:
        """The folder of the images that the simulator reads, and of the manifest."""
        return self.root / self.scan

    @property
    def manifest(self) -> Path:
        return self.folder / "manifest.json"

    @property
    def journal(self) -> Path:
        """The list of finished parts of an unfinished export."""
        return self.folder / ".unfinished.jsonl"

    @property
    def lock(self) -> Path:
        return self.folder / ".writer"

    @property
    def images(self) -> Path:
        return self.folder / FOLDER

    @property
    def graphs(self) -> Path:
        return self.root / "connectivity"

    @property
    def connectivity(self) -> Path:
        return self.graphs / f"{self.scan}{SUFFIX}"

    @property
    def scans(self) -> Path:
        return self.graphs / "scans.txt"

    @property
    def views(self) -> Path:
        return self.root / "views" / self.scan

    @property
    def plans(self) -> Path:
        return self.root / "floor_plans" / self.scan

    def strip(self, viewpoint: str) -> Path:
        return SkyboxFiles(self.images).strip(viewpoint)

    def depth(self, viewpoint: str) -> Path:
        return SkyboxFiles(self.images).depth(viewpoint)

    def unseen(self, viewpoint: str) -> Path:
        return SkyboxFiles(self.images).unseen(viewpoint)

    def faces(self, viewpoint: str) -> list[Path]:
        return SkyboxFiles(self.images).faces(viewpoint)

    def sweep(self, viewpoint: str) -> list[Path]:
        """Returns the paths of the 36 views, in the order of viewIndex."""
        return [self.views / viewpoint / f"{i}.jpg" for i in range(VIEWS)]

    def holds(self, file: str) -> bool:
        """Whether a path below the root, as a manifest names it, is an image of this scan."""
        path = self.root / file
        here = path.parent in (self.images, self.plans) or path.parent.parent == self.views
        return here and ".." not in path.parts
