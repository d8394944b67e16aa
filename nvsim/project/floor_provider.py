"""Who finds the floor: geometry, geometry fused with a network of looks, or the hybrid of the paper, whose three roles
networks or geometry play."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from nvsim.capture.types import Capture, Cloud
from nvsim.errors import InputError
from nvsim.networks.description import Role
from nvsim.networks.installed import Model, bundled_model, find_model
from nvsim.project.config import FloorsConfig

if TYPE_CHECKING:
    from nvsim.perception.fused import FusedFloor
    from nvsim.perception.geometric import GeometricFloor
    from nvsim.perception.hybrid import HybridFloor
    from nvsim.perception.normals_network import NormalsNetwork
    from nvsim.perception.prompted_network import PromptedNetwork
    from nvsim.perception.roles import FloorSegmenter, SemanticFloor, SurfaceNormals

ROLES: tuple[Role, ...] = ("semantic", "normals", "prompted")
GEOMETRY, AUTO = "geometry", "auto"
_VERSIONS = {"fused": 5, "hybrid": 6}
"""Raised when the same inputs give something else."""
_PLAYED_BY_GEOMETRY: dict[Role, str] = {
    "semantic": "the floor's known looks", "normals": "the cloud", "prompted": "growing over the normals",
}  # fmt: skip


@dataclass(frozen=True)
class FloorProvider:
    """models   by role: of the hybrid those whose role no model plays are played by geometry; of fused that of looks,
             and beside depth of images that of normals
    because  why `auto` took it, "" where it was said
    """

    how: Literal["geometry", "fused", "hybrid"]
    models: dict[Role, Model]
    because: str = ""

    @property
    def words(self) -> str:
        """Who finds the floor, for the log."""
        who = "geometry"
        if self.how == "fused":
            who = f"geometry, with {self.models['semantic'].name} where it leaves the floor open"
            if "normals" in self.models:
                who += f" and normals by {self.models['normals'].name} where the images give no depth"
        elif self.how == "hybrid":
            played = (f"{r} by {self._name(r)}" for r in ROLES)
            who = f"the hybrid: {', '.join(played)}"
        return f"by {who}{self.because and f' ({self.because})'}"

    def _name(self, role: Role) -> str:
        model = self.models.get(role)
        return model.name if model else f"{GEOMETRY} ({_PLAYED_BY_GEOMETRY[role]})"

    @property
    def summary(self) -> dict[str, Any]:
        """For the record of the stage."""
        asked = {"geometry": (), "fused": tuple(self.models), "hybrid": ROLES}[self.how]
        names = {role: self.models[role].name if role in self.models else GEOMETRY for role in ROLES if role in asked}
        return {"provider": self.how, **{str(role): name for role, name in names.items()}}

    def key(self) -> list[object]:
        """What the masks depend on; nothing for geometry alone, as before there was a choice. Raises InputError for a
        file that cannot be read."""
        if self.how == "geometry":
            return []
        return [self.how, _VERSIONS[self.how], [[role, model.digest()] for role, model in sorted(self.models.items())]]

    def open(self, capture: Capture) -> Callable[[GeometricFloor, Cloud | None], FloorSegmenter] | None:
        """What makes the provider of a geometric one, its networks opened; None for geometry alone. Raises InputError
        for a network that cannot be used, and where it must look at the images of `capture` for one that cannot be
        read."""
        if self.how == "geometry":
            return None
        hybrid = Hybrid(self, capture)
        hybrid.open_all()
        if self.how == "fused":
            return hybrid.fused
        _ = hybrid.normals
        return hybrid


class Hybrid:
    """The hybrid with each of its networks opened once, when it is needed, for the floors of all submaps."""

    def __init__(self, provider: FloorProvider, capture: Capture) -> None:
        self._models, self._capture = provider.models, capture

    @cached_property
    def semantic(self) -> SemanticFloor | None:
        from nvsim.perception.semantic_network import SemanticNetwork

        return SemanticNetwork(self._models["semantic"].open()) if "semantic" in self._models else None

    @cached_property
    def normals(self) -> SurfaceNormals | None:
        from nvsim.perception.main_directions import StraightNormals

        network = self.seen_normals
        return None if network is None else StraightNormals.of_capture(network, self._capture.frames)

    @cached_property
    def seen_normals(self) -> NormalsNetwork | None:
        """What a network of normals says, not straightened: what is near an edge stays in doubt."""
        from nvsim.perception.normals_network import NormalsNetwork

        return NormalsNetwork(self._models["normals"].open()) if "normals" in self._models else None

    @cached_property
    def prompted(self) -> PromptedNetwork | None:
        from nvsim.perception.prompted_network import PromptedNetwork

        return PromptedNetwork(self._models["prompted"].open()) if "prompted" in self._models else None

    def open_all(self) -> None:
        """Raises InputError for a network that cannot be used."""
        _ = self.semantic, self.seen_normals, self.prompted

    def fused(self, floor: GeometricFloor, cloud: Cloud | None) -> FusedFloor:
        """Geometry with the networks of looks and, where there is one, of normals."""
        from nvsim.perception.fused import FusedFloor

        assert self.semantic is not None
        return FusedFloor(floor, self.semantic, self.seen_normals)

    def __call__(self, floor: GeometricFloor, cloud: Cloud | None) -> HybridFloor:
        """The HybridFloor beside a GeometricFloor and its cloud, which play the roles that no network plays."""
        from nvsim.perception.geometric_roles import CloudNormals, FloorLooks
        from nvsim.perception.hybrid import HybridFloor
        from nvsim.perception.regions import RegionGrowing

        return HybridFloor(
            self.semantic or FloorLooks(floor), self.normals or CloudNormals(floor, cloud),
            self.prompted or RegionGrowing(),
        )  # fmt: skip


def choose(config: FloorsConfig, scan: Callable[[], Cloud | None]) -> FloorProvider:
    """Who finds the floor of a capture; `scan` gives its scan, or the cloud of its images, and is asked where it
    matters. Beside either `auto` takes the network that comes with NVSim, where no other is installed.

    Raises InputError for a role's name that is not installed, and for one that the named provider does not ask.
    """
    named = {role: name for role in ROLES if (name := getattr(config, role)) != AUTO}
    asked = {"geometry": (), "fused": ("semantic",)}.get(config.provider, ROLES)
    for role, name in named.items():
        if role not in asked:
            raise InputError(
                f"--provider {config.provider} does not ask --{role} {name}; leave it out, or say --provider hybrid."
            )
    if config.provider == "geometry":
        return FloorProvider("geometry", {})
    if config.provider == "hybrid" or named.keys() & {"normals", "prompted"}:
        models = _models(config, ROLES)
        return FloorProvider("hybrid", models, "" if models else "no networks are installed; geometry alone is better")
    looks = _models(config, ("semantic",), config.provider == "fused")
    cloud = scan()
    faces = _models(config, ("normals",), True) if cloud is not None and cloud.kind == "images" else {}
    if config.provider == "fused":
        if not looks:
            raise InputError("No network of looks is installed to be fused with geometry; `nvsim models` lists some.")
        return FloorProvider("fused", looks | faces)
    dense = cloud is not None and cloud.is_dense
    if not looks and dense:
        looks = _models(config, ("semantic",), True)
    if not looks:
        return FloorProvider("geometry", {}, "no network of looks is installed")
    if dense:
        return FloorProvider("fused", looks | faces, "a scan or depth shows what stands on the floor")
    models = _models(config, ROLES)
    if "normals" not in models:
        return FloorProvider("geometry", {}, "no network of normals is installed")
    return FloorProvider("hybrid", models, "nothing but networks shows what stands on the floor")


def _models(config: FloorsConfig, roles: tuple[Role, ...], ours: bool = False) -> dict[Role, Model]:
    """The installed models of the roles; with `ours` that which comes with NVSim where there is none. Raises InputError
    for a name that none of them has."""
    found: dict[Role, Model] = {}
    for role in roles:
        name = getattr(config, role)
        model = None if name == GEOMETRY else find_model(role, "" if name == AUTO else name)
        if model is None and name == AUTO and ours:
            model = bundled_model(role)
        if model is not None:
            found[role] = model
    return found
