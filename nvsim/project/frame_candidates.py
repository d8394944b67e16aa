"""The masks that the hybrid floor segmentation passes through, for one frame of a project at a time: to look at, and to
correct a mask with. Nothing of the pipeline depends on them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.atomic import replacing
from nvsim.files.stored_arrays import read_arrays
from nvsim.networks.folder import models_folder
from nvsim.networks.installed import find_model
from nvsim.perception.hybrid import HybridFloor, HybridSteps
from nvsim.perception.prompted_network import PromptedNetwork
from nvsim.perception.roles import Mask
from nvsim.project.project import Project
from nvsim.project.stages.floors import floors_key
from nvsim.project.work import lacks

_VERSION = 2  # raised when the same inputs give something else
_FINE = 1024  # pixels: the size that prompted networks look at
_MASKS = ("semantic", "horizontal", "candidates", "prompted")


def candidates_path(project: Project, index: int) -> Path:
    """Where the candidates of a frame lie once they were made; the name holds what they depend on."""
    how = "network" if find_model("prompted") else "grown"
    return project.layout.cache / "candidates" / f"{index:06d}-{floors_key(project)[:12]}-{how}{_VERSION}.npz"


def read_candidates(path: Path) -> HybridSteps | None:
    """What `CandidateMaker` stored, None when it is missing or not readable: it can be made again."""
    wanted = {"shape": ("iu", 1), "points": ("fiu", 2), "normals": ("i", 3), **dict.fromkeys(_MASKS, ("u", 1))}
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
    masks: dict[str, Any] = {
        name: np.unpackbits(data[name], count=height * width).reshape(height, width).astype(bool) for name in _MASKS
    }
    return HybridSteps(points=data["points"], normals=data["normals"].astype(np.float32) / 127.0, **masks)


class CandidateMaker:
    """Makes candidates; keeps what it learnt about the floor of a submap for its next frame."""

    def __init__(self, project: Project) -> None:
        self._project = project
        self._prompted: PromptedNetwork | None = None
        self._hybrids: dict[tuple[str, int], HybridFloor] = {}

    def make(self, index: int) -> Path:
        """The file with the candidates of a frame, made where it is not there. Raises InputError while the floors were
        not found, and for an image that cannot be read."""
        project = self._project
        if not floors_key(project):
            raise lacks(project.layout.root, "floors")
        path = candidates_path(project, index)
        if path.is_file() and read_candidates(path) is not None:
            return path
        from nvsim.capture.images import read_image
        from nvsim.perception.segment import SegmentConfig

        frame = project.need_capture().frames[index]
        size = frame.intrinsics.within(SegmentConfig().longest_side)
        camera = frame.camera.scaled(size.width, size.height)
        _write(path, self._hybrid(index).steps(camera, read_image(frame, size)))
        return path

    def _hybrid(self, index: int) -> HybridFloor:
        from nvsim.perception.geometric_roles import CloudNormals, FloorLooks
        from nvsim.perception.regions import RegionGrowing
        from nvsim.perception.segment import SegmentConfig, learnt_floor

        project = self._project
        capture = replace(project.need_capture(), cloud=project.scan())
        submap = next(s for s in project.need_submaps() if index in s.core)
        key = floors_key(project), submap.index
        if key not in self._hybrids:
            surface = project.surface(submap.index)
            if surface is None:
                raise InputError(
                    f"{project.layout.surface(submap.index)} is missing; run `nvsim floors --project` again."
                )
            floor = learnt_floor(capture, list(submap.core), surface, SegmentConfig())
            prompted = self._network() or RegionGrowing()
            self._hybrids[key] = HybridFloor(FloorLooks(floor), CloudNormals(floor, capture.cloud), prompted)
        return self._hybrids[key]

    def _network(self) -> PromptedNetwork | None:
        """The user's prompted network, opened once. Raises InputError for one that cannot be used."""
        model = find_model("prompted")
        if model is not None and self._prompted is None:
            self._prompted = PromptedNetwork(model.open())
        return self._prompted

    def prompt(self, index: int, points: NDArray[np.floating], inside: NDArray[np.bool_]) -> tuple[Mask, Mask]:
        """What the user's prompted network takes for the things at the `points` (K, 2), x, y in shares of the image,
        that are `inside` (K,), and for those at the others; each (h, w) bool, empty where there are no such points.
        Raises InputError where there is no network, and for an image that cannot be read."""
        from nvsim.capture.images import read_image

        network = self._network()
        if network is None:
            raise InputError(
                f"There is no prompted network in {models_folder()}; add one with `nvsim models add`, or put it there "
                "as prompted.encoder.onnx and prompted.decoder.onnx."
            )
        frame = self._project.need_capture().frames[index]
        size = frame.intrinsics.within(_FINE)
        image = read_image(frame, size)
        pixels = np.asarray(points, float) * (size.width, size.height)
        nothing = np.zeros(image.shape[:2], bool)
        add = network.region(image, pixels, inside) if inside.any() else nothing
        take = network.region(image, pixels, ~inside) if not inside.all() else nothing
        return add, take


def _write(path: Path, steps: HybridSteps) -> None:
    masks: dict[str, Any] = {name: np.packbits(getattr(steps, name)) for name in _MASKS}
    with replacing(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(
            file,
            shape=np.array(steps.semantic.shape),
            points=steps.points,
            normals=np.round(steps.normals * 127).astype(np.int8),
            **masks,
        )
