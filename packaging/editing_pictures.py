"""Takes the pictures of the editor in resources/docs, on a copy of a project that `nvsim demo` made:

xvfb-run -a -s "-screen 0 2600x1600x24" python packaging/editing_pictures.py demo.nvsim [--out resources/docs]
"""

from __future__ import annotations

import math
import sys

import networkx
import numpy as np
from pictures import Camera, take
from PySide6.QtCore import QEvent, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDockWidget

from nvsim.cli.main import main as nvsim
from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import NavGraph
from nvsim.occupancy.paths import segment_is_free
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.wiring.checking import ComparePart
from nvsim_app.wiring.inspector import InspectorPart

SIZE = (1172, 700)
SHIFT = Qt.KeyboardModifier.ShiftModifier


def place(graph: NavGraph, id: str) -> np.ndarray:
    return np.array(graph.viewpoints[id].position)


def room_behind_a_door(graph: NavGraph) -> tuple[str, set[str]]:
    """A viewpoint before the only way into a room, and the viewpoints of the room."""
    net = networkx.Graph(list(graph.edges))
    rooms = []
    for door in networkx.articulation_points(net):
        rest = net.subgraph(set(net) - {door})
        rooms += [(door, set(part)) for part in networkx.connected_components(rest) if 3 <= len(part) < len(net) / 3]
    return max(rooms, key=lambda room: len(room[1]))


class Editor(Camera):
    """A camera that also edits."""

    def only(self, *names: str) -> None:
        """Hides every panel but these."""
        for dock in self.window.findChildren(QDockWidget):
            dock.setVisible(dock.objectName().removeprefix("dock_") in names)
        for name in names[1:]:
            self.window.show_dock(name)
        self.until(lambda: False, 0.5)

    def stand(self, eye: np.ndarray, target: np.ndarray) -> None:
        """Looks from a place 1.5 m above the floor at another on it."""
        x, y, z = target - eye
        pose = ViewPose(
            (float(eye[0]), float(eye[1]), 1.5), math.atan2(x, y), math.atan2(z - 1.5, math.hypot(x, y)) / 2
        )
        self.window.scene.navigation.set_pose(pose)
        self.rest()

    def pixel(self, spot: np.ndarray) -> QPointF:
        surface = next(c.surface for c in self.window.modes.canvases if c.surface.widget is self.window.scene)
        return QPointF(*surface.project(np.array([[spot[0], spot[1], 0.0]]))[0][0])

    def hover(self, spot: np.ndarray) -> None:
        scene, at = self.window.scene, self.pixel(spot)
        event = QMouseEvent(
            QEvent.Type.MouseMove, at, QPointF(scene.mapToGlobal(at)), Qt.MouseButton.NoButton,
            Qt.MouseButton.NoButton, SHIFT,
        )  # fmt: skip
        QApplication.sendEvent(scene, event)
        QApplication.processEvents()

    def click(self, spot: np.ndarray, keys: Qt.KeyboardModifier) -> None:
        QTest.mouseMove(self.window.scene, self.pixel(spot).toPoint())
        QTest.mouseClick(self.window.scene, Qt.MouseButton.LeftButton, keys, self.pixel(spot).toPoint())
        QApplication.processEvents()

    def rest(self) -> None:
        if self.session.document.project is None:
            self.until(lambda: False, 2.0)  # a file: nothing is rendered
        else:
            super().rest()

    def take(self, name: str) -> None:
        self.window.panels["map"].frame_everything()
        super().take(name)


