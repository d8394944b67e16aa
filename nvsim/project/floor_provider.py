"""Who finds the floor: geometry, or the hybrid of the paper whose three roles networks or geometry play."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from nvsim.capture.types import Cloud
from nvsim.errors import InputError
from nvsim.networks.description import Role
from nvsim.networks.installed import Model, find_model
from nvsim.project.config import FloorsConfig

if TYPE_CHECKING:
    from nvsim.perception.geometric import GeometricFloor
    from nvsim.perception.hybrid import HybridFloor
    from nvsim.perception.prompted_network import PromptedNetwork
    from nvsim.perception.roles import SemanticFloor, SurfaceNormals

ROLES: tuple[Role, ...] = ("semantic", "normals", "prompted")
GEOMETRY, AUTO = "geometry", "auto"
_VERSION = 1  # of the hybrid; raised when the same inputs give something else
_PLAYED_BY_GEOMETRY: dict[Role, str] = {
    "semantic": "the floor's known looks", "normals": "the cloud", "prompted": "growing over the normals",
}  # fmt: skip


@dataclass(frozen=True)
class FloorProvider:
    """is_hybrid  else geometry alone
    models     by role, of the hybrid; a role that none plays is played by geometry
    because    why `auto` took it, "" where it was said
    """

    is_hybrid: bool
    models: dict[Role, Model]
    because: str = ""

    @property
    def words(self) -> str:
        """Who finds the floor, for the log."""
        if not self.is_hybrid:
            return f"by geometry{self.because and f' ({self.because})'}"
        played = [f"{role} by {self.models[role].name}" if role in self.models
                  else f"{role} by geometry ({_PLAYED_BY_GEOMETRY[role]})" for role in ROLES]  # fmt: skip
        return f"by the hybrid: {', '.join(played)}{self.because and f' ({self.because})'}"

    @property
    def summary(self) -> dict[str, Any]:
        """For the record of the stage."""
        names: dict[str, str] = {role: self.models[role].name if role in self.models else GEOMETRY for role in ROLES}
        return {"provider": "hybrid", **names} if self.is_hybrid else {"provider": GEOMETRY}

    def key(self) -> list[object]:
        """What the masks depend on; nothing for geometry alone, as before there was a choice. Raises InputError for a
        file that cannot be read."""
        if not self.is_hybrid:
            return []
        return ["hybrid", _VERSION, [[role, model.digest()] for role, model in sorted(self.models.items())]]

    def open(self) -> Hybrid:
        """The networks, opened. Raises InputError for one that cannot be used."""
        hybrid = Hybrid(self)
        hybrid.open_all()
        return hybrid


class Hybrid:
    """The hybrid with each of its networks opened once, when it is needed, for the floors of all submaps."""

    def __init__(self, provider: FloorProvider) -> None:
        self._models = provider.models

    @cached_property
    def semantic(self) -> SemanticFloor | None:
        from nvsim.perception.semantic_network import SemanticNetwork

        return SemanticNetwork(self._models["semantic"].open()) if "semantic" in self._models else None

    @cached_property
    def normals(self) -> SurfaceNormals | None:
        from nvsim.perception.normals_network import NormalsNetwork

        return NormalsNetwork(self._models["normals"].open()) if "normals" in self._models else None

    @cached_property
    def prompted(self) -> PromptedNetwork | None:
        from nvsim.perception.prompted_network import PromptedNetwork

        return PromptedNetwork(self._models["prompted"].open()) if "prompted" in self._models else None

    def open_all(self) -> None:
        """Raises InputError for a network that cannot be used."""
        for role in self._models:
            getattr(self, role)

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
    matters.

    Raises InputError for a role's name that is not installed, and for one beside `geometry`, which asks nobody.
    """
    named = {role: name for role in ROLES if (name := getattr(config, role)) != AUTO}
    if config.provider == GEOMETRY:
        if named:
            role, name = next(iter(named.items()))
            raise InputError(f"Geometry alone asks no network; leave --{role} {name} out, or say --provider hybrid.")
        return FloorProvider(False, {})
    if config.provider == "hybrid" or named:
        models = _models(config)
        return FloorProvider(True, models, "" if models else "no networks are installed; geometry alone is better then")
    models = _models(config)
    if "semantic" not in models or "normals" not in models:
        return FloorProvider(False, {}, "no networks of looks and normals are installed")
    cloud = scan()
    if cloud is not None and cloud.is_dense:
        return FloorProvider(False, {}, "a scan or the depth of the images shows what stands on the floor")
    return FloorProvider(True, models, "nothing but networks shows what stands on the floor")


def _models(config: FloorsConfig) -> dict[Role, Model]:
    found: dict[Role, Model] = {}
    for role in ROLES:
        name = getattr(config, role)
        model = None if name == GEOMETRY else find_model(role, "" if name == AUTO else name)
        if model is not None:
            found[role] = model
    return found
