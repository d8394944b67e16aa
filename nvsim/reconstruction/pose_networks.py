"""The user's networks in the computation of poses: one that finds features, and one that masks people."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.networks.description import ROLE_WORDS, FloorResult, Role
from nvsim.networks.installed import InstalledModel, find_model, models_of

if TYPE_CHECKING:
    from nvsim.perception.feature_network import FeatureNetwork
    from nvsim.poses.image_set import ImageSet

NONE = "none"
"""The name that selects no network."""
Use = Literal["features", "people"]
_ROLES: dict[Use, Role] = {"features": "features", "people": "semantic"}
_PURPOSES: dict[Use, str] = {"features": ROLE_WORDS["features"], "people": "masks of people"}
_GROWN = 0.01  # of the longer side of an image: pixels around people that are masked, because networks miss fingers
Digest = tuple[str, str, str]
"""Use of a network ("features" or "people"), its name, and a digest of its files."""


@dataclass(frozen=True)
class PoseNetworks:
    """Names of installed models. "" keeps what the poses in the folder were computed with, "none" selects no network.

    features  model that finds keypoints, and may match them
    people    model that recognizes people
    """

    features: str = ""
    people: str = ""

    @property
    def is_given(self) -> bool:
        """Whether the user selects a network."""
        return any(name not in ("", NONE) for name in (self.features, self.people))

    def refuse_for_poses(self, source: Path) -> None:
        """Raises InputError if a network is selected, because `source` needs no poses."""
        if self.is_given:
            raise InputError(
                f"{source} is not a video or photographs without poses, so --features and --people do not apply; "
                "omit them."
            )

    def completed_by(self, before: tuple[Digest, ...]) -> PoseNetworks:
        """These names, with those of earlier poses where none is given."""
        names = {use: name for use, name, _ in before}
        return PoseNetworks(self.features or names.get("features", NONE), self.people or names.get("people", NONE))

    def match_earlier(self, before: tuple[Digest, ...]) -> bool:
        """Whether earlier poses were computed with these networks. Raises InputError if a network is not installed."""
        for use in _ROLES:
            name = getattr(self, use)
            there = [digest for digest in before if digest[0] == use]
            if name and there != [d for d in replace(_NO_NETWORKS, **{use: name}).digests if name != NONE]:
                return False
        return True

    @property
    def digests(self) -> tuple[Digest, ...]:
        """The selected networks. Raises InputError if one is not installed, or if one for people has no such class."""
        return tuple((use, model.name, model.digest()) for use in _ROLES if (model := self._model(use)) is not None)

    def _model(self, use: Use) -> InstalledModel | None:
        name = getattr(self, use)
        if name in ("", NONE):
            return None
        model = find_model(_ROLES[use], name, _PURPOSES[use], suitable_models(use))
        assert model is not None  # find_model raises InputError for an unknown name
        if not _is_suitable(model):
            raise InputError(
                f"{name} has no class of people, so it cannot mask them; use another network, or list its classes of "
                f"people in {model.described_in} (people = [...])."
            )
        return model

    def feature_network(self) -> FeatureNetwork | None:
        """The opened network for features, None without one. Raises InputError if it cannot be opened."""
        from nvsim.perception.feature_network import FeatureNetwork

        model = self._model("features")
        return None if model is None else FeatureNetwork(model.open(), model.name)

    def without_people(
        self, images: ImageSet, folder: Path, report_progress: Callable[[str, int, int], None]
    ) -> tuple[ImageSet, float]:
        """Masks people in `images`. Returns the image set with its masks, and the masked percentage of the pixels.
        Tracked points that are on a person in any image are removed.

        Masks of images with people are written to `folder` as NAME.png, people black. Without a network for people, the
        image set stays as it is. Raises InputError if the network cannot be opened or gives wrong shapes."""
        import cv2

        from nvsim.perception.semantic_network import SemanticNetwork
        from nvsim.poses.image_set import mask_path
        from nvsim.poses.tracks import Tracks

        model = self._model("people")
        if model is None:
            return images, 0.0
        network = SemanticNetwork(model.open())
        tracks, shares = images.tracks, []
        on_people = np.zeros(len(tracks.point), bool)
        atomic.make_folder(folder)
        for index, name in enumerate(images.names):
            report_progress("people", index, len(images.names))
            image = cv2.imread(str(images.folder / name), cv2.IMREAD_COLOR)
            if image is None:
                continue
            people = _dilate(network.people(np.asarray(image[..., ::-1], np.uint8)))
            shares.append(float(people.mean()))
            if people.any():
                path = mask_path(folder, name)
                atomic.make_folder(path.parent)
                atomic.write_bytes(path, cv2.imencode(".png", np.where(people, 0, 255).astype(np.uint8))[1].tobytes())
                own = np.flatnonzero(tracks.frame == index)
                x, y = np.clip(np.floor(tracks.places[own]).astype(int), 0, np.array(people.shape)[::-1] - 1).T
                on_people[own] = people[y, x]
        left = ~np.isin(tracks.point, tracks.point[on_people])
        kept = Tracks(
            np.unique(tracks.point[left], return_inverse=True)[1].astype(np.int64),
            tracks.frame[left],
            tracks.places[left],
        )
        return replace(images, tracks=kept, masks=folder), round(100 * float(np.mean(shares or [0])), 2)


def suitable_models(use: Use) -> list[InstalledModel]:
    """The installed models that find features, or that recognize people."""
    return [model for model in models_of(_ROLES[use]) if _is_suitable(model)]


def _is_suitable(model: InstalledModel) -> bool:
    result = model.description and model.description.result
    return not isinstance(result, FloorResult) or bool(result.people)


_NO_NETWORKS = PoseNetworks(NONE, NONE)
SAME_NETWORKS = PoseNetworks()
"""Keeps the networks of the poses in the folder."""


def _dilate(people: NDArray[np.bool_]) -> NDArray[np.bool_]:
    import cv2

    side = 2 * round(_GROWN * max(people.shape)) + 1
    return np.asarray(cv2.dilate(people.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)
