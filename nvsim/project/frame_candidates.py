"""The intermediate masks of the hybrid floor segmentation for single frames, for display and to correct masks. No stage
depends on them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.images import read_image
from nvsim.errors import InputError
from nvsim.files.stored_arrays import read_arrays, write_arrays
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.networks.folder import models_folder
from nvsim.perception.hybrid import HybridFloor, HybridSteps
from nvsim.perception.prompted_network import PromptedNetwork
from nvsim.perception.roles import Failure, Mask
from nvsim.project import ledger
from nvsim.project.config import FloorsConfig
from nvsim.project.floor_heights import floors_seen
from nvsim.project.floor_provider import ROLES, FloorProvider, HybridProvider, choose
from nvsim.project.project import Project
from nvsim.project.stages.floors import floors_key
from nvsim.project.work import missing_result_error

_VERSION = 4  # increased when equal inputs give another result
_FINE = 1024  # pixels of the longer side for prompted networks
_FAILURES: tuple[Failure, ...] = get_args(Failure)
_MASKS = ("semantic", "horizontal", "candidates", "prompted")


def provider_of(project: Project) -> FloorProvider:
    """The provider for candidates: the networks of the hybrid that made the floor masks, or the installed ones. Raises
    InputError if one of these networks is not installed."""
    found = ledger.record(project, "floors")
    said = {} if found is None or found.summary.get("provider") != "hybrid" else found.summary
    roles = {role: str(said.get(role, "auto")) for role in ROLES}
    return choose(FloorsConfig("hybrid", **roles), project.scan)


def candidates_path(project: Project, index: int, provider: FloorProvider | None = None) -> Path:
    """The path of the candidates of a frame. Its name contains a hash of all inputs."""
    models = (provider or provider_of(project)).models
    stamps = [(role, model.name, model.stamp) for role, model in sorted(models.items())]
    how = ledger.key_of(floors_key(project), _VERSION, stamps)
    return project.layout.cache / "candidates" / f"{index:06d}-{how}.npz"


def read_candidates(path: Path) -> HybridSteps | None:
    """The stored candidates; None if the file is missing or damaged, because it can be made again."""
    wanted = {"shape": ("iu", 1), "points": ("fiu", 2), "normals": ("i", 3), "failure": ("u", 1)}
    wanted |= dict.fromkeys(_MASKS, ("u", 1))
    try:
        data = read_arrays(path, "the candidates of a frame", wanted, "make them again")
    except InputError:
        return None
    if data["shape"].shape != (2,) or data["points"].shape[1] != 2 or not np.isfinite(data["points"]).all():
        return None
    height, width = (int(side) for side in data["shape"])
    packed = -(-height * width // 8)
    if min(height, width) < 1 or any(data[name].shape != (packed,) or data[name].dtype != np.uint8 for name in _MASKS):
        return None
    if data["normals"].shape != (height, width, 3):
        return None
    if data["failure"].shape != (1,) or data["failure"][0] >= len(_FAILURES):
        return None
    masks: dict[str, Any] = {
        name: np.unpackbits(data[name], count=height * width).reshape(height, width).astype(bool) for name in _MASKS
    }
    normals = data["normals"].astype(np.float32) / 127.0
    return HybridSteps(points=data["points"], normals=normals, failure=_FAILURES[data["failure"][0]], **masks)


class CandidateMaker:
    """Makes candidates, and reuses the floor appearance of a floor surface for all of its frames."""

    def __init__(self, project: Project) -> None:
        self._project = project
        self._provider: FloorProvider | None = None
        self._opened: HybridProvider | None = None
        self._floors: tuple[str, dict[int, FloorSurface]] | None = None
        self._hybrids: dict[int, HybridFloor] = {}

    def make(self, index: int) -> Path:
        """The file with the candidates of a frame, made if it is missing. Raises InputError if the floor is not found
        yet, the image cannot be read, or a network cannot be used."""
        project = self._project
        if not floors_key(project):
            raise missing_result_error(project.layout.root, "floors")
        provider = provider_of(project)
        if provider != self._provider:
            self._provider, self._opened = provider, None
            self._hybrids.clear()
        path = candidates_path(project, index, provider)
        if path.is_file() and read_candidates(path) is not None:
            return path
        from nvsim.perception.segment import SegmentConfig

        frame = project.need_capture().frames[index]
        size = frame.intrinsics.limited_to(SegmentConfig().longest_side)
        camera = frame.camera.scaled(size.width, size.height)
        _write(path, self._hybrid(index, provider).steps(camera, read_image(frame, size)))
        return path

    def _hybrid(self, index: int, provider: FloorProvider) -> HybridFloor:
        from nvsim.perception.obstacles import BuildingObstacles
        from nvsim.perception.segment import SegmentConfig, learnt_floor

        project = self._project
        capture = replace(project.need_capture(), cloud=project.scan())
        if self._floors is None or self._floors[0] != floors_key(project):
            self._floors, self._hybrids = (floors_key(project), floors_seen(project)), {}
        floors = self._floors[1]
        surface = floors.get(index)
        if surface is None:
            submap = next(s for s in project.submaps("floors") if index in s.core)
            missing = project.layout.surface(submap.index)
            raise InputError(f"{missing} is missing; run `nvsim floors --project` again.")
        if id(surface) not in self._hybrids:
            if self._opened is None:
                self._opened = HybridProvider(provider, capture)
            members = [i for i, s in floors.items() if s is surface]
            how = SegmentConfig()
            around = [floors.get(i, surface) for i in range(len(capture.frames))]
            obstacles = BuildingObstacles(capture, around, how.geometric.obstacles)
            self._hybrids[id(surface)] = self._opened(*learnt_floor(capture, members, surface, obstacles, how))
        return self._hybrids[id(surface)]

    def _network(self) -> PromptedNetwork | None:
        """The prompted network of the candidates, opened once. Raises InputError if it cannot be used."""
        provider = provider_of(self._project)
        if "prompted" not in provider.models:
            return None
        if provider != self._provider or self._opened is None:
            self._provider, self._opened = provider, HybridProvider(provider, self._project.need_capture())
            self._hybrids.clear()
        return self._opened.prompted

    def prompt(self, index: int, points: NDArray[np.floating], inside: NDArray[np.bool_]) -> tuple[Mask, Mask]:
        """Segments the regions at given points with the installed prompted network.

        points  (K, 2) x, y as fractions of the image size
        inside  (K,) bool, whether a point is inside the wanted region

        Returns the mask of the regions at the inside points, and that of the regions at the other points, each (h, w)
        bool. A mask is empty if it has no points. Raises InputError if no prompted network is installed or the image
        cannot be read.
        """
        network = self._network()
        if network is None:
            raise InputError(
                f"There is no prompted network in {models_folder()}; add one with `nvsim models add`, or copy it there "
                "as prompted.encoder.onnx and prompted.decoder.onnx."
            )
        frame = self._project.need_capture().frames[index]
        size = frame.intrinsics.limited_to(_FINE)
        image = read_image(frame, size)
        pixels = np.asarray(points, float) * (size.width, size.height)
        nothing = np.zeros(image.shape[:2], bool)
        add = network.region(image, pixels, inside) if inside.any() else nothing
        take = network.region(image, pixels, ~inside) if not inside.all() else nothing
        return add, take


def _write(path: Path, steps: HybridSteps) -> None:
    arrays: dict[str, NDArray[Any]] = {
        "shape": np.array(steps.semantic.shape),
        "points": steps.points,
        "failure": np.array([_FAILURES.index(steps.failure)], np.uint8),
        "normals": np.round(steps.normals * 127).astype(np.int8),
    }
    write_arrays(path, arrays | {name: np.packbits(getattr(steps, name)) for name in _MASKS})
