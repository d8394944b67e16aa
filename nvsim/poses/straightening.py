"""Straighten a video with its floor and walls, also where few points connect its parts.

Each part gets the scale at which the floor is one camera height below it. Its z axis becomes vertical, and its walls
become parallel or at right angles to those of other parts. A reconstruction of a rotation in place keeps the rotation
and loses scale and position. There, the camera is assumed to move on with the velocity before and after, relative to
its viewing direction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from nvsim.capture.vertical_edges import vertical_from_lines
from nvsim.geometry.rotation import level_axes, rotation_angle, smallest_rotation
from nvsim.poses.building_frame import camera_height, lines_of, vertical_of, wall_direction
from nvsim.poses.mapping import center_of, move_image, poses_of
from nvsim.poses.piece_reliability import (
    Observations,
    firmly_connected_pieces,
    observations_of,
    scale_deviation_at,
    shared_points,
)
from nvsim.poses.pieces import LEAST, ends_of_group, images_beside
from nvsim.poses.pose_graph import FIRM, LOOSE, PartAnchors, empty_anchors, empty_loops, solve, transform_pose
from nvsim.poses.two_views import TwoViews

_LENGTH = 12  # images of a part
_LINED = 12  # images of a part in which lines are detected
_FLOOR_TILT = 0.012  # radians: usual error of a vertical that is known from the floor
_LAST, _FEWEST = 0.7, 3  # seconds, and images at least, from which the velocity of the camera is estimated
_NEAR = 4  # images of a turn between two whose rotations are compared, at most
_MISSING = 3  # images between two reconstructions over which the rotation is extrapolated, at most
_ON_SPOT = 4.0  # degrees between two chosen frames of a camera that rotates in place
_SLOWING = 25.0  # degrees per second: rotating so fast, people walk at half their speed
_FASTER = 2.0  # largest ratio of an assumed speed to the measured one
_SLIPPED = 0.4  # logarithm of the scale: parts of one piece do not differ by more
_LONGEST_TURN, _TURNING = 45, 2.5  # of a rotation in place: images, at most; degrees per image, at least
_CHECKED = 4  # parts with a floor that are needed to test whether a reconstruction has one scale
_OTHER_SCALE, _OTHER_SHARE = 0.06, 0.15  # deviation of the log scale; allowed share of parts beyond it
_SAME_HEIGHT, _SAME_UP, _SAME_WALL = 0.06, 3.0, 3.0  # largest differences across a turn: logarithm, degrees, degrees
_ROTATED_WALL, _OTHER_WALL, _MAIN_SHARE = 3.0, 15.0, 0.5  # degrees from the main direction: wrong; of another wing
_STILL, _SAME_TURN = 0.1, 3.0  # camera heights, degrees: largest differences of two poses of an image of a turn
_REACH = 0.5  # camera heights between an image beside a piece and the end of the piece, at most
_SHARED = 15  # points shared with another image, at least, for an image of a turn to be kept
_DEPTH = 2.0  # camera heights: usual distance of points
_SLIP = 0.1  # drift of the log scale from part to part, at most
_SLIP_FACTOR, _LEAST_SLIP = 5.0, 0.01  # the drift over the deviation that the points predict; the drift, at least
_UPS_AGREE = 0.995  # cosine between the verticals of the floor and of the cameras, at least, for the first to be used
_FIRM = [_SLIP, *[FIRM[1]] * 3, *[FIRM[2] * _DEPTH] * 3]
_LOOSE = [LOOSE[0], *[LOOSE[1]] * 3, *[LOOSE[2]] * 3]
_HEIGHT_CHANGE = 0.02  # camera heights: usual change by dead reckoning between two parts that show a floor
_UP = np.array([0, 0, 1.0])
_UNKNOWN = np.full(3, np.nan)
Poses = dict[int, pycolmap.Rigid3d]


@dataclass(frozen=True, eq=False)
class _UprightPart:
    """numbers  numbers of the images
    piece    number of the firm piece that contains the part, -1 if none
    height   height of the cameras above the floor, NaN if unknown
    up       (3,) unit vector of the vertical, NaN if unknown
    tilt     standard deviation of the vertical, radians
    wall     (3,) unit vector along walls, NaN if unknown
    slip     standard deviation of the logarithm of its scale relative to that of the part before
    """

    numbers: list[int]
    piece: int
    height: float = np.nan
    up: NDArray[np.float64] = field(default_factory=lambda: _UNKNOWN)
    tilt: float = _FLOOR_TILT
    wall: NDArray[np.float64] = field(default_factory=lambda: _UNKNOWN)
    slip: float = np.nan

    def rotated(self, rotation: NDArray[np.float64], scale: float) -> _UprightPart:
        return replace(self, height=self.height * scale, up=rotation @ self.up, wall=rotation @ self.wall)


@dataclass(frozen=True, eq=False)
class _Timeline:
    """times     (N,) seconds of the image numbers 1 to N
    rotating  (N - 1,) bool, whether the camera only rotates from an image to the next
    """

    times: NDArray[np.float64]
    rotating: NDArray[np.bool_]


def straighten_video(
    models: Sequence[pycolmap.Reconstruction],
    folder: Path,
    times: NDArray[np.float64],
    views: Mapping[tuple[int, int], TwoViews],
) -> Poses:
    """Straightened poses of a video, world to camera by image number, in camera heights with z up.

    The result contains the reconstructions that follow each other in time and show a floor. It is empty if none shows a
    floor. `folder` has the images. `times` (N,) are the seconds of image numbers 1 to N. `views` are relative poses of
    pairs of images, by index."""
    poses: Poses = {}
    timeline = _Timeline(times, _only_rotating(views, len(times)))
    parts: list[_UprightPart] = []
    for model in sorted(models, key=lambda m: min(m.reg_image_ids())):
        own, own_parts = _upright(model, folder, timeline, 1 + max((p.piece for p in parts), default=-1))
        if not own:
            continue
        if poses:
            last, first = max(poses), min(own)
            if not last < first <= last + _MISSING:
                continue
            turn = _turned_on(poses, own)
            own = {n: _move_pose(pose, turn, 1.0, np.zeros(3), np.zeros(3)) for n, pose in own.items()}
            start = _dead_reckoned_centers(poses, own, {}, timeline)[first]
            own = {n: _move_pose(pose, np.eye(3), 1.0, center_of(own[first]), start) for n, pose in own.items()}
            own_parts = [part.rotated(turn, 1.0) for part in own_parts]
        poses |= own
        parts += own_parts
    return _solve(poses, parts) if parts else {}


def level_and_scale(model: pycolmap.Reconstruction, folder: Path) -> bool:
    """Rotates a reconstruction in place so that z is up, and scales it so that its cameras are 1 above the floor.
    Returns False and changes nothing if no floor is clear."""
    numbers = sorted(model.reg_image_ids())
    groups = [part.tolist() for part in np.array_split(numbers, max(1, round(len(numbers) / _LENGTH)))]
    found = anchors_of(model, groups, folder) if len(numbers) >= LEAST else empty_anchors(1)
    if not np.isfinite(found.height).any():
        return False
    up = np.nansum(found.up, axis=0)
    scale = 1 / float(np.nanmedian(found.height))
    model.transform(pycolmap.Sim3d(scale, pycolmap.Rotation3d(smallest_rotation(up, _UP)), np.zeros(3)))
    return True


def contradicts_floor(model: pycolmap.Reconstruction, folder: Path) -> bool:
    """Whether a long part of a reconstruction has another scale than the rest, so that its cameras would be higher
    above the floor. False if the floor is not clear. Heights far from the usual one are ignored: they belong to a table
    or a stair. `folder` has the images."""
    numbers = sorted(model.reg_image_ids())
    groups = [part.tolist() for part in np.array_split(numbers, max(1, round(len(numbers) / _LENGTH)))]
    if len(numbers) < LEAST:
        return False
    logs = np.log(anchors_of(model, groups, folder).height)
    logs = logs[np.isfinite(logs)]
    if len(logs) < _CHECKED:
        return False
    off = np.abs(median_filter(logs, 3, mode="nearest") - np.median(logs))
    return bool(((off > _OTHER_SCALE) & (off < _SLIPPED)).mean() > _OTHER_SHARE)


def rotated_images(
    model: pycolmap.Reconstruction, folder: Path, views: Mapping[tuple[int, int], TwoViews], count: int
) -> set[int]:
    """The images of a video of `count` images whose walls are rotated relative to those of most images.

    Where a camera rotates in place, the points may agree with a rotation that is some degrees wrong; the walls of a
    building do not. The images between two such turns are rotated if all of their walls are, with the images of the
    turns. Empty if most parts of the video do not agree on a direction. `folder` has the images. `views` are relative
    poses of pairs of images, by index."""
    registered = set(model.reg_image_ids())
    rotating = _only_rotating(views, count)
    turning = np.concatenate([[False], rotating[:-1] & rotating[1:], [False]])
    runs = np.split(np.arange(1, count + 1), np.flatnonzero(np.diff(turning)) + 1)
    groups: list[list[int]] = []
    run_of: list[int] = []
    for k, run in enumerate(runs):
        own = [n for n in run.tolist() if n in registered]
        if not turning[run[0] - 1] and len(own) >= _FEWEST:
            parts = np.array_split(own, -(-len(own) // _LENGTH))
            groups += [part.tolist() for part in parts]
            run_of += [k] * len(parts)
    if len(groups) < _CHECKED:
        return set()
    found = anchors_of(model, groups, folder)
    known = np.isfinite(found.wall).all(axis=1)
    up = np.nansum(found.up, axis=0)
    if known.sum() < _CHECKED or not up.any():
        return set()
    walls = found.wall[known] @ np.stack(level_axes(up / np.linalg.norm(up)), axis=1)
    angles = np.degrees(np.arctan2(walls[:, 1], walls[:, 0]))
    apart = np.abs((angles[:, None] - angles + 45) % 90 - 45)
    off = apart[(apart < _ROTATED_WALL).sum(axis=1).argmax()]
    if (off < _ROTATED_WALL).mean() <= _MAIN_SHARE:
        return set()
    own_run = np.array(run_of)[known]
    is_right = (off <= _ROTATED_WALL) | (off >= _OTHER_WALL)
    wrong = set(own_run.tolist()) - set(own_run[is_right].tolist())
    beside = {n for k in wrong for n in (k - 1, k + 1) if 0 <= n < len(runs) and turning[runs[n][0] - 1]}
    return registered & {n for k in wrong | beside for n in runs[k].tolist()}


def merge_turning_pieces(
    model: pycolmap.Reconstruction,
    pieces: Sequence[Sequence[int]],
    folder: Path,
    views: Mapping[tuple[int, int], TwoViews],
) -> list[list[int]]:
    """Merges the firm `pieces` of an upright reconstruction if the camera only rotated between them.

    Two pieces are merged if the height above the floor, the vertical, and the walls agree on both sides. The images of
    the turn are kept if they share points with those before or after. Images next to those of a piece are also kept if
    they see points of the piece or continue it by a turn in place. In a turn, few points have a parallax, so its images
    get their poses, in place, from the relative poses `views` of pairs of images, by index. The largest piece comes
    first."""
    own = [list(p) for p in pieces if len(p) >= LEAST]
    rest = [list(p) for p in pieces if len(p) < LEAST]
    runs = _runs(own)
    merged = list(range(len(own)))  # the group of each piece
    for (one, before), (other, after) in zip(runs, runs[1:]):
        if merged[one] != merged[other] and _is_held(model, before, after, folder):
            merged = [merged[one] if m == merged[other] else m for m in merged]
    joined = [sorted(n for p, m in zip(own, merged) if m == group for n in p) for group in sorted(set(merged))]
    seen = observations_of(model)
    shared = shared_points(seen)
    index = {int(n): k for k, n in enumerate(seen.numbers)}
    for group in joined:
        inside = [index[n] for n in group]
        for small in [p for p in rest if group[0] < p[0] and p[-1] < group[-1]]:
            if shared[np.ix_([index[n] for n in small], inside)].max() >= _SHARED:
                group.extend(small)
                rest.remove(small)
        loose = {n for p in rest for n in p}
        group.extend(images_beside(poses_of(model), seen, group, loose, _REACH))
        for end, towards in ends_of_group(group):
            turn = _turn_next_to(poses_of(model), set(group), end, towards, loose - set(group), views)
            inside = [index[n] for n in (*group, *turn)]
            for n, pose in turn.items():
                is_sure = shared[index[n], [k for k in inside if k != index[n]]].max() >= _SHARED
                if not (is_sure and _is_same(model.images[n].cam_from_world(), pose)):
                    move_image(model, n, pose)
            group.extend(turn)
        rest = [left for p in rest if (left := [n for n in p if n not in group])]
    return sorted((sorted(p) for p in [*joined, *rest]), key=len, reverse=True)


def _runs(pieces: Sequence[Sequence[int]]) -> list[tuple[int, list[int]]]:
    """The images of `pieces` in order of time, split where the next image belongs to another piece: the index of the
    piece, and the images. A camera that comes back returns to an earlier piece. Short runs are left out."""
    piece = {n: k for k, own in enumerate(pieces) for n in own}
    runs: list[tuple[int, list[int]]] = []
    for n in sorted(piece):
        if runs and runs[-1][0] == piece[n]:
            runs[-1][1].append(n)
        else:
            runs.append((piece[n], [n]))
    return [(k, run) for k, run in runs if len(run) >= LEAST]


def _turn_next_to(
    poses: Poses,
    group: set[int],
    end: int,
    towards: int,
    loose: set[int],
    views: Mapping[tuple[int, int], TwoViews],
) -> Poses:
    """The images before (`towards` -1) or after (1) the image `end` of a group in which the camera rotates in place,
    with their poses: the rotations follow from image to image, and the centers stay.

    `loose` are the images of no firm piece. `views` are relative poses of pairs of images, by index. Most of those in
    the turn must show a rotation without a translation."""
    turn, at, turned, before = Poses(), center_of(poses[end]), 0.0, poses[end].rotation.matrix()
    for n in range(end + towards, end + towards * (_LONGEST_TURN + 1), towards):
        near = {k: (turn.get(k) or poses[k]).rotation.matrix() for k in group | turn.keys() if abs(k - n) <= _NEAR}
        pairs = {k: p for k in near if (p := views.get((min(k, n) - 1, max(k, n) - 1))) is not None}
        in_turn = [p.turned for k, p in pairs.items() if k in turn or k == end]
        if n not in loose or sum(in_turn) <= len(in_turn) / 2:
            break
        onward = [(p.rotation if k < n else p.rotation.T) @ near[k] for k, p in pairs.items()]
        rotation = Rotation.from_matrix(onward).mean([len(p.matches) for p in pairs.values()]).as_matrix()
        turned, before = turned + rotation_angle(rotation @ before.T), rotation
        if turned < _ON_SPOT * (abs(n - end) - 1):  # a single step may be smaller
            break
        turn[n] = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ at)
    return turn


def _is_same(one: pycolmap.Rigid3d, other: pycolmap.Rigid3d) -> bool:
    """Whether two poses of an image of a turn are equal within their errors."""
    angle = rotation_angle(one.rotation.matrix() @ other.rotation.matrix().T)
    return angle < _SAME_TURN and float(np.linalg.norm(center_of(one) - center_of(other))) < _STILL


def _is_held(model: pycolmap.Reconstruction, before: list[int], after: list[int], folder: Path) -> bool:
    """Whether floor and walls agree on two firm pieces, and the camera only rotated between them."""
    numbers = [n for n in sorted(model.reg_image_ids()) if before[-1] <= n <= after[0]]
    turns = [model.images[n].cam_from_world().rotation.matrix() for n in numbers]
    angles = [rotation_angle(b @ a.T) for a, b in zip(turns, turns[1:])]
    if numbers[-1] - numbers[0] > _LONGEST_TURN or sum(angles) / (numbers[-1] - numbers[0]) < _TURNING:
        return False
    found = anchors_of(model, [before[-2 * _LENGTH :], after[: 2 * _LENGTH]], folder)
    if not (np.isfinite(found.height).all() and np.isfinite(found.wall).all()):
        return False
    up = found.up.sum(axis=0)
    walls = found.wall @ np.stack(level_axes(up / np.linalg.norm(up)), axis=1)
    yaw = np.degrees(np.diff(np.arctan2(walls[:, 1], walls[:, 0]))[0])
    return bool(
        abs(np.log(found.height[1] / found.height[0])) < _SAME_HEIGHT
        and np.degrees(np.arccos(np.clip(found.up[0] @ found.up[1], -1, 1))) < _SAME_UP
        and abs((yaw + 45) % 90 - 45) < _SAME_WALL
    )


def anchors_of(model: pycolmap.Reconstruction, groups: Sequence[Sequence[int]], folder: Path) -> PartAnchors:
    """Floor height, vertical, and wall direction of groups of images, given by number. `folder` has the images."""
    seen = observations_of(model)
    up = vertical_of(seen.rotation)
    if up is None:
        return empty_anchors(len(groups))
    rows = [np.searchsorted(seen.numbers, group) for group in groups]
    return _anchors(_without_outliers([_part_of(model, seen, own, up, folder) for own in rows]))


def _anchors(parts: Sequence[_UprightPart]) -> PartAnchors:
    return PartAnchors(*(np.array([getattr(p, name) for p in parts]) for name in ("height", "up", "tilt", "wall")))


def _upright(
    model: pycolmap.Reconstruction, folder: Path, timeline: _Timeline, first_piece: int
) -> tuple[Poses, list[_UprightPart]]:
    """The images of a reconstruction, piece by piece upright and in camera heights, and their parts. Empty if it shows
    no floor."""
    seen = observations_of(model)
    up = vertical_of(seen.rotation)
    if up is None:
        return {}, []
    piece_of = np.full(len(seen.numbers), -1)
    for k, piece in enumerate(p for p in firmly_connected_pieces(model, timeline.times) if len(p) >= LEAST):
        piece_of[np.searchsorted(seen.numbers, piece)] = first_piece + k
    given = {n: model.images[n].cam_from_world() for n in seen.numbers.tolist()}
    level = smallest_rotation(up, _UP)
    poses: Poses = {}
    parts: list[_UprightPart] = []
    waiting: list[int] = []  # images between two pieces
    runs = np.split(np.arange(len(piece_of)), np.flatnonzero(np.diff(piece_of)) + 1)
    found = [_parts_of(model, seen, run, up, folder, int(piece_of[run[0]])) for run in runs]
    scales = _scales(found)
    for run, own, scale in zip(runs, found, scales):
        if not np.isfinite(scale):
            waiting += seen.numbers[run].tolist()
            continue
        ups = np.nansum([p.up for p in own], axis=0)
        turn = smallest_rotation(level @ ups, _UP) @ level if ups.any() else level
        numbers = seen.numbers[run].tolist()
        here = {n: _move_pose(given[n], turn, scale, center_of(given[numbers[0]]), np.zeros(3)) for n in numbers}
        between = {n: _move_pose(given[n], level, 1.0, np.zeros(3), np.zeros(3)) for n in waiting}
        if poses:
            centers = _dead_reckoned_centers(poses, here, between, timeline)
            here = {n: _move_pose(pose, np.eye(3), 1.0, np.zeros(3), centers[numbers[0]]) for n, pose in here.items()}
        else:
            centers = _dead_reckoned_centers({}, here, between, timeline)
        poses |= {n: _center_pose(pose, centers[n]) for n, pose in between.items()} | here
        parts += [_UprightPart(waiting, -1)] if waiting else []
        parts += [part.rotated(turn, scale) for part in own]
        waiting = []
    if poses and waiting:
        between = {n: _move_pose(given[n], level, 1.0, np.zeros(3), np.zeros(3)) for n in waiting}
        centers = _dead_reckoned_centers(poses, {}, between, timeline)
        poses |= {n: _center_pose(pose, centers[n]) for n, pose in between.items()}
        parts.append(_UprightPart(waiting, -1))
    return poses, parts


def _parts_of(
    model: pycolmap.Reconstruction,
    seen: Observations,
    run: NDArray[np.int64],
    up: NDArray[np.float64],
    folder: Path,
    piece: int,
) -> list[_UprightPart]:
    """The parts of the images `run` of a firm piece. Empty if they belong to no piece (-1)."""
    if piece < 0:
        return []
    chunks = np.array_split(run, max(1, round(len(run) / _LENGTH)))
    slips = [np.nan, *(_SLIP_FACTOR * scale_deviation_at(seen, int(chunk[0])) for chunk in chunks[1:])]
    parts = _without_outliers([_part_of(model, seen, chunk, up, folder) for chunk in chunks])
    return [replace(part, piece=piece, slip=slip) for part, slip in zip(parts, slips)]


def _scales(runs: Sequence[Sequence[_UprightPart]]) -> list[float]:
    """The scale of each run of images of a firm piece, given its parts, so that its cameras are 1 above the floor. A
    run that shows no floor gets the scale of the nearest that does. NaN for images of no piece, and for all if none
    shows a floor."""
    own = np.array([np.nanmedian(logs) if np.isfinite(logs).any() else np.nan for logs in map(_log_heights, runs)])
    known = np.flatnonzero(np.isfinite(own))
    if not len(known):
        return [np.nan] * len(runs)
    nearest = [known[np.abs(known - k).argmin()] for k in range(len(runs))]
    return [float(np.exp(-own[n])) if parts else np.nan for n, parts in zip(nearest, runs)]


def _log_heights(parts: Sequence[_UprightPart]) -> NDArray[np.float64]:
    return np.log([p.height for p in parts]) if parts else np.full(1, np.nan)


def _part_of(
    model: pycolmap.Reconstruction, seen: Observations, rows: NDArray[np.int64], up: NDArray[np.float64], folder: Path
) -> _UprightPart:
    """The part of images `rows` with its height, vertical, and walls. `folder` has the images."""
    mask = np.zeros(len(seen.numbers), bool)
    mask[rows] = True
    part = _UprightPart(seen.numbers[rows].tolist(), 0)
    floor = camera_height(seen, mask, up)
    if floor is not None:
        part = replace(part, height=floor[0], up=floor[1])
    lined = rows[:: max(1, len(rows) // _LINED)]
    images = [(model.images[int(seen.numbers[k])], seen.rotation[k]) for k in lined]
    lines = lines_of(folder, [(image.name, model.cameras[image.camera_id], rotation) for image, rotation in images])
    edges = vertical_from_lines(lines, part.up if floor is not None and part.up @ up > _UPS_AGREE else up)
    if edges is not None:
        floor = camera_height(seen, mask, edges[0], is_exact=True)
        part = replace(part, height=np.nan if floor is None else floor[0], up=edges[0], tilt=edges[1])
    wall = wall_direction(lines, part.up if np.isfinite(part.up).all() else up)
    return part if wall is None else replace(part, wall=wall)


def _without_outliers(parts: list[_UprightPart]) -> list[_UprightPart]:
    """The parts of a piece without outlying heights, which belong to a table or a stair and not to the floor. Verticals
    from edges remain."""
    logs = np.log([p.height for p in parts])
    kept = []
    for k, part in enumerate(parts):
        near = logs[max(0, k - 2) : k + 3]
        usual = np.median(near[np.isfinite(near)]) if np.isfinite(near).any() else np.nan
        if abs(logs[k] - usual) > _SLIPPED:
            part = replace(part, height=np.nan, up=part.up if part.tilt < _FLOOR_TILT else _UNKNOWN)
        kept.append(part)
    return kept


def _only_rotating(views: Mapping[tuple[int, int], TwoViews], count: int) -> NDArray[np.bool_]:
    """(count - 1,) bool, whether the camera only rotates from an image to the next, by the pair that spans the fewest
    images. Such cameras move by some millimeters."""
    rotating = np.zeros(count - 1, bool)
    for first, second in sorted(views, key=lambda pair: pair[0] - pair[1]):  # the longest first
        if 0 < second - first <= _NEAR:
            rotating[first:second] = views[first, second].turned
    return rotating


def _turned_on(before: Poses, after: Poses) -> NDArray[np.float64]:
    """(3, 3) rotation about the vertical of the images `after`. It continues the rotation of `before` at the speed of
    both sides."""
    last, first = max(before), min(after)
    speed = []
    for poses, one in ((before, last - 1), (after, first)):
        if one in poses and one + 1 in poses:
            step = poses[one + 1].rotation.matrix() @ poses[one].rotation.matrix().T
            speed.append(Rotation.from_matrix(step).as_rotvec())
    turned = np.mean(speed, axis=0) * (first - last) if speed else np.zeros(3)
    expected = Rotation.from_rotvec(turned).as_matrix() @ before[last].rotation.matrix()
    there = expected.T @ after[first].rotation.matrix()
    yaw = np.arctan2(there[1, 0] - there[0, 1], there[0, 0] + there[1, 1])
    return np.asarray(Rotation.from_rotvec(yaw * _UP).as_matrix())


def _dead_reckoned_centers(
    before: Poses, after: Poses, between: Poses, timeline: _Timeline
) -> dict[int, NDArray[np.float64]]:
    """Camera centers of the images `between` and of the first image of `after`, by dead reckoning.

    The camera goes on with its velocity relative to the viewing direction, which changes evenly from that at the end of
    `before` to that at the start of `after`. It is slower the faster the camera rotates, and stays where
    images show that it only rotates. If one side is missing, the velocity of the other is used."""
    times = timeline.times
    ends = [(before, max(before))] if before else []
    ends += [(after, min(after))] if after else []
    known = [_velocity(poses, at, timeline) for poses, at in ends]
    poses = {**between, **{at: own[at] for own, at in ends}}
    numbers = sorted(poses)
    first, last = numbers[0], numbers[-1]
    centers = {first: center_of(poses[first]) if before else np.zeros(3)}
    for at, n in zip(numbers, numbers[1:]):
        step = _Step(poses[at], poses[n], float(times[n - 1] - times[at - 1]))
        share = ((times[n - 1] + times[at - 1]) / 2 - times[first - 1]) / max(times[last - 1] - times[first - 1], 1e-9)
        now = _usual_speed(step.rotation_degrees / max(step.seconds, 1e-9))
        one, other = (velocity * min(_FASTER, now / usual) for velocity, usual in (known[0], known[-1]))
        velocity = one * (1 - share) + other * share
        seconds = step.seconds * float(np.mean(~timeline.rotating[at - 1 : n - 1]))
        centers[n] = centers[at] + seconds * np.append(velocity @ step.axes, 0.0)
    if not before:  # shift the centers so that they end at the start of `after`
        off = center_of(poses[last]) - centers[last]
        centers = {n: center + off for n, center in centers.items()}
    return centers


@dataclass(frozen=True, eq=False)
class _Step:
    """The way from a pose to the next of an upright video, and its duration in seconds."""

    one: pycolmap.Rigid3d
    other: pycolmap.Rigid3d
    seconds: float

    @property
    def axes(self) -> NDArray[np.float64]:
        """(2, 2) horizontal unit vectors, in its rows: ahead and to the right."""
        x, y = self.one.rotation.matrix()[2, :2] + self.other.rotation.matrix()[2, :2]
        return np.array([[x, y], [y, -x]]) / max(float(np.hypot(x, y)), 1e-9)

    @property
    def rotation_degrees(self) -> float:
        """Rotation in degrees."""
        return rotation_angle(self.other.rotation.matrix() @ self.one.rotation.matrix().T)


def _velocity(poses: Poses, at: int, timeline: _Timeline) -> tuple[NDArray[np.float64], float]:
    """(2,) velocity ahead and to the right, per second, and the usual speed of a camera that rotates like there: means
    over the images next to image `at`. They are many enough that errors of their places matter little."""
    near = sorted(poses, key=lambda n: abs(n - at))
    times = timeline.times
    near = sorted(n for k, n in enumerate(near) if k < _FEWEST or abs(times[n - 1] - times[at - 1]) <= _LAST)
    steps = [_Step(poses[i], poses[j], float(times[j - 1] - times[i - 1])) for i, j in zip(near, near[1:])]
    seconds = sum(step.seconds for step in steps)
    if seconds <= 0:
        return np.zeros(2), 1.0
    moved = [step.axes @ (center_of(step.other) - center_of(step.one))[:2] for step in steps]
    turned = sum(step.rotation_degrees for step in steps)
    return np.sum(moved, axis=0) / seconds, _usual_speed(turned / seconds)


def _usual_speed(rate: float) -> float:
    """Usual speed of a camera that rotates by `rate` degrees per second, as a share of that without rotation."""
    return 1 / (1 + (rate / _SLOWING) ** 4)


def _solve(poses: Poses, parts: list[_UprightPart]) -> Poses:
    """The poses after one adjustment of all parts to their floor heights, verticals, and walls."""
    pivot = np.array([np.mean([center_of(poses[n]) for n in p.numbers], axis=0) for p in parts])
    joint = np.array([center_of(poses[p.numbers[0]]) for p in parts[1:]]).reshape(-1, 3)
    slip = np.full((len(joint), 7), _LOOSE)
    for k, (one, other) in enumerate(zip(parts, parts[1:])):
        if one.piece == other.piece >= 0:
            slip[k] = _FIRM
            slip[k, 0] = np.clip(np.nan_to_num(other.slip, nan=_SLIP), _LEAST_SLIP, _SLIP)
        else:  # no stair, if the next parts of pieces on both sides show a floor
            beside = [next((p for p in side if p.piece >= 0), one) for side in (parts[k::-1], parts[k + 1 :])]
            slip[k, 6] = _HEIGHT_CHANGE if np.isfinite([p.height for p in beside]).all() else slip[k, 6]
    moves = solve(empty_loops(), pivot, joint, slip, _anchors(parts))
    return {n: transform_pose(poses[n], moves[k], pivot[k]) for k, part in enumerate(parts) for n in part.numbers}


def _center_pose(pose: pycolmap.Rigid3d, center: NDArray[np.float64]) -> pycolmap.Rigid3d:
    return pycolmap.Rigid3d(pose.rotation, -pose.rotation.matrix() @ center)


def _move_pose(
    pose: pycolmap.Rigid3d,
    turn: NDArray[np.float64],
    scale: float,
    pivot: NDArray[np.float64],
    target: NDArray[np.float64],
) -> pycolmap.Rigid3d:
    """A pose after the world is rotated and scaled about `pivot`, which moves to `target`."""
    rotation = pose.rotation.matrix() @ turn.T
    center = scale * turn @ (center_of(pose) - pivot) + target
    return pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ center)
