"""The command-line argument that names a capture. Its help lists the supported formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from nvsim.capture import formats

CapturePath = Annotated[
    Path,
    tyro.conf.Positional,
    tyro.conf.arg(
        help=f"A folder or file: {formats.names()}; or a video, or a folder of videos or photographs; or a splat file."
    ),
]
