"""Where things lie in a project folder. Every path of the project is made here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from nvsim.files.opening import PROJECT_DATABASE


def model_name(submap: int) -> str:
    """What `Layout.in_use` calls the model of a submap."""
    return f"models/submap_{submap:03d}"


@dataclass(frozen=True)
class Layout:
    """The folder NAME.nvsim: a database for what is edited or queried, plain files for what is big."""

    root: Path
    places: tuple[tuple[str, str], ...] = ()
    """Name of a result -> where the one in use lies below `root`, for those that do not lie under their name."""

    def in_use(self, name: str) -> Path:
        """The path of a result, "masks" or "models/submap_000": that of the generation in use."""
        return self.root / next((place for known, place in self.places if known == name), name)

    @property
    def database(self) -> Path:
        return self.root / PROJECT_DATABASE

    @property
    def lock(self) -> Path:
        return self.root / ".writer"

    @property
    def edits(self) -> Path:
        """The history of the graph's edits; what of it is not saved yet is in no other file."""
        return self.root / "edits.db"

    @property
    def imported(self) -> Path:
        """The capture as it was read: capture.json and the cloud. The images stay where they are."""
        return self.in_use("imported")

    @property
    def built_in_capture(self) -> Path:
        """The ordinary capture that the built-in building writes; only in demo projects."""
        return self.root / "capture"

    @property
    def ground_truth(self) -> Path:
        """The truth of the built-in building, never an input of the pipeline; only in demo projects."""
        return self.root / "ground_truth"

    @property
    def true_map(self) -> Path | None:
        """The true map of the built-in building, or the folder with those of its storeys; None where there is none."""
        one, several = self.ground_truth / "map.yaml", self.ground_truth / "storeys.json"
        return one if one.is_file() else self.ground_truth if several.is_file() else None

    def poses(self, number: int) -> Path:
        """The capture whose poses were computed from the `number`-th video that was imported, from 1."""
        return self.root / ("poses" if number == 1 else f"poses-{number}")

    @property
    def depth(self) -> Path:
        """Depth maps of the images and the clouds that they make together."""
        return self.in_use("depth")

    @property
    def occupancy(self) -> Path:
        """The occupancy map that was built of what the capture has."""
        return self.root / "occupancy" / "map.yaml"

    @property
    def masks(self) -> Path:
        return self.in_use("masks")

    @property
    def corrections(self) -> Path:
        """Floor masks as a user corrected them; finding the floors again leaves them alone."""
        return self.root / "corrections"

    @property
    def cache(self) -> Path:
        """What can be made again at any time: thumbnails, candidate masks, coverage."""
        return self.root / "cache"

    @property
    def floor(self) -> Path:
        return self.in_use("floor")

    @property
    def support(self) -> Path:
        return self.floor / "support.npz"

    @property
    def raised(self) -> Path:
        """Where thin things stand above the floor, if that was looked for."""
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
        """A folder for each job that was ordered, see `joblist`."""
        return self.logs / "jobs"

    @property
    def measured_map(self) -> Path:
        """All evidence that the last map was built from, also of places that its graph does not have."""
        return self.root / "map.measured"

    @property
    def partial_map(self) -> Path:
        """What a map building that was cut off had measured."""
        return self.checkpoints / "map.partial"

    def mask(self, frame: int) -> Path:
        return self.masks / f"{frame:06d}.png"

    def correction(self, frame_name: str) -> Path:
        """Slashes of the name are written as %2F, so that every name is one file."""
        return self.corrections / f"{quote(frame_name, safe=' ', errors='surrogatepass')}.png"

    def surface(self, submap: int) -> Path:
        return self.floor / f"surface_{submap:03d}.npz"

    def model(self, submap: int) -> Path:
        return self.in_use(model_name(submap))

    def checkpoint(self, submap: int) -> Path:
        return self.checkpoints / f"submap_{submap:03d}.ckpt"

    def live(self, submap: int) -> Path:
        """The model as it was a moment ago, of a training that goes on or was cut off; only to be looked at."""
        return self.checkpoints / f"live_{submap:03d}"

    def preview(self, submap: int) -> Path:
        return self.pictures / f"preview_{submap:03d}.jpg"
