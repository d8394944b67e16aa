"""Names of the image files of a scan in Matterport3D's folders, as Matterport3DSimulator reads them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.geometry.directions import NAMES

FOLDER = "matterport_skybox_images"


@dataclass(frozen=True)
class SkyboxFiles:
    """Paths of the images in one `folder`, by the id of their viewpoint."""

    folder: Path

    def strip(self, viewpoint: str) -> Path:
        """Return the path of the image with the six faces side by side."""
        return self.folder / f"{viewpoint}_skybox_small.jpg"

    def depth(self, viewpoint: str) -> Path:
        """Return the path of the strip of distances: 16 bits, in steps of 0.25 mm."""
        return self.folder / f"{viewpoint}_skybox_depth_small.png"

    def unseen(self, viewpoint: str) -> Path:
        """Return the path of the mask of the strip: 255 for pixels whose surfaces no training image shows, else 0."""
        return self.folder / f"{viewpoint}_skybox_unseen_small.png"

    def faces(self, viewpoint: str) -> list[Path]:
        """Return the paths of the six single faces, as version 0.1 of the simulator reads them."""
        return [self.folder / f"{viewpoint}_skybox{i}_sami.jpg" for i in range(len(NAMES))]
