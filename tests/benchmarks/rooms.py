"""Test the floor level of 20 generated hand-held captures of furnished rooms: a table and one JSON line.

python tests/benchmarks/rooms.py FOLDER [--count N] [--maps N] [--steps N]

Kitchens, offices and bedrooms are filmed from 1.3 to 1.6 m with a lens of 60 degrees. Counters, desks, tables and beds
of 0.45 to 0.95 m fill most images. The captures have no scan. Their poses drift by 1 % of the path and 1 degree, and
their focal length is off by 1 %. The floor is visible below and beside the furniture ("open"), in every sixth image
("little"), or in no image ("none"). Each capture is imported in meters without a camera height, and in an unknown unit
with it. The first `--maps` captures with a floor are also trained and mapped. A finished FOLDER is measured again
without these stages.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parent))
from clinic import detailed_face
from harness import evaluated, report

from nvsim.building import BuildingConfig
from nvsim.building.baking import Painters, bake
from nvsim.building.layouts import outer_walls
from nvsim.building.plan import Plan, Rect, Room, Storey
from nvsim.building.raycast import make_solids, trace
from nvsim.building.rendering import render
from nvsim.building.scene import Scene
from nvsim.building.solids import TOP, Box, Paint, wall_boxes
from nvsim.building.truth import occupancy
from nvsim.cli.main import main as command
from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.occupancy.ros import write_ros_map
from nvsim.perception.floor_height import estimate_floor
from nvsim.project.project import Project

KINDS = ("kitchen", "office", "bedroom")
WIDTH, HEIGHT, FIELD_OF_VIEW, FRAMES = 480, 360, 60.0, 48
DRIFT, TURNED, FOCAL = 0.01, 1.0, 0.01
"""Greatest errors: of positions as a share of the path, of rotations in degrees, of the focal length as a share."""
AISLE = 0.95  # meters between the furniture along the walls and that in the middle
_NOTHING = np.empty((0, 5)), np.empty((0, 3))
_WOOD, _CLOTH, _STONE = (0.56, 0.42, 0.28), (0.34, 0.42, 0.54), (0.45, 0.45, 0.47)


@dataclass(frozen=True)
class Arguments:
    folder: tyro.conf.Positional[Path]
    count: int = 20
    maps: int = 6
    steps: int = 400


@dataclass(frozen=True)
class RoomCapture:
    """A room with the true cameras (N, 4, 4), camera to world, OpenCV axes, floor at z = 0, meters."""

    scene: Scene
    poses: NDArray[np.float64]
    visible: str
    camera_height: float


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    rows = []
    for seed in range(arguments.count):
        folder = arguments.folder / f"{seed:02d}"
        if not (folder / "truth.json").is_file():
            write(make_room(seed), folder, seed)
        rows.append({"capture": seed, **json.loads((folder / "truth.json").read_text()), **floor_found(folder)})
        print(line(rows[-1]), flush=True)
    able = [r for r in rows if r["visible"] != "none" and "level" in r]
    for row in able[: arguments.maps]:
        row |= mapped(arguments.folder / f"{row['capture']:02d}", arguments.steps)
        print(line(row), flush=True)
    print(json.dumps({"rows": rows}))
    report(summary(rows))


def line(row: dict[str, Any]) -> str:
    return "  ".join(f"{name} {value}" for name, value in row.items())


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts of right, wrong and refused captures. A level is right within 0.1 m, a scale within 7 %."""
    levels = [r["level"] for r in rows if "level" in r]
    scales = [r["scale"] for r in rows if "scale" in r]
    figures: dict[str, Any] = {
        "captures": len(rows),
        "right_level": sum(abs(v) <= 0.1 for v in levels),
        "wrong_level": sum(abs(v) > 0.1 for v in levels),
        "level_refused": sum("refused" in r for r in rows),
        "right_scale": sum(abs(v - 1) <= 0.07 for v in scales),
        "wrong_scale": sum(abs(v - 1) > 0.07 for v in scales),
        "scale_refused": sum("scale_refused" in r for r in rows),
    }
    for name in ("node_validity", "edge_validity"):
        found = [r[name] for r in rows if r.get(name) is not None]
        if found:
            figures[name] = round(float(np.mean(found)), 3)
    return figures


