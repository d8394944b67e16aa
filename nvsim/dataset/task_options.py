"""The options of tasks, which are also options of the commands that make them."""

from __future__ import annotations

from dataclasses import dataclass, field

from nvsim.r2r.instructions import Register
from nvsim.r2r.tasks.shortest import PathBounds
from nvsim.r2r.tasks.splitting import PathCounts


@dataclass(frozen=True)
class TaskOptions:
    """Options of the tasks of a dataset."""

    unseen: tuple[str, ...] = ()
    """Scans that only val_unseen enters, as a whole. Default: a region of every scan."""
    instructions: int = 3
    """Number of instructions per path, generated from turns, distances, slopes and visible objects; 0 for none."""
    landmarks: bool = True
    """Name doorways, corridors, objects and the floor too, if the scans have strips with depth."""
    objects: str = ""
    """Installed semantic network that names objects by their looks (see nvsim models), such as segformer-b4-ade20k.
    Default: names by color, size, and form."""
    register: Register = "short"
    """Style of the instructions. short: about 25 words without meters, as in R2R. detailed: every fact in a clause of
    its own. rxr: long descriptions with meters, as in RxR."""
    vlnce: bool = False
    """Also write the tasks as VLN-CE episodes, with actions that follow the paths. Needs strips with depth."""
    streamvln: bool = False
    """Also write the tasks as StreamVLN annotations, with these actions."""
    rxr: bool = False
    """Also write the tasks as RxR guide annotations with pose traces, and with --vlnce as RxR-VLN-CE episodes. Use it
    with --register rxr."""
    goals: bool = False
    """Also write goals without language: PointNav, ObjectNav, and image goals for Habitat, and remote objects
    for REVERIE and SOON. Needs strips with depth."""
    amounts: PathCounts = field(default_factory=PathCounts)
    bounds: PathBounds = field(default_factory=PathBounds)

    @property
    def strips(self) -> bool:
        """Whether strips with depth are required."""
        return self.episodes or self.goals

    @property
    def episodes(self) -> bool:
        """Whether the paths become episodes with small steps."""
        return self.vlnce or self.streamvln
