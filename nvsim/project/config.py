"""The options of a complete run: one dataclass per stage, with the paper's values as defaults."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Literal

from nvsim.capture.axes import Axes
from nvsim.depth.config import DepthConfig
from nvsim.mapping.config import MappingConfig
from nvsim.submaps.split import SubmapConfig
from nvsim.training.config import TrainingConfig

DepthUse = Literal["auto", "always", "never"]
"""Whether depth is estimated from the images; "auto": if the capture has no LiDAR scan."""
PoseUse = Literal["auto", "given", "refined"]


@dataclass(frozen=True)
class FloorsConfig:
    """How NVSim finds the floor."""

    provider: Literal["auto", "geometry", "fused", "hybrid"] = "auto"
    """Method. geometry: the point cloud and the appearance of the floor; fused: geometry, and a semantic network for
    pixels that geometry leaves undecided; hybrid: the paper's three roles, by networks if installed; auto: geometry or
    fused if a LiDAR scan or depth shows obstacles, else selected by the installed networks."""
    semantic: str = "auto"
    """Model that recognizes floor by its appearance: a name (see nvsim models; bundled is NVSim's own), geometry, or
    auto for an installed one."""
    normals: str = "auto"
    """Model that estimates surface normals for the hybrid: a name, geometry, or auto."""
    prompted: str = "auto"
    """Model that segments the region at given points for the hybrid: a name, geometry, or auto."""


@dataclass(frozen=True)
class CaptureConfig:
    """How NVSim reads the source."""

    scale: float | None = None
    """Meters per unit of the capture, if its files do not define the unit."""
    camera_height: float | None = None
    """Height of the cameras above the floor in meters; sets the scale of a capture without one. For splat files, the
    height of the viewpoints (1.5)."""
    known_length: str = ""
    """IMAGE,IMAGE,METERS: the names of two images and the distance between their cameras; sets the scale."""
    hold_out: int = 8
    """Every n-th frame is held out of training for evaluation; 0 holds out none."""
    leave_out: str = ""
    """Names of frames to skip, separated by commas, or @FILE with one name per line; for example frames with a wrong
    pose."""
    images: str = ""
    """Folder of the images, if they are not at the paths that the capture names."""
    axes: Axes = "auto"
    """Convention of the camera axes in the files; auto uses that of the format. With -inverse, poses have the opposite
    direction (camera-to-world or world-to-camera) of the format."""
    model: str = ""
    """Which of several COLMAP models, or pieces of a video, to read, by its folder (1, or sparse/1). If left out, the
    one with the most images."""
    poses: PoseUse = "auto"
    """given: poses as in the files; refined: adjusted to matches between images if that reduces their error; auto:
    refined if the capture has no LiDAR scan and the images contradict the given poses."""
    views: int | None = None
    """Number of views per panorama of a 360 degree camera: 4 level views, 8 with four that look 45 degrees down, or 12
    with four more that look 45 degrees up. If left out, NVSim keeps the number of the last import, or uses 4."""
    up: Literal["auto", "z", "-z", "y", "-y", "x", "-x"] = "auto"
    """Up axis of a splat file; auto finds it from the floors, ceilings and furniture."""
    clean: bool = False
    """Remove the floaters and the fog of a splat file: Gaussians that most views of the free space see through, and
    those outside the building. `nvsim splat clean` and the window restore them."""
    mask: str = ""
    """PNG file with the proportions of the panoramas. Black pixels are ignored. It replaces the mask that NVSim makes
    of the person or tripod that carries the camera."""
    features: str = ""
    """Installed network that finds and matches keypoints of a video or photographs (see nvsim models). It is compared
    with SIFT on a sample of pairs, and used if it is better. none: SIFT. If left out, NVSim keeps that of the last
    import."""
    people: str = ""
    """Installed network that recognizes people in a video or photographs (see nvsim models). People are masked: they
    have no features, depth, floor or training loss. none: no masks. If left out, NVSim keeps that of the last
    import."""

    @property
    def key(self) -> dict[str, dict[str, object]]:
        """The part of the import's key that depends on these options. Options of later versions only count if they are
        used, so that existing imports stay current."""
        values = asdict(self)
        for later in ("known_length", "leave_out", "images", "model", "views", "mask", "clean", "features", "people"):
            if not values[later]:
                del values[later]
        for later in ("axes", "poses", "up"):
            if values[later] == "auto":
                del values[later]
        return {type(self).__name__: values}


@dataclass(frozen=True)
class RunConfig:
    """The stages after the import."""

    submaps: SubmapConfig = field(default_factory=SubmapConfig)
    depth: DepthConfig = field(default_factory=DepthConfig)
    floors: FloorsConfig = field(default_factory=FloorsConfig)
    train: TrainingConfig = field(default_factory=TrainingConfig)
    map: MappingConfig = field(default_factory=MappingConfig)


def held_out(count: int, every: int) -> frozenset[int]:
    """Indices of the held-out frames: frame every//2, and then every `every`-th, in capture order."""
    return frozenset(range(every // 2, count, every)) if every > 0 else frozenset()