def shoot(camera: Camera) -> None:
    editor = Editor(camera.session, camera.out)
    document, window, table = editor.session.document, editor.window, editor.table
    editing = document.editing
    editor.until(lambda: document.graph is not None and document.contents.occupancy is not None)
    editor.until(lambda: window.scene.picture is not None)

    editor.only("map", "validation")
    editor.docks(map=190)
    table["next_review"].trigger()
    editor.take("editing-review")

    graph, occupancy = document.graph, document.contents.occupancy
    assert graph is not None and occupancy is not None
    ids = sorted(graph.viewpoints)
    center = np.mean([place(graph, id) for id in ids], axis=0)
    pairs = [(a, b) for i, a in enumerate(ids) for b in ids[:i] if 2 < math.dist(place(graph, a), place(graph, b)) < 3]
    blocked = [p for p in pairs if not segment_is_free(occupancy, *(place(graph, id)[:2] for id in p))]
    inmost = min(blocked, key=lambda p: sum(math.dist(place(graph, id), center) for id in p))
    assert editing.run("add_edges", {"pairs": [list(inmost)]})
    editor.until(lambda: bool(editing.findings))
    table["next_finding"].trigger()
    editor.take("editing-false-edge")
    editing.go_to(0)

    door, room = room_behind_a_door(graph)
    before, middle = place(graph, door), np.mean([place(graph, id) for id in room], axis=0)
    ahead = (middle - before) / np.linalg.norm(middle - before)
    first = next(id for id in sorted(room) if (min(door, id), max(door, id)) in graph.edges)
    beyond = [id for id in room if 1.5 < math.dist(place(graph, id), place(graph, first)) < 3.5]
    second = max(
        beyond, key=lambda id: float((place(graph, id) - before) @ ahead) / math.dist(place(graph, id), before)
    )
    assert editing.run("remove_viewpoints", {"ids": sorted(room)})
    editor.only("map", "details")
    document.select(viewpoint=door)
    editor.stand(before - ahead, middle)
    table["mode_add_viewpoint"].trigger()
    editor.hover(place(graph, first))
    editor.take("editing-add-viewpoint")

    editor.click(place(graph, first), SHIFT)
    editor.click(place(graph, second), Qt.KeyboardModifier.NoModifier)
    editor.until(lambda: bool(editing.proposals.edges), 60)
    table["mode_select"].trigger()
    editor.take("editing-proposed")
    editing.go_to(0)

    document.select()
    assert editing.run("remove_viewpoints", {"ids": [second]})
    there = place(graph, first) + 0.6 * np.array([ahead[1], -ahead[0], 0.0])
    assert editing.run("move_viewpoints", {"positions": {first: there.tolist()}})
    editing.select(GraphSelection())
    editor.only("compare")
    window.resizeDocks([window.findChild(QDockWidget, "dock_compare")], [430], Qt.Orientation.Horizontal)
    part = window.part(ComparePart)
    part.compare_with_step(0)
    part.panel.model.choose(tuple(part.panel.model.rows[:2]))
    editor.until(lambda: not window.notice_area.texts, 30)
    editor.take("editing-compare")
    editing.go_to(0)

    project = document.project
    assert project is not None
    folder = project.parent / "house"
    assert nvsim(["export", "r2r", "--project", str(project), "--out", str(folder), "--no-stub"]) == 0
    (file,) = folder.glob("*_connectivity.json")
    images = folder / "v1" / "scans" / file.name.removesuffix("_connectivity.json") / "matterport_skybox_images"
    images.mkdir(parents=True)
    sky = ["--faces", "--viewpoint", door, "--out", str(images / f"{door}_skybox_small.jpg")]
    assert nvsim(["panorama", "--project", str(project), *sky]) == 0
    editor.session.open(file)
    editor.until(lambda: document.path == file and document.graph is not None)
    half = sorted(graph.viewpoints)[::2]
    assert editing.run("copy_by", {"ids": half, "dz": 3.0})
    editor.only("map", "inspector")
    window.resizeDocks([window.findChild(QDockWidget, "dock_map")], [480], Qt.Orientation.Horizontal)
    document.select(viewpoint=door)
    document.storeys.choose(0)
    table["overview"].trigger()
    panoramas = window.part(InspectorPart).panoramas
    editor.until(lambda: panoramas.current is not None and not panoramas.drawing)
    editor.take("editing-foreign")


if __name__ == "__main__":
    sys.exit(take(shoot, __doc__, SIZE))
