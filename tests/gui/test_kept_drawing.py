"""After an edit of a large graph, only the changed parts are drawn again, and the picture equals a complete drawing."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QImage, QPainter
from pytestqt.qtbot import QtBot

from nvsim.benchmarks.graph import random_graph
from nvsim_app.benchmarks.graphs import random_edit
from nvsim_app.layers.graph import GraphLayer
from nvsim_app.painting import cameras
from nvsim_app.painting.graph_ink import DrawingCache
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents
from nvsim_app.views.map_view import MapView

SIZE = (500, 400)


@pytest.fixture
def document(qtbot: QtBot) -> Document:
    document = Document()
    document.set_contents(Contents(Path("field.nvsim"), graph=random_graph(900, seed=3)))
    return document


def pixels(draw: Callable[[QPainter], None], ratio: float = 1.0) -> np.ndarray:
    image = QImage(round(SIZE[0] * ratio), round(SIZE[1] * ratio), QImage.Format.Format_ARGB32_Premultiplied)
    image.setDevicePixelRatio(ratio)
    image.fill(0xFF203040)
    painter = QPainter(image)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    draw(painter)
    painter.end()
    return np.array(image.constBits()).reshape(image.height(), image.width(), 4).astype(int)


def nearly_equal(one: np.ndarray, other: np.ndarray) -> bool:
    """A clipped line may step a pixel elsewhere; that a viewpoint is missing changes dozens."""
    return np.count_nonzero(np.abs(one - other).max(axis=2) > 40) <= 8


@pytest.mark.parametrize("ratio", [1.0, 1.25])
@pytest.mark.parametrize("inside", [False, True])
def test_the_3d_view_after_edits_looks_as_if_drawn_anew(document: Document, ratio: float, inside: bool) -> None:
    pose = cameras.overview(document.extent)
    if inside:
        x, y, z = document.graph_arrays.positions[450].tolist()
        pose = cameras.ViewPose((x + 0.2, y, z))
    camera = pose.camera(*SIZE)
    layer, rng = GraphLayer(document), random.Random(1)

    def paint(painter: QPainter) -> None:
        layer.paint(painter, camera)

    pixels(paint, ratio)
    pixels(paint, ratio)  # into the image
    image, edits = layer._kept._image, 0
    before = pixels(paint, ratio)
    while edits < 25:
        edits += bool(document.editing.run(*random_edit(document, rng)))
        if edits % 3 == 0:  # several may come together
            anew = GraphLayer(document)
            assert nearly_equal(pixels(paint, ratio), pixels(lambda p, fresh=anew: fresh.paint(p, camera), ratio))
    if not inside:
        assert layer._kept._image is image, "it was drawn anew, not patched"
        assert not nearly_equal(before, pixels(paint, ratio))
    document.editing.close()


def test_the_map_after_edits_looks_as_if_drawn_anew(document: Document, qtbot: QtBot) -> None:
    view, rng = MapView(document), random.Random(2)
    qtbot.addWidget(view)
    view.resize(*SIZE)
    view.show()
    view.frame_everything()
    qtbot.waitUntil(lambda: view.graph._kept._image is not None, timeout=20_000)  # it fills once the view rests
    image, before = view.graph._kept._image, grabbed(view)
    for _ in range(12):
        document.editing.run(*random_edit(document, rng))
        patched = grabbed(view)
    assert view.graph._kept._image is image, "it was drawn anew, not patched"
    assert not nearly_equal(before, patched)
    view.graph._kept = DrawingCache()
    assert nearly_equal(patched, grabbed(view))
    document.editing.close()


def grabbed(view: MapView) -> np.ndarray:
    image = view.canvas.grab().toImage().convertToFormat(QImage.Format.Format_ARGB32_Premultiplied)
    return np.array(image.constBits()).reshape(image.height(), image.width(), 4).astype(int)


def test_what_changed_is_known_for_a_few_edits_only(document: Document) -> None:
    arrays, rng = document.graph_arrays, random.Random(4)
    assert document.graph_changes.changed_segments_since(arrays) is None  # nothing is known to have changed since
    id = next(iter(document.graph_arrays.ids))
    document.editing.run("shift_viewpoints", {"ids": [id], "by": [0.4, 0.0, 0.0]})
    places = document.graph_changes.changed_segments_since(arrays)
    assert places is not None
    x = arrays.feet[0, 0]
    assert {round(v, 6) for v in places[:, :, 0].ravel()} >= {round(x, 6), round(x + 0.4, 6)}
    for _ in range(60):
        document.editing.run(*random_edit(document, rng))
    assert document.graph_changes.changed_segments_since(arrays) is None
    document.editing.close()


def test_a_patch_of_most_of_the_picture_is_none(qtbot: QtBot) -> None:
    kept, calls = DrawingCache(), []

    def draw(painter: QPainter, within: QRectF | None) -> None:
        calls.append(within)
        painter.drawPoint(QPointF(3, 3))

    for content, where in (("a", None), ("a", None), ("b", QRectF(0, 0, 10, 10)), ("c", QRectF(0, 0, *SIZE))):
        pixels(lambda p, c=content, w=where: kept.paint(p, *SIZE, "view", draw, c, lambda _: w))
    assert calls == [None, None, QRectF(0, 0, 10, 10), None]


def test_an_edit_on_a_chosen_storey_is_patched_too(document: Document, qtbot: QtBot) -> None:
    graph = random_graph(900, seed=3)
    above = {id: replace(v, position=(v.position[0], v.position[1], v.position[2] + 3.0)) for id, v in
             list(graph.viewpoints.items())[:120]}  # fmt: skip
    document.set_contents(Contents(Path("house.nvsim"), graph=replace(graph, viewpoints={**graph.viewpoints, **above})))
    assert len(document.storeys.found) == 2
    document.storeys.choose(0)
    camera = cameras.overview(document.extent).camera(*SIZE)
    layer = GraphLayer(document)

    def paint(painter: QPainter) -> None:
        layer.paint(painter, camera)

    for _ in range(2):
        pixels(paint)
    image = layer._kept._image
    document.editing.run("add_viewpoint", {"position": [20.0, 20.0, 1.5]})
    document.editing.run("remove_viewpoints", {"ids": [document.shown_arrays.ids[70]]})
    document.editing.run("remove_viewpoints", {"ids": [next(iter(above))]})
    patched = pixels(paint)
    assert layer._kept._image is image and image is not None
    anew = GraphLayer(document)
    assert nearly_equal(patched, pixels(lambda p: anew.paint(p, camera)))
    document.editing.close()
