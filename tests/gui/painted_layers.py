"""What a layer of the window paints."""

from __future__ import annotations

import numpy as np
from PySide6.QtGui import QImage, QPainter

from nvsim_app.layers.layer import Layer
from nvsim_app.views.graph_surface import MapSurface
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.part import WindowContext


def pixels_on_map(layer: Layer, context: WindowContext) -> int:
    """The number of pixels that the layer paints on the map."""
    plan = context.part(MapPart).view
    image = QImage(plan.canvas.size(), QImage.Format.Format_ARGB32_Premultiplied)
    image.fill(0)
    painter = QPainter(image)
    layer.paint_on_map(painter, MapSurface(plan, context.document))
    painter.end()
    return int(np.count_nonzero(np.frombuffer(image.constBits(), np.uint32)))
