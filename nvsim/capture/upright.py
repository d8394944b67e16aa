"""Find images that are stored sideways or upside down, and turn them upright. Phones that are held upright store such
images, and so do cameras that are mounted sideways.

The files are not changed: the lens of a frame has the number of quarter turns, and the pose belongs to the upright
image. People and networks then see floors at the bottom.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.alignment import HELD_UPRIGHT, are_sideways, find_up, turned_pose
from nvsim.capture.findings import Findings
from nvsim.capture.images import image_header
from nvsim.capture.raw import RawCapture, RawFrame
from nvsim.capture.types import DepthFile
from nvsim.geometry.sampling import evenly_spaced

_ALONG_AXIS = 10.0  # degrees between the vertical and an axis of the world: the axis y or z of the world points up
_TURNED_A_LITTLE = 0.05  # see `are_sideways`: about 20 degrees to either side
_TURNS_OF_TAG = {6: 3, 8: 1}  # Exif orientation -> counterclockwise quarter turns
_TAGGED = 20  # images whose orientation tags are read
_STEEP = 0.35  # length of the vertical in the image plane: below it, the camera looks too steeply up or down
_KEPT = 0.6  # a frame is turned as most others if the vertical is within about 53 degrees of that
_FEWEST = 3  # images that are turned by a quarter: fewer are more likely wrong poses
_UPSIDE_DOWN = 0.2  # share of a camera's images that are turned by half a turn: fewer are more likely wrong poses


def turn_upright(raw: RawCapture, findings: Findings, up: NDArray[np.float64] | None = None) -> RawCapture:
    """`raw` with its images turned upright, with their depth images. A note states how many are turned.

    up  (3,) unit vector of the source's world that points up; None to find it from the poses"""
    posed = [i for i, f in enumerate(raw.frames) if f.camera_to_world is not None and f.lens is not None]
    if not posed:
        return raw
    poses = np.array([raw.frames[i].camera_to_world for i in posed])
    if up is None:
        up = _find_vertical(poses, [raw.frames[i] for i in posed])
    sensors = [raw.frames[i].sensor for i in posed]
    turns = {i: turn for i, turn in zip(posed, _turns(poses, sensors, up), strict=True) if turn}
    if not turns:
        return raw
    frames = list(raw.frames)
    for i, turn in turns.items():
        lens, pose = frames[i].lens, frames[i].camera_to_world
        assert lens is not None and pose is not None
        frames[i] = replace(frames[i], lens=replace(lens, turns=turn), camera_to_world=turned_pose(pose, turn))
    of_name = {raw.frames[i].name: turn for i, turn in turns.items()}
    depths = tuple(_turned_depth(d, of_name[d.frame]) if d.frame in of_name else d for d in raw.depths)
    findings.note(
        f"{len(turns)} of {len(raw.frames)} images are sideways or upside down",
        raw.source.name,
        "they are turned upright when they are read; the files are not changed",
    )
    return replace(raw, frames=tuple(frames), depths=depths)


def _turned_depth(depth: DepthFile, turns: int) -> DepthFile:
    lens = replace(depth.lens, turns=turns)
    return replace(depth, lens=lens, camera_to_world=turned_pose(depth.camera_to_world, turns))


def _find_vertical(poses: NDArray[np.float64], frames: Sequence[RawFrame]) -> NDArray[np.float64]:
    """(3,) unit vector that points up, if the images may be sideways. `poses` (N, 4, 4) belong to `frames`.

    The poses do not tell which end of the vertical is up: orientation tags tell it, or else an axis of the world. If
    the cameras turn little, these also decide whether the images are sideways."""
    found, rights, downs = find_up(poses)[0], poses[:, :3, 0], poses[:, :3, 1]
    if not are_sideways(rights, downs, _TURNED_A_LITTLE):
        return found
    up = find_up(turned_pose(poses, HELD_UPRIGHT))[0]
    headers = (image_header(frames[i].image_path) for i in evenly_spaced(len(frames), _TAGGED))
    ((tag, _),) = Counter(0 if header is None else _TURNS_OF_TAG.get(header[2], 0) for header in headers).most_common(1)
    if tag:
        return up if tag == HELD_UPRIGHT else -up
    along, against, was_along = [max(up[1:]), max(-up[1:]), max(abs(found[1:]))] > np.cos(np.radians(_ALONG_AXIS))
    if not are_sideways(rights, downs) and (was_along or not (along or against)):
        return found
    return -up if against else up


def _turns(poses: NDArray[np.float64], sensors: Sequence[str], up: NDArray[np.float64]) -> list[int]:
    """The counterclockwise quarter turns that make each image upright. `poses` is (N, 4, 4)."""
    across, down = (poses[:, :3, :2].transpose(0, 2, 1) @ up).T
    fits = np.stack([-down, across, down, -across], axis=1)  # cosine of the angle that remains, by the turns
    steep = np.hypot(across, down) < _STEEP
    turns = fits.argmax(axis=1)
    if 4 * len(set(sensors)) > len(sensors):  # a camera model for each image
        sensors = [""] * len(sensors)
    for sensor in dict.fromkeys(sensors):
        own = np.flatnonzero(np.array(sensors) == sensor)
        known = own[~steep[own]]
        if not len(known):
            turns[own] = 0
            continue
        usual = int(np.bincount(turns[known], minlength=4).argmax())
        alike = known[fits[known, usual] > _KEPT * np.hypot(across, down)[known]]
        turns[alike] = usual
        counts = np.bincount(turns[known], minlength=4)
        usual = usual if counts[usual] >= _FEWEST else 0
        for turn in range(4):
            fewest = max(_FEWEST, _UPSIDE_DOWN * len(own)) if (turn - usual) % 4 == 2 else _FEWEST
            if counts[turn] < fewest:
                turns[known[turns[known] == turn]] = usual
        for frame in own[steep[own]]:
            turns[frame] = turns[known[np.abs(known - frame).argmin()]]
    return [int(turn) for turn in turns]
