"""The features files that agents read: name, width, format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Name = Literal["resnet-152", "resnet-152-places365", "vit-b16", "clip-b16", "clip-h14", "eva-l14", "eva-g"]
CLASSES = 1000
"""Number of ImageNet classes."""


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
