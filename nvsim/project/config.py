"""The configuration of a whole run: one dataclass per stage, each with the paper's values as defaults."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Literal

from nvsim.capture.axes import Axes
from nvsim.depth.config import DepthConfig
from nvsim.mapping.config import MappingConfig
from nvsim.submaps.split import SubmapConfig
from nvsim.training.config import TrainingConfig

DepthUse = Literal["auto", "always", "never"]
"""Whether depth is estimated from the images: "auto" where the capture has no scan."""
PoseUse = Literal["auto", "given", "refined"]


@dataclass(frozen=True)
class FloorsConfig:
    """Who finds the floor."""

    provider: Literal["auto", "geometry", "fused", "hybrid"] = "auto"
    """Geometry: the cloud and how the floor looks; fused: geometry, and a network of looks where it leaves floor open;
    hybrid: the paper's three roles, by networks where some are installed; auto: by the capture and what is installed,
    the first two where a scan or depth shows what stands there."""
    semantic: str = "auto"
    """Who knows floor by its looks: a model's name (nvsim models; bundled is NVSim's own), geometry, or auto for one
    that is installed."""
    normals: str = "auto"
    """Who knows which way surfaces face in the hybrid: a model's name, geometry, or auto."""
    prompted: str = "auto"
    """Who finds the region at points in the hybrid: a model's name, geometry, or auto."""


@dataclass(frozen=True)
class CaptureConfig:
    """How the source is understood."""

    scale: float | None = None
    """Metres per unit of the capture, when it does not know."""
    camera_height: float | None = None
    """Metres of the cameras above the floor; gives the scale of a capture that has none."""
    known_length: str = ""
    """IMAGE,IMAGE,METERS: the names of two images and the distance between their cameras; gives the scale."""
    hold_out: int = 8
    """Every how many frames one is kept out of training, for evaluation; 0 keeps none out."""
    leave_out: str = ""
    """Names of frames that are not imported, with commas between them, or @FILE with a name on each line: those with a
    wrong pose, say."""
    images: str = ""
    """The folder that holds the images, where they do not lie where the capture says."""
    axes: Axes = "auto"
    """The convention of the camera axes in the files; auto is the format's own. With -inverse, poses are in the
    opposite direction of what the format says."""
    model: str = ""
    """Which of several COLMAP models, or of several pieces of a video, is read, by its folder (1, or sparse/1); left
    out, the one with most images."""
    poses: PoseUse = "auto"
    """Given: as they came. Refined: adjusted to what the images show in common, where that brings it closer together.
    Auto: refined where no scan or depth comes with the images and they contradict the given poses."""
    views: int | None = None
    """Into how many views panoramas of a 360 degree camera are cut: 4 level ones, 8 with four that look 45 degrees
    down, or 12 with four more that look 45 degrees up. If left out, NVSim keeps the number before, or else uses 4."""
    mask: str = ""
    """A PNG file of the proportions of the panoramas in which black is ignored, in place of the mask of the carrier of
    the camera that NVSim finds."""

    @property
    def key(self) -> dict[str, dict[str, object]]:
        """What the import's key holds of it. An option that came later counts where it is used only, so that what was
        imported before stays current."""
        values = asdict(self)
        for later in ("known_length", "leave_out", "images", "model", "views", "mask"):
            if not values[later]:
                del values[later]
        for later in ("axes", "poses"):
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
    """Indices of the frames that are never trained on: frame every//2 and then every `every`-th, in capture order."""
    return frozenset(range(every // 2, count, every)) if every > 0 else frozenset()
