"""Saves images of the window as files: atomically, and never through a symbolic link."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtGui import QImage, QPixmap

from nvsim.errors import InputError
from nvsim.files import atomic


def save_image(image: QImage | QPixmap, path: Path) -> None:
    """Writes an image in the format of the file extension. Raises InputError if Qt does not support the format, or if
    the file cannot be written."""
    with atomic.replacing(path) as temporary:
        if not image.save(str(temporary)):
            raise InputError(f"Cannot write {path}; choose a writable folder and a name ending in .png.")