def make_room(seed: int) -> RoomCapture:
    """Room `seed`: its furniture along the walls and in the middle, and a hand-held path around the middle."""
    rng = np.random.default_rng([seed, 41])
    kind = KINDS[seed % 3]
    visible = "none" if seed in (6, 7, 11) else "little" if seed % 4 == 2 else "open"
    middle = {"kitchen": (1.5, 0.9), "office": (1.8, 1.0), "bedroom": (1.6, 2.0)}[kind]
    middle = (middle[0] + float(rng.uniform(0, 0.5)), middle[1] + float(rng.uniform(0, 0.2)))
    around = 0.72  # outer walls are 0.1 m inside, and the furniture along them is 0.6 m deep
    width, depth = (round(v + 2 * (AISLE + around), 2) for v in middle)
    plan = Plan(
        Rect(0, 0, width, depth),
        (Room("room", kind, str(rng.choice(["tiles", "wood", "carpet"])), (Rect(0, 0, width, depth),)),),
        tuple(outer_walls(width, depth)),
        (),
        (),
    )
    boxes = wall_boxes(plan, {"room": Paint("wall-band", (0.72, 0.7, 0.64), (0.5, 0.55, 0.6))}, Paint("plain", _WOOD))
    boxes += _furniture(kind, visible, rng, (width, depth), middle, around)
    ring = _ring(rng, (width, depth), middle)
    storeys = (Storey(plan, 0.0),)
    solids = make_solids(storeys, boxes)
    walk = np.column_stack([ring, np.zeros((len(ring), 3))])
    scene = Scene(BuildingConfig(seed=seed, people=False), storeys, walk, walk, tuple(boxes), solids, ())
    height = float(rng.uniform(1.3, 1.6))
    return RoomCapture(scene, _poses(rng, scene, ring, height, visible), visible, height)


def _furniture(
    kind: str,
    visible: str,
    rng: np.random.Generator,
    size: tuple[float, float],
    middle: tuple[float, float],
    around: float,
) -> list[Box]:
    """Furniture along three or four walls and in the middle, with things on it."""
    (width, depth), boxes = size, []
    tall = {"kitchen": (0.88, 0.95), "office": (0.70, 0.78), "bedroom": (0.70, 0.90)}[kind]
    top = float(rng.uniform(*tall))
    paint = {
        "kitchen": Paint("desk", _STONE, (0.6, 0.3, 0.2)),
        "office": Paint("desk", _WOOD, (0.3, 0.4, 0.6)),
        "bedroom": Paint("wood", _WOOD),
    }[kind]
    sides = [
        (0.1, 0.1, width - 0.1, around),
        (0.1, depth - around, width - 0.1, depth - 0.1),
        (0.1, around, around, depth - around),
        (width - around, around, width - 0.1, depth - around),
    ]
    open_below = kind == "office" and visible == "open"
    for i, (x0, y0, x1, y1) in enumerate(sides):
        if i == 3 and visible == "open":
            continue  # a bare wall
        boxes += _top(x0, y0, x1, y1, top, Paint("drawers", _WOOD), paint, legs=open_below)
        boxes += _things(rng, Rect(x0, y0, x1, y1), top, 6)
    x0, y0 = (width - middle[0]) / 2, (depth - middle[1]) / 2
    x1, y1 = x0 + middle[0], y0 + middle[1]
    height = float(rng.uniform(0.45, 0.6) if kind == "bedroom" else rng.uniform(0.72, 0.95))
    cover = Paint("cloth", _CLOTH) if kind == "bedroom" else paint
    legs = kind != "bedroom" and visible == "open"
    boxes += _top(x0, y0, x1, y1, height, Paint("cloth" if kind == "bedroom" else "drawers", _CLOTH), cover, legs)
    return boxes + _things(rng, Rect(x0, y0, x1, y1), height, 8 if kind != "bedroom" else 4)


def _top(x0: float, y0: float, x1: float, y1: float, height: float, body: Paint, top: Paint, legs: bool) -> list[Box]:
    if not legs:
        return [Box((x0, y0, 0.0), (x1, y1, height), body, ((TOP, top),))]
    posts = [(x, y) for x in (x0 + 0.03, x1 - 0.09) for y in (y0 + 0.03, y1 - 0.09)]
    return [
        Box((x0, y0, height - 0.04), (x1, y1, height), body, ((TOP, top),)),
        *(Box((x, y, 0.0), (x + 0.06, y + 0.06, height - 0.04), body) for x, y in posts),
    ]


def _things(rng: np.random.Generator, on: Rect, height: float, count: int) -> list[Box]:
    """Small boxes on a surface."""
    boxes = []
    for _ in range(count):
        w, d, h = rng.uniform(0.06, 0.3, 3)
        x, y = rng.uniform(on.x0, on.x1 - w), rng.uniform(on.y0, on.y1 - d)
        color = tuple(float(v) for v in rng.uniform(0.15, 0.8, 3))
        paint = Paint(str(rng.choice(["carton", "cloth", "books"])), (color[0], color[1], color[2]))
        boxes.append(Box((x, y, height), (x + w, y + d, height + 0.7 * h), paint))
    return boxes


