"""Render a hand-held video of the built-in building with its true camera poses.

python tests/benchmarks/hand_held.py FOLDER --scene corridor|house|loop|floors|kitchen [--frames N] [--seed N]
    [--rounds N] [--people] [--fisheye] [--readout SECONDS] [--size 640x480]

The kitchen is filmed from the aisle around the block in its middle, looking down at the furniture; the floor is seldom
in view. `--rounds N` goes around the loop or the kitchen N times. With `--people`, a person walks in front of the
camera for 8 of every 20 seconds. With `--fisheye`, the lens is equidistant and 120 degrees wide. Writes
FOLDER/video.mp4, FOLDER/truth/poses.txt (frame number, then the row-major camera-to-world matrix with OpenCV axes),
FOLDER/truth/camera.txt (a COLMAP camera) and, for one storey, FOLDER/truth/map.yaml (the occupancy map). A pose
belongs to the middle of the exposure of the middle row. Every pixel is the mean of rays spread over the pixel and the
exposure, so that the video has motion blur and, with a readout above 0, a rolling shutter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import tyro
from clinic import clinic_ceiling, clinic_floor, detailed_face, make_clinic
from gait import Motion, carry
from harness import report, timed
from numba import njit, prange
from numpy.typing import NDArray
from rooms import KINDS, make_room

from nvsim.building import BuildingConfig, baking
from nvsim.building.baking import Painters, Textures, bake
from nvsim.building.rendering import _mirror, _trace_pixel
from nvsim.building.scene import Scene, make_person, make_scene, path, with_floor_heights
from nvsim.building.truth import occupancy
from nvsim.geometry.camera import Intrinsics
from nvsim.occupancy.ros import write_ros_map

FPS, EXPOSURE, RADIAL, FIELD_OF_VIEW = 10, 0.015, -0.03, 72.0
"""Frames per second, exposure in seconds, radial distortion coefficient, and field of view along the longer side of the
image in degrees."""
FISHEYE_FIELD_OF_VIEW = 120.0
"""Field of view of the fisheye lens along the longer side of the image, degrees."""
_LENGTH = {"corridor": 784}
_TEXELS = {"_WALL_TEXEL": 0.008, "_FINE_TEXEL": 0.005, "_CEILING_TEXEL": 0.02}
_OFFSETS = np.array([(0.375, 0.125), (0.625, 0.875), (0.875, 0.375), (0.125, 0.625)])
_SHUTTER = np.array([-0.375, 0.375, -0.125, 0.125])
"""Positions of the rays in a pixel, and their times as a share of the exposure. The first two rays are farthest apart.
The other rays are cast only if the colors of the first two differ by at least `_SAME`."""
_SAME = 0.03
_AHEAD, _PRESENT, _PERIOD = 2.5, 8.0, 20.0
"""Seconds by which people are ahead of the camera, for which they are present, and from one to the next."""
_BRIGHT = 0.5  # target mean of the automatic exposure


@dataclass(frozen=True)
class Arguments:
    folder: tyro.conf.Positional[Path]
    scene: Literal["corridor", "house", "loop", "floors", "kitchen"] = "corridor"
    frames: int | None = None
    seed: int = 3
    rounds: int = 1
    people: bool = False
    fisheye: bool = False
    readout: float = 0.0
    size: str = "640x480"


def main() -> None:
    arguments = tyro.cli(Arguments, description=__doc__)
    (scene, textures), built_in = timed(lambda: built(arguments.scene, arguments.seed, arguments.rounds))
    motion = carry(scene.path, np.random.default_rng([arguments.seed, 1]))
    width, height = (int(v) for v in arguments.size.split("x"))
    longer = max(width, height)
    focal = longer / 2 / np.tan(np.radians(FIELD_OF_VIEW) / 2)
    if arguments.fisheye:
        focal = longer / np.radians(FISHEYE_FIELD_OF_VIEW)
    lens = Intrinsics(width, height, focal, focal, width / 2, height / 2)
    longest = arguments.frames or _LENGTH.get(arguments.scene, 1_000_000)
    count = min(longest, int(motion.seconds * FPS))
    (arguments.folder / "truth").mkdir(parents=True, exist_ok=True)
    write_truth(arguments.folder / "truth", motion, lens, count, arguments.fisheye)
    if len(scene.storeys) == 1:
        write_ros_map(occupancy(scene), arguments.folder / "truth" / "map.yaml")
    print(f"{count} frames, {motion.seconds:.0f} s of route, built in {built_in:.0f} s", flush=True)
    video = arguments.folder / "video.mp4"
    _, seconds = timed(lambda: film(video, scene, textures, motion, lens, count, arguments))
    traveled = np.linalg.norm(np.diff(motion.poses(np.arange(count) / FPS)[:, :3, 3], axis=0), axis=1).sum()
    figures = {
        "scene": arguments.scene,
        "frames": count,
        "metres": round(float(traveled), 1),
        "readout": arguments.readout,
        "seconds_per_frame": round(seconds / count, 3),
        "megabytes": round(video.stat().st_size / 1e6, 1),
    }
    report(figures)


def built(name: str, seed: int, rounds: int = 1) -> tuple[Scene, Textures]:
    """The scene with its route, which goes around a loop `rounds` times, and its baked surfaces. The texels are finer
    than in the demo, because the video camera is nearer."""
    for constant, texel in _TEXELS.items():
        setattr(baking, constant, texel)
    if name in ("corridor", "loop"):
        scene = make_clinic("corridor" if name == "corridor" else "loop", seed)
        painters = Painters(clinic_floor, detailed_face, clinic_ceiling)
        if rounds > 1:
            start, *around, end = scene.plan.trajectory_corners
            scene = replace(scene, path=with_floor_heights(path((start, *around * rounds, end)), None))
    elif name == "kitchen":
        scene = make_room(len(KINDS) * seed).scene
        scene = replace(scene, path=around_the_middle(scene, rounds))
        painters = Painters(face=detailed_face)
    else:
        scene = make_scene(BuildingConfig(seed=seed, size="small", people=False, storeys=2 if name == "floors" else 1))
        painters = Painters(face=detailed_face)
        if name == "house":
            stops = scene.plan.trajectory_corners
            scene = replace(scene, path=with_floor_heights(path((*stops, *stops[-2::-1])), None))  # forth and back
    return scene, bake(scene.storeys, list(scene.boxes), scene.solids, np.random.default_rng([seed, 2]), painters)


def around_the_middle(scene: Scene, rounds: int) -> NDArray[np.float64]:
    """(N, 5) the route of `scene` there and back, `rounds` times, as `carry` expects it. The camera looks down at the
    middle of the room and, for a third of the way, at what stands along the walls."""
    ring = scene.path[:, :2]
    ring = np.concatenate([ring, ring[-2:0:-1]] * rounds)
    along = np.append(0, np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1)))
    at = np.arange(0, along[-1], 0.02)
    x, y = (np.interp(at, along, ring[:, i]) for i in (0, 1))
    middle = scene.plan.extent.center
    outward = np.clip(3 * np.sin(2 * np.pi * at / 9) - 1.5, 0, 1)
    heading = np.unwrap(np.arctan2(middle[0] - x, middle[1] - y)) + np.pi * outward
    return np.column_stack([x, y, heading, np.zeros(len(at)), np.full(len(at), np.radians(-28))])


def write_truth(folder: Path, motion: Motion, lens: Intrinsics, count: int, fisheye: bool) -> None:
    lines = [
        "# frame, 16 numbers of the camera-to-world matrix, row-major (OpenCV axes; metres, z up, floor z = 0)",
        *(
            f"{i} " + " ".join(f"{v:.9g}" for v in pose.ravel())
            for i, pose in enumerate(motion.poses(np.arange(count) / FPS))
        ),
    ]
    (folder / "poses.txt").write_text("\n".join(lines) + "\n")
    model, radial = ("SIMPLE_RADIAL_FISHEYE", 0.0) if fisheye else ("SIMPLE_RADIAL", RADIAL)
    camera = f"{model} {lens.width} {lens.height} {lens.fx:.6f} {lens.cx} {lens.cy} {radial}"
    (folder / "camera.txt").write_text(camera)


def film(
    target: Path,
    scene: Scene,
    textures: Textures,
    motion: Motion,
    lens: Intrinsics,
    count: int,
    given: Arguments,
) -> None:
    """Renders, exposes and encodes all frames."""
    rng = np.random.default_rng([given.seed, 3])
    writer = _encoder(target, lens)
    gain, balance = 0.0, np.zeros(3)
    for number in range(count):
        color = frame(scene, textures, motion, lens, number / FPS, given)
        balance = 0.97 * balance + rng.normal(0, 0.004, 3)
        wanted = np.clip(_BRIGHT / float(color.mean()), 0.7, 1.5)
        gain = float(wanted) if number == 0 else gain + 0.12 * (float(wanted) - gain)
        image = 255 * _rolled_off(color * (gain * np.exp(balance)))
        noise = rng.standard_normal(image.shape, np.float32) * np.sqrt(0.8 + 0.012 * image)
        shown = np.clip(image + noise, 0, 255).astype(np.uint8)
        writer.write(np.ascontiguousarray(shown[..., ::-1]))
        if number % 100 == 0:
            print(number, flush=True)
    writer.release()


def _encoder(target: Path, lens: Intrinsics) -> cv2.VideoWriter:
    """An encoder for H.264 if OpenCV has it, else for Motion JPEG.

    MPEG-4 is not used: OpenCV limits it to 200 kbit/s, which loses the texture of walls. Raises RuntimeError if neither
    works.
    """
    for code in ("avc1", "MJPG"):
        writer = cv2.VideoWriter(str(target), cv2.VideoWriter.fourcc(*code), FPS, (lens.width, lens.height))
        if writer.isOpened():
            return writer
    raise RuntimeError(f"OpenCV has no encoder for {target}.")


def _rolled_off(image: NDArray[np.floating]) -> NDArray[np.floating]:
    over = np.maximum(image - 0.85, 0)
    return np.minimum(image, 0.85) + 0.15 * (1 - np.exp(-over / 0.15))


def frame(
    scene: Scene, textures: Textures, motion: Motion, lens: Intrinsics, at: float, given: Arguments
) -> NDArray[np.float32]:
    """(H, W, 3) color from 0 to 1 of the frame at `at` seconds."""
    rows = (np.arange(lens.height) + 0.5) / lens.height - 0.5 if given.readout > 0 else np.zeros(1)
    poses = motion.poses(at + rows[:, None] * given.readout + _SHUTTER * EXPOSURE)
    pinhole = np.array([lens.fx, lens.fy, lens.cx, lens.cy])
    present = walking(motion, at) if given.people else (np.empty((0, 5)), np.empty((0, 3)))
    middle = motion.poses(np.array(at))
    mirrored = _mirror(middle, pinhole, lens.height // 4 + 2, lens.width // 4 + 2, scene.solids, textures, *present)
    color = np.empty((lens.height, lens.width, 3), np.float32)
    _expose(poses, _OFFSETS, pinhole, RADIAL, given.fisheye, scene.solids, textures, *present, mirrored, color)
    return color


def walking(motion: Motion, at: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Capsules (P, 5), meters, and colors (P, 3) of the person who walks in front of the camera at `at` seconds, empty
    if there is none. The person is on the route of the camera, so points on the person hardly move in the image."""
    number = int(at // _PERIOD)
    if at % _PERIOD > _PRESENT or at + _AHEAD > motion.seconds:
        return np.empty((0, 5)), np.empty((0, 3))
    x, y, _ = motion.poses(np.array(at + _AHEAD))[:3, 3]
    person = make_person(float(x), float(y), 0.0, 0, 0, np.random.default_rng(number))
    return person.capsules, person.colors


@njit(cache=True, parallel=True, error_model="numpy")
def _expose(poses, offsets, lens, radial, fisheye, solids, textures, people, clothes, mirrored, color):  # type: ignore[no-untyped-def]
    """Renders the mean of one ray per pose (rows or 1, samples, 4, 4) through each pixel of a lens with radial
    distortion, or of an equidistant fisheye lens."""
    for row in prange(color.shape[0]):
        for column in range(color.shape[1]):
            red, green, blue, apart, count = 0.0, 0.0, 0.0, 0.0, 0
            for s in range(poses.shape[1]):
                if s == 2 and apart < _SAME:
                    break
                xd = (column + offsets[s, 0] - lens[2]) / lens[0]
                yd = (row + offsets[s, 1] - lens[3]) / lens[1]
                x, y = xd, yd
                if fisheye:
                    angle = np.sqrt(x * x + y * y)
                    if angle > 1e-6:
                        x, y = x / angle * np.tan(angle), y / angle * np.tan(angle)
                else:
                    for _ in range(6):
                        factor = 1.0 + radial * (x * x + y * y)
                        x, y = xd / factor, yd / factor
                r, g, b, _, _ = _trace_pixel(
                    x * lens[0] + lens[2], y * lens[1] + lens[3], poses[row % poses.shape[0], s], lens, 1.0 / lens[0],
                    solids, textures, people, clothes, mirrored,
                )  # fmt: skip
                if s == 1:
                    apart = max(abs(r - red), abs(g - green), abs(b - blue))
                red, green, blue, count = red + r, green + g, blue + b, count + 1
            color[row, column, 0] = red / count
            color[row, column, 1] = green / count
            color[row, column, 2] = blue / count


if __name__ == "__main__":
    main()
