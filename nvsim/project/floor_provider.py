"""Selects the method that finds the floor: geometry, geometry fused with a semantic network, or the paper's hybrid. In
the hybrid, networks or geometry fill three roles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from nvsim.capture.types import Capture, Cloud
from nvsim.errors import InputError
from nvsim.events import Listener, Log, ignore_event
from nvsim.networks.description import Role
from nvsim.networks.installed import InstalledModel, bundled_model, find_model
from nvsim.project.config import FloorsConfig

if TYPE_CHECKING:
    from nvsim.perception.fused import FusedFloor
    from nvsim.perception.geometric import GeometricFloor
    from nvsim.perception.hybrid import HybridFloor
    from nvsim.perception.normals_network import NormalsNetwork
    from nvsim.perception.prompted_network import PromptedNetwork
    from nvsim.perception.roles import FloorSegmenter, SemanticFloor, SurfaceNormals
    from nvsim.perception.segment import Surroundings

ROLES: tuple[Role, ...] = ("semantic", "normals", "prompted")
GEOMETRY, AUTO = "geometry", "auto"
_VERSIONS = {"fused": 6, "hybrid": 6}
"""Increased when equal inputs give another result."""
_TOO_SURE = 1.5  # temperature from which on the user is told
_PLAYED_BY_GEOMETRY: dict[Role, str] = {
    "semantic": "the floor's known appearance", "normals": "the cloud", "prompted": "region growing over normals",
}  # fmt: skip


@dataclass(frozen=True)
class FloorProvider:
    """The selected method and its networks.

    models  networks by role. In the hybrid, geometry fills roles without a network. For fused, the semantic network,
            and the normals network if the depth is estimated from images
    reason  reason why `auto` selected it, "" if the user named it
    """

    method: Literal["geometry", "fused", "hybrid"]
    models: dict[Role, InstalledModel]
    reason: str = ""

    @property
    def description(self) -> str:
        """The method in words, for the log."""
        who = "geometry"
        if self.method == "fused":
            who = f"geometry, with {self.models['semantic'].name} where geometry leaves the floor undecided"
            if "normals" in self.models:
                who += f" and normals by {self.models['normals'].name} where the images give no depth"
        elif self.method == "hybrid":
            played = (f"{r} by {self._name(r)}" for r in ROLES)
            who = f"the hybrid: {', '.join(played)}"
        return f"by {who}{self.reason and f' ({self.reason})'}"

    def _name(self, role: Role) -> str:
        model = self.models.get(role)
        return model.name if model else f"{GEOMETRY} ({_PLAYED_BY_GEOMETRY[role]})"

    @property
    def summary(self) -> dict[str, Any]:
        """The method and its networks for the record of the stage."""
        asked = {"geometry": (), "fused": tuple(self.models), "hybrid": ROLES}[self.method]
        names = {role: self.models[role].name if role in self.models else GEOMETRY for role in ROLES if role in asked}
        return {"provider": self.method, **{str(role): name for role, name in names.items()}}

    def key(self) -> list[object]:
        """Method, version and digests of the networks, for the key of the stage; empty for geometry alone. Raises
        InputError if a network file cannot be read."""
        if self.method == "geometry":
            return []
        return [
            self.method,
            _VERSIONS[self.method],
            [[role, model.digest()] for role, model in sorted(self.models.items())],
        ]

    def open(
        self, capture: Capture, listen: Listener = ignore_event
    ) -> Callable[[GeometricFloor, Surroundings], FloorSegmenter] | None:
        """A function that makes the segmenter from a geometric one, with its networks opened; None for geometry alone.

        Raises InputError if a network cannot be used. For the hybrid, also if an image of `capture` cannot be read.
        """
        if self.method == "geometry":
            return None
        hybrid = HybridProvider(self, capture, listen)
        hybrid.open_all()
        if self.method == "fused":
            return hybrid.fused
        _ = hybrid.normals
        return hybrid


class HybridProvider:
    """The hybrid for all submaps. Each network is opened once, at its first use."""

    def __init__(self, provider: FloorProvider, capture: Capture, listen: Listener = ignore_event) -> None:
        self._models, self._capture, self._listen = provider.models, capture, listen

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
        """The normals network without alignment to the main directions of the building; its normals near edges remain
        uncertain."""
        from nvsim.perception.normals_network import NormalsNetwork

        return NormalsNetwork(self._models["normals"].open()) if "normals" in self._models else None

    @cached_property
    def prompted(self) -> PromptedNetwork | None:
        from nvsim.perception.prompted_network import PromptedNetwork

        return PromptedNetwork(self._models["prompted"].open()) if "prompted" in self._models else None

    def open_all(self) -> None:
        """Opens all networks. Raises InputError if one cannot be used."""
        _ = self.semantic, self.seen_normals, self.prompted

    def fused(self, floor: GeometricFloor, around: Surroundings) -> FusedFloor:
        """Geometry fused with the semantic network, calibrated in its surroundings, and, if available, the normals
        network."""
        from nvsim.perception.fused import FusedFloor, calibrate

        assert self.semantic is not None
        looks = calibrate(self.semantic, floor, around.views, around.threads)
        if looks.temperature > _TOO_SURE:
            words = f"Where geometry is certain, {self._models['semantic'].name} is wrong more often than it says"
            self._listen(
                Log(f"{words}, so its probabilities count less (temperature {looks.temperature:.1f}).", "floors")
            )
        return FusedFloor(floor, looks, self.seen_normals)

    def __call__(self, floor: GeometricFloor, around: Surroundings) -> HybridFloor:
        """The hybrid segmenter. `floor` and the cloud around it fill the roles without a network."""
        from nvsim.perception.geometric_roles import CloudNormals, FloorSimilarity
        from nvsim.perception.hybrid import HybridFloor
        from nvsim.perception.regions import RegionGrowing

        return HybridFloor(
            self.semantic or FloorSimilarity(floor), self.normals or CloudNormals(floor, around.cloud()),
            self.prompted or RegionGrowing(),
        )  # fmt: skip


def choose(config: FloorsConfig, scan: Callable[[], Cloud | None]) -> FloorProvider:
    """Selects the method that finds the floor of a capture.

    `scan` returns the LiDAR scan or the cloud of estimated depth, and is only called if the choice depends on it. If
    one of them exists, `auto` uses the bundled network if no other is installed.

    Raises InputError if a named network is not installed, or the named method has no such role.
    """
    named = {role: name for role in ROLES if (name := getattr(config, role)) != AUTO}
    asked = {"geometry": (), "fused": ("semantic",)}.get(config.provider, ROLES)
    for role, name in named.items():
        if role not in asked:
            raise InputError(
                f"--provider {config.provider} does not use --{role} {name}; leave it out, or use --provider hybrid."
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
            raise InputError("No semantic network is installed to be fused with geometry; `nvsim models` lists some.")
        return FloorProvider("fused", looks | faces)
    dense = cloud is not None and cloud.is_dense
    if not looks and dense:
        looks = _models(config, ("semantic",), True)
    if not looks:
        return FloorProvider("geometry", {}, "no semantic network is installed")
    if dense:
        return FloorProvider("fused", looks | faces, "a LiDAR scan or depth shows obstacles on the floor")
    models = _models(config, ROLES)
    if "normals" not in models:
        return FloorProvider("geometry", {}, "no normals network is installed")
    return FloorProvider("hybrid", models, "only networks can show obstacles on the floor")


def _models(config: FloorsConfig, roles: tuple[Role, ...], ours: bool = False) -> dict[Role, InstalledModel]:
    """The installed models of the roles; with `ours`, the bundled model if none is installed. Raises InputError if a
    named model is not installed."""
    found: dict[Role, InstalledModel] = {}
    for role in roles:
        name = getattr(config, role)
        model = None if name == GEOMETRY else find_model(role, "" if name == AUTO else name)
        if model is None and name == AUTO and ours:
            model = bundled_model(role)
        if model is not None:
            found[role] = model
    return found
