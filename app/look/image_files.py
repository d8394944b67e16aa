"""Images of the window as files, whole or absent, never written through a link."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtGui import QImage, QPixmap

from nvsim.errors import InputError
from nvsim.files import atomic


def save_image(image: QImage | QPixmap, path: Path) -> None:
    """Writes an image in the format that the name asks for. Raises InputError where Qt knows no such format, or the
    disk refuses."""
    with atomic.replacing(path) as temporary:
        if not image.save(str(temporary)):
            raise InputError(f"Cannot write {path}; choose a writable folder and a name ending in .png.")
