"""The argument that names a capture, with the formats that there are in its help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from nvsim.capture import formats

CapturePath = Annotated[
    Path,
    tyro.conf.Positional,
    tyro.conf.arg(help=f"A folder or file: {formats.names()}; or a video, or a folder of videos."),
]
