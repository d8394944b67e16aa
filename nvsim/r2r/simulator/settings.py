"""How a simulator is set up, under the names of Matterport3DSimulator."""

from __future__ import annotations

import math
from pathlib import Path


class Settings:
    """All but resolution, field of view and limits of elevation hold from `initialize` on and do not change after it.
    The images keep the size and the field of view that they had then; what is navigable goes by the newest ones."""

    def __init__(self) -> None:
        self.initialized = False
        self.dataset_path = Path("./data/v1/scans/")
        self.nav_graph_path: Path | None = None
        self.rendering_enabled, self.depth_enabled, self.preloading = True, False, False
        self.width, self.height = 320, 240
        self.vfov = 0.8
        self.lowest, self.highest = -0.94, 0.94
        self.discrete, self.restricted = False, True
        self.batch_size, self.batched = 1, False
        self.cache_size, self.seed = 200, 1

    def setDatasetPath(self, path: str | Path) -> None:
        """The folder of `<scan>/matterport_skybox_images/`, ./data/v1/scans/ by default; or a project, NAME.nvsim,
        whose trained models then draw every view, and whose graph is walked unless setNavGraphPath names another."""
        if not self.initialized:
            self.dataset_path = Path(path)

    def setNavGraphPath(self, path: str | Path) -> None:
        """The folder of scans.txt and the connectivity files, ./connectivity by default."""
        if not self.initialized:
            self.nav_graph_path = Path(path)

    def setRenderingEnabled(self, value: bool) -> None:
        """Whether views are drawn; True by default. Without it no images are needed and all stay black."""
        if not self.initialized:
            self.rendering_enabled = bool(value)

    def setCameraResolution(self, width: int, height: int) -> None:
        """Pixels; 320 x 240 by default. Raises ValueError for what is no size of an image."""
        if not (1 <= width <= 16384 and 1 <= height <= 16384):
            raise ValueError(f"An image cannot be {width}x{height} pixels; give sides from 1 to 16384.")
        self.width, self.height = int(width), int(height)

    def setCameraVFOV(self, vfov: float) -> None:
        """The vertical field of view in radians; 0.8 by default. Raises ValueError for one that is none."""
        if not 0 < vfov < math.pi:
            raise ValueError(f"A vertical field of view cannot be {vfov} radians; give one between 0 and pi.")
        self.vfov = float(vfov)

    def setElevationLimits(self, min: float, max: float) -> bool:
        """Radians, -0.94 and 0.94 by default; not asked where viewing angles are discrete. Returns whether they are
        taken: one must be below the horizon, the other above, both by less than a right angle."""
        if not -math.pi / 2 < min < 0.0 < max < math.pi / 2:
            return False
        self.lowest, self.highest = float(min), float(max)
        return True

    def setDiscretizedViewingAngles(self, value: bool) -> None:
        """Whether there are 12 headings and 3 elevations alone, 30 degrees apart; False by default."""
        if not self.initialized:
            self.discrete = bool(value)

    def setRestrictedNavigation(self, value: bool) -> None:
        """Whether only viewpoints in the horizontal field of view can be gone to; True by default."""
        if not self.initialized:
            self.restricted = bool(value)

    def setPreloadingEnabled(self, value: bool) -> None:
        """Whether `initialize` loads all images; False by default."""
        if not self.initialized:
            self.preloading = bool(value)

    def setDepthEnabled(self, value: bool) -> None:
        """Whether depth is drawn as well; False by default."""
        if not self.initialized:
            self.depth_enabled = bool(value)

    def setBatchSize(self, size: int) -> None:
        """Environments; 1 by default. Once it was called everything is given in lists. Raises ValueError below 1."""
        if size < 1:
            raise ValueError(f"A batch cannot hold {size} environments; give 1 or more.")
        if not self.initialized:
            self.batch_size, self.batched = int(size), True

    def setCacheSize(self, size: int) -> None:
        """Decoded skyboxes that are kept in memory (4.7 MB each at 512 pixels a face); 200 by default."""
        if not self.initialized:
            self.cache_size = int(size)

    def setSeed(self, seed: int) -> None:
        """Of viewpoints that are chosen at random; 1 by default."""
        if not self.initialized:
            self.seed = int(seed)
