"""The files of features that agents read: name, width, format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Name = Literal["resnet-152", "resnet-152-places365", "vit-b16", "clip-b16", "clip-h14", "eva-l14", "eva-g"]
CLASSES = 1000
"""ImageNet's."""


@dataclass(frozen=True)
class Layout:
    """name     as the command line says it
    file     what the agents call the file
    width    numbers that they read of a view
    classes  whether logits of ImageNet's classes may stand behind them (VLN-DUET's pre-training reads them)
    readers  who opens it
    tokens   rows of numbers of each candidate's view, where it holds them in place of one row of all 36 views; else 0
    """

    name: str
    file: str
    width: int
    classes: bool
    readers: str
    tokens: int = 0

    @property
    def is_tsv(self) -> bool:
        """Base64 in tab-separated values, else HDF5."""
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