def _ring(rng: np.random.Generator, size: tuple[float, float], middle: tuple[float, float]) -> NDArray[np.float64]:
    """(FRAMES, 2) places along most of the aisle around the middle, meters."""
    halves = np.array(middle) / 2 + AISLE / 2
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) * halves + np.array(size) / 2
    lengths = np.append(0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    at = np.linspace(0, 0.85 * lengths[-1], FRAMES)
    ring = np.column_stack([np.interp(at, lengths, corners[:, i]) for i in (0, 1)])
    return np.asarray(ring + _smooth(rng, 2, 0.06), np.float64)


def _smooth(rng: np.random.Generator, columns: int, most: float, waves: int = 6) -> NDArray[np.float64]:
    """(FRAMES, columns) slow random motion with the greatest value `most`."""
    at = np.linspace(0, 2 * np.pi, FRAMES)[:, None]
    motion = sum(
        rng.normal(0, 1 / k, columns) * np.sin(k * at / 2 + rng.uniform(0, 2 * np.pi, columns))
        for k in range(1, waves + 1)
    )
    return np.asarray(most * motion / np.abs(motion).max(axis=0), np.float64)


def _poses(
    rng: np.random.Generator, scene: Scene, ring: NDArray[np.float64], height: float, visible: str
) -> NDArray[np.float64]:
    """(FRAMES, 4, 4) cameras that look across the furniture of the middle or of a wall, with the shake of a hand."""
    center = np.array(scene.plan.extent.center)
    shake, rise = _smooth(rng, 3, 2.5, 12), _smooth(rng, 1, 0.04, 10)[:, 0]
    glance = np.sin(np.linspace(0, 6 * np.pi, FRAMES) + rng.uniform(0, 6))
    poses = []
    for i, place in enumerate(ring):
        to = center - place
        heading = np.arctan2(to[0], to[1]) + (0.5 * glance[i] if glance[i] < 0.3 else np.pi + 0.4 * glance[i])
        down = 32 + 6 * np.sin(i / 5)
        ahead = ring[min(i + 1, FRAMES - 1)] - ring[max(i - 1, 0)]
        if visible == "open" and i % 3 == 0 or visible == "little" and i % 6 == 0:  # along the aisle
            heading, down = np.arctan2(ahead[0], ahead[1]), 30.0
        position = np.array([*place, height + rise[i]])
        for raised in range(0, 60, 3):
            pose = camera_pose(position, heading, -np.radians(down - raised))
            pose[:3, :3] = pose[:3, :3] @ Rotation.from_euler("xyz", shake[i], degrees=True).as_matrix()
            if visible != "none" or not _sees_floor(scene, pose):
                break
        poses.append(pose)
    return np.array(poses)


def _sees_floor(scene: Scene, pose: NDArray[np.float64]) -> bool:
    rays = Camera(lens(24, 18), pose).rays().astype(np.float64).reshape(-1, 3)
    eye = pose[:3, 3]
    hit = [trace(*eye, *ray, scene.solids, _NOTHING[0])[1] for ray in rays]
    return scene.floor_surface in hit


def lens(width: int, height: int) -> Intrinsics:
    return Intrinsics.from_fov(width, height, np.radians(FIELD_OF_VIEW))


def write(room: RoomCapture, folder: Path, seed: int) -> None:
    """Writes the images, the perturbed capture in meters (metric/) and in an unknown unit (unscaled/), and truth."""
    rng = np.random.default_rng([seed, 43])
    scene = room.scene
    painters = Painters(face=detailed_face)
    textures = bake(scene.storeys, list(scene.boxes), scene.solids, np.random.default_rng([seed, 4]), painters)
    (folder / "images").mkdir(parents=True, exist_ok=True)
    floor_share = []
    for i, pose in enumerate(room.poses):
        view = render(Camera(lens(WIDTH, HEIGHT), pose), scene.solids, textures, *_NOTHING)
        image = 255 * np.clip(view.color * np.exp(rng.normal(0, 0.03)), 0, 1) + rng.normal(0, 2, view.color.shape)
        shown = np.clip(image, 0, 255).astype(np.uint8)[..., ::-1]
        cv2.imwrite(str(folder / "images" / f"{i:03d}.jpg"), shown, [cv2.IMWRITE_JPEG_QUALITY, 92])
        floor_share.append(float(np.mean(view.surface == scene.floor_surface)))
    poses = perturbed(room.poses, rng)
    unit = float(rng.uniform(0.3, 3.0))
    focal = lens(WIDTH, HEIGHT).fx * (1 + FOCAL * float(rng.choice([-1, 1])))
    for name, scale in (("metric", 1.0), ("unscaled", unit)):
        frames = []
        for i, pose in enumerate(poses):
            matrix = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
            matrix[:3, 3] *= scale
            frames.append({"file_path": f"../images/{i:03d}.jpg", "transform_matrix": matrix.tolist()})
        tree: dict[str, Any] = {
            "w": WIDTH,
            "h": HEIGHT,
            "fl_x": focal,
            "fl_y": focal,
            "cx": WIDTH / 2,
            "cy": HEIGHT / 2,
        }
        tree |= {"unit": "meter"} if name == "metric" else {}
        (folder / name).mkdir(exist_ok=True)
        (folder / name / "transforms.json").write_text(json.dumps({**tree, "frames": frames}))
    write_ros_map(occupancy(scene), folder / "map.yaml")
    truth = {
        "kind": scene.plan.rooms[0].kind,
        "visible": room.visible,
        "floor_pixels": round(float(np.mean(floor_share)), 3),
        "camera_height": round(room.camera_height, 3),
        "unit": unit,
    }
    (folder / "truth.json").write_text(json.dumps(truth))


def perturbed(poses: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """The poses (N, 4, 4) with slow drift, as of a phone or of structure from motion."""
    path = float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())
    moved, turned = _smooth(rng, 3, DRIFT * path / 2, 4), _smooth(rng, 3, TURNED / 2, 4)
    found = poses.copy()
    found[:, :3, :3] = Rotation.from_euler("xyz", turned, degrees=True).as_matrix() @ poses[:, :3, :3]
    found[:, :3, 3] += moved
    return found


def attempted(*words: str) -> str | None:
    """Runs a command in this process, because most of the time of a small capture is the start of a process. Returns
    None, or the last line of its message if it fails."""
    said = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        code = command(words)
    return None if code == 0 else f"exit {code}: {(said.getvalue().strip().splitlines() or ['no message'])[-1]}"


def floor_found(folder: Path) -> dict[str, Any]:
    """Level of the found floor in meters (0 is right), and the found scale divided by the true one; or refusals."""
    truth = json.loads((folder / "truth.json").read_text())
    found: dict[str, Any] = {}
    project = folder / "metric.nvsim"
    failed = None
    if not (project / "cloud.done").is_file():
        failed = attempted("import", str(folder / "metric"), "--project", str(project))
        failed = failed or attempted("submaps", "--project", str(project))
        failed = failed or attempted("depth", "--project", str(project))
        if failed is None:
            (project / "cloud.done").touch()
    if failed is not None:
        found["refused"] = failed
    else:
        read = Project.open(project)
        capture = read.need_capture()
        tilt = float(np.degrees(np.arccos(np.clip(capture.alignment.rotation[2, 2], -1, 1))))
        found["tilt"] = round(tilt, 1)
        try:
            surface = estimate_floor(read.scan(), capture.positions)
            height = float(np.median(capture.positions[:, 2] - surface.height_at(capture.positions[:, :2])))
            found["level"] = round(truth["camera_height"] - height, 3)
        except InputError as error:
            found["refused"] = str(error)
    scaled = folder / "unscaled.nvsim"
    height_given = str(round(truth["camera_height"], 2))
    failed = attempted("import", str(folder / "unscaled"), "--camera-height", height_given, "--project", str(scaled))
    if failed is not None:
        found["scale_refused"] = failed
    else:
        found["scale"] = round(Project.open(scaled).need_capture().alignment.scale * truth["unit"], 3)
    return found


def mapped(folder: Path, steps: int) -> dict[str, Any]:
    """Validity of the map of a capture in meters, against the plan of its room."""
    project = str(folder / "metric.nvsim")
    train = ("train", "--steps", str(steps), "--image-size", "240", "--project", project)
    for words in (("floors", "--project", project), train, ("map", "--project", project)):
        failed = attempted(*words)
        if failed is not None:
            return {"map_refused": failed}
    figures = evaluated("graph", "--project", project, "--occupancy", str(folder / "map.yaml"))
    return {k: v for k, v in figures.items() if not isinstance(v, dict | list)}


if __name__ == "__main__":
    main()
