"""What the images of a scan are called in Matterport3D's folders, as Matterport3DSimulator reads them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.geometry.skybox_faces import NAMES

FOLDER = "matterport_skybox_images"


@dataclass(frozen=True)
class SkyboxFiles:
    """The images in one `folder`, by the id of their viewpoint."""

    folder: Path

    def strip(self, viewpoint: str) -> Path:
        """The six faces side by side."""
        return self.folder / f"{viewpoint}_skybox_small.jpg"

    def depth(self, viewpoint: str) -> Path:
        """The same of distances, 0.25 mm, 16 bits."""
        return self.folder / f"{viewpoint}_skybox_depth_small.png"

    def faces(self, viewpoint: str) -> list[Path]:
        """The six single faces, as the simulator's version 0.1 reads them."""
        return [self.folder / f"{viewpoint}_skybox{i}_sami.jpg" for i in range(len(NAMES))]
