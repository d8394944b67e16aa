"""Line icons in the text color of the palette, and images of the window that are saved as files."""

from __future__ import annotations

import functools
from pathlib import Path

from PySide6.QtCore import QByteArray, QRectF, Qt
from PySide6.QtGui import QColor, QIcon, QImage, QPainter, QPalette, QPixmap
from PySide6.QtSvg import QSvgRenderer

import nvsim_resources
from nvsim.errors import InputError
from nvsim.files import atomic

FOLDER = Path(nvsim_resources.__file__).parent / "icons"
_SIZES = (16, 20, 24, 32, 48)


def icon(name: str, palette: QPalette) -> QIcon:
    """The icon `name` in the colors of `palette`, normal and disabled.

    Raises FileNotFoundError for an unknown name.
    """
    groups = (QPalette.ColorGroup.Active, QPalette.ColorGroup.Disabled)
    return _icon(name, *(palette.color(group, QPalette.ColorRole.ButtonText).name() for group in groups))


@functools.cache
def _icon(name: str, normal: str, disabled: str) -> QIcon:
    source = (FOLDER / f"{name}.svg").read_text(encoding="utf-8")
    result = QIcon()
    for mode, color in ((QIcon.Mode.Normal, normal), (QIcon.Mode.Disabled, disabled)):
        renderer = QSvgRenderer(QByteArray(source.replace("currentColor", color).encode()))
        for size in _SIZES:
            pixmap = QPixmap(size, size)
            pixmap.fill(Qt.GlobalColor.transparent)
            painter = QPainter(pixmap)
            renderer.render(painter, QRectF(0, 0, size, size))
            painter.end()
            result.addPixmap(pixmap, mode)
    return result


def swatch(color: str, size: int = 12) -> QPixmap:
    """A rounded square of one color with sides of `size` pixels, for lists."""
    pixmap = QPixmap(2 * size, 2 * size)
    pixmap.setDevicePixelRatio(2.0)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(QColor(color))
    painter.drawRoundedRect(QRectF(0, 0, size, size), 3, 3)
    painter.end()
    return pixmap


def save_image(image: QImage | QPixmap, path: Path) -> None:
    """Writes an image in the format of the file extension. Raises InputError if Qt does not support the format, or if
    the file cannot be written."""
    with atomic.replacement_file(path) as temporary:
        if not image.save(str(temporary)):
            raise InputError(f"Cannot write {path}; choose a writable folder and a name ending in .png.")
