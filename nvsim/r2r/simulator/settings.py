"""The settings of a simulator, with the method names of Matterport3DSimulator, and the dataset that they name."""

from __future__ import annotations

import math
from pathlib import Path

from nvsim.errors import InputError
from nvsim.r2r.simulator.conventions import InvalidValue
from nvsim.r2r.simulator.images import Images, StripImages
from nvsim.r2r.simulator.scan import NavGraph, Scans


class Settings:
    """The settings of a simulator. After `initialize`, only resolution, field of view and elevation limits can change.

    The images keep their initial size and field of view; the navigable locations use the newest ones.
    """

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
        """Sets the folder of `<scan>/matterport_skybox_images/`, by default ./data/v1/scans/, or a project, NAME.nvsim.

        The trained models of a project draw every view. Its graph is used unless setNavGraphPath is called.
        """
        if not self.initialized:
            self.dataset_path = Path(path)

    def setNavGraphPath(self, path: str | Path) -> None:
        """Sets the folder of scans.txt and the connectivity files, by default ./connectivity."""
        if not self.initialized:
            self.nav_graph_path = Path(path)

    def setRenderingEnabled(self, value: bool) -> None:
        """Sets whether views are drawn; True by default. If false, no images are needed and all views are black."""
        if not self.initialized:
            self.rendering_enabled = bool(value)

    def setCameraResolution(self, width: int, height: int) -> None:
        """Sets the image size in pixels; 320 x 240 by default. Raises ValueError if it is out of range."""
        if not (1 <= width <= 16384 and 1 <= height <= 16384):
            raise ValueError(f"An image cannot be {width}x{height} pixels; give sides from 1 to 16384.")
        self.width, self.height = int(width), int(height)

    def setCameraVFOV(self, vfov: float) -> None:
        """Sets the vertical field of view in radians; 0.8 by default. Raises ValueError if it is out of range."""
        if not 0 < vfov < math.pi:
            raise ValueError(f"A vertical field of view cannot be {vfov} radians; give one between 0 and pi.")
        self.vfov = float(vfov)

    def setElevationLimits(self, min: float, max: float) -> bool:
        """Sets the range of elevations in radians, by default -0.94 and 0.94; unused if viewing angles are discrete.

        Returns False, and changes nothing, unless -pi / 2 < min < 0 < max < pi / 2.
        """
        if not -math.pi / 2 < min < 0.0 < max < math.pi / 2:
            return False
        self.lowest, self.highest = float(min), float(max)
        return True

    def setDiscretizedViewingAngles(self, value: bool) -> None:
        """Sets whether there are only 12 headings and 3 elevations, 30 degrees apart; False by default."""
        if not self.initialized:
            self.discrete = bool(value)

    def setRestrictedNavigation(self, value: bool) -> None:
        """Sets whether only viewpoints in the horizontal field of view are navigable; True by default."""
        if not self.initialized:
            self.restricted = bool(value)

    def setPreloadingEnabled(self, value: bool) -> None:
        """Sets whether `initialize` loads all images; False by default."""
        if not self.initialized:
            self.preloading = bool(value)

    def setDepthEnabled(self, value: bool) -> None:
        """Sets whether depth is drawn too; False by default."""
        if not self.initialized:
            self.depth_enabled = bool(value)

    def setBatchSize(self, size: int) -> None:
        """Sets the number of environments; 1 by default. After this call, all arguments are lists.

        Raises ValueError below 1.
        """
        if size < 1:
            raise ValueError(f"A batch cannot hold {size} environments; give 1 or more.")
        if not self.initialized:
            self.batch_size, self.batched = int(size), True

    def setCacheSize(self, size: int) -> None:
        """Sets the number of decoded skyboxes in memory (4.7 MB each at 512 pixels per face); 200 by default."""
        if not self.initialized:
            self.cache_size = int(size)

    def setSeed(self, seed: int) -> None:
        """Sets the seed of randomly chosen viewpoints; 1 by default."""
        if not self.initialized:
            self.seed = int(seed)


def source_of(settings: Settings) -> tuple[Scans, Images]:
    """Returns the scans and the images that the settings name. Raises InvalidValue if a project is unreadable."""
    folder = settings.nav_graph_path
    if not (settings.dataset_path / "project.db").is_file():
        return NavGraph(folder or "./connectivity"), StripImages(settings.dataset_path, settings.cache_size)
    try:
        from nvsim.project.scene_views import read_live_scene  # imports torch, which is slow
        from nvsim.r2r.simulator.live import LiveImages
    except ModuleNotFoundError as error:  # the package nvsim-mattersim only reads exported files
        raise InvalidValue(f"{settings.dataset_path} is a project; export its scan, or install NVSim.") from error
    try:
        images = LiveImages(read_live_scene(settings.dataset_path, settings.rendering_enabled))
    except InputError as error:
        raise InvalidValue(str(error)) from error
    return (images.scans if folder is None else NavGraph(folder)), images
