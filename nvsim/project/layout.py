"""The paths in a project folder. All code that needs such a path gets it here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from nvsim.files.frame_numbers import number_in
from nvsim.files.opening import PROJECT_DATABASE

CLOUD = "cloud.ply"
"""File of the depth stage: the fused cloud of all depth."""
ADDED = "added.ply"
"""File of the depth stage if the capture has a LiDAR scan: points that the LiDAR scan lacks."""


def model_name(submap: int) -> str:
    """Name of a submap's model for `Layout.in_use`."""
    return f"models/submap_{submap:03d}"


@dataclass(frozen=True)
class Layout:
    """The folder NAME.nvsim: a database for edited or queried data, and plain files for large data."""

    root: Path
    places: tuple[tuple[str, str], ...] = ()
    """Name of a result -> place of the one in use, relative to `root`, if the place differs from the name."""

    def in_use(self, name: str) -> Path:
        """The path of the result in use with a name such as "masks" or "models/submap_000"."""
        return self.root / next((place for known, place in self.places if known == name), name)

    @property
    def scan_name(self) -> str:
        """The R2R scan id of the project: the letters and digits of the folder's name, because agents split keys at
        underscores."""
        return "".join(c for c in self.root.stem if c.isascii() and c.isalnum()) or "scan"

    @property
    def database(self) -> Path:
        return self.root / PROJECT_DATABASE

    @property
    def lock(self) -> Path:
        return self.root / ".writer"

    @property
    def edits(self) -> Path:
        """The history of graph edits, and the only copy of unsaved ones."""
        return self.root / "edits.db"

    @property
    def imported(self) -> Path:
        """The imported capture: capture.json and the cloud, or the models of splat files. The images stay at their
        original paths."""
        return self.in_use("imported")

    @property
    def built_in_capture(self) -> Path:
        """The capture that the built-in building writes; only in demo projects."""
        return self.root / "capture"

    @property
    def ground_truth(self) -> Path:
        """Ground truth of the built-in building, never an input of the pipeline; only in demo projects."""
        return self.root / "ground_truth"

    @property
    def true_map(self) -> Path | None:
        """The true map of the built-in building, or the folder with those of its storeys; None if there is none."""
        one, several = self.ground_truth / "map.yaml", self.ground_truth / "storeys.json"
        return one if one.is_file() else self.ground_truth if several.is_file() else None

    def poses(self, number: int) -> Path:
        """The capture whose poses were computed from the `number`-th imported video, from 1."""
        return self.root / ("poses" if number == 1 else f"poses-{number}")

    @property
    def depth(self) -> Path:
        """Depth maps of the frames, and the point clouds from them."""
        return self.in_use("depth")

    @property
    def occupancy(self) -> Path:
        """The occupancy map that was built from the capture."""
        return self.root / "occupancy" / "map.yaml"

    @property
    def masks(self) -> Path:
        return self.in_use("masks")

    @property
    def corrections(self) -> Path:
        """Floor masks that users corrected; the floors stage does not change them."""
        return self.root / "corrections"

    @property
    def cache(self) -> Path:
        """Data that can be computed again at any time: thumbnails, candidate masks, coverage."""
        return self.root / "cache"

    @property
    def floor(self) -> Path:
        return self.in_use("floor")

    @property
    def support(self) -> Path:
        return self.floor / "support.npz"

    @property
    def raised(self) -> Path:
        """Places of thin obstacles above the floor, if they were searched."""
        return self.floor / "raised.npz"

    @property
    def models(self) -> Path:
        return self.root / "models"

    @property
    def checkpoints(self) -> Path:
        return self.root / "checkpoints"

    @property
    def pictures(self) -> Path:
        return self.root / "pictures"

    @property
    def logs(self) -> Path:
        return self.root / "logs"

    @property
    def jobs(self) -> Path:
        """One folder per job, see `joblist`."""
        return self.logs / "jobs"

    @property
    def measured_map(self) -> Path:
        """All evidence of the last map build, including that of places that are not in its graph."""
        return self.root / "map.measured"

    @property
    def walls(self) -> Path:
        """The walls that the last map build found, for captures without a LiDAR scan."""
        return self.root / "map.walls.npz"

    @property
    def partial_map(self) -> Path:
        """Evidence of an interrupted map build."""
        return self.checkpoints / "map.partial"

    def mask(self, number: int) -> Path:
        return self.masks / f"{number:06d}.png"

    def mask_of(self, frame_name: str, frame: int) -> Path:
        """NVSim's mask of a frame of the present capture. It does not exist if the masks are of other frames."""
        number = number_in(self.masks, frame_name, frame)
        return self.mask(number) if number >= 0 else self.masks / self.correction(frame_name).name

    def correction(self, frame_name: str) -> Path:
        """Slashes in the name are written as %2F, so that each correction is one file."""
        return self.corrections / f"{quote(frame_name, safe=' ', errors='surrogatepass')}.png"

    def mask_in_use(self, frame_name: str, frame: int) -> Path:
        """The user's correction of the floor mask of a frame if there is one, else NVSim's mask."""
        correction = self.correction(frame_name)
        return correction if correction.is_file() else self.mask_of(frame_name, frame)

    def surface(self, submap: int) -> Path:
        return self.floor / f"surface_{submap:03d}.npz"

    def model(self, submap: int) -> Path:
        """The trained model of a submap, or the one that was imported from a splat file."""
        imported = self.imported / model_name(submap)
        return imported if (imported / "model.json").is_file() else self.in_use(model_name(submap))

    def checkpoint(self, submap: int) -> Path:
        return self.checkpoints / f"submap_{submap:03d}.ckpt"

    def live_model(self, submap: int) -> Path:
        """A recent state of a model whose training runs or was interrupted, for display only."""
        return self.checkpoints / f"live_{submap:03d}"

    def preview(self, submap: int) -> Path:
        return self.pictures / f"preview_{submap:03d}.jpg"
