"""Explanations of wrong poses and lenses: frequent mistakes, each undone and tested against the images.

Each test undoes one mistake. If the images agree with the result and contradict the given poses, that mistake is the
explanation.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.axes import CHOICES, DESCRIPTIONS, Axes, convert_axes
from nvsim.geometry.lens import Lens
from nvsim.poses.agreement import AGREES, Evidence, Float, match_errors

_SHIFTS = 10  # frames by which poses may be late or early
_WELL = 0.7  # share of the pairs that agree with an explanation, at least
_BETTER = 0.5  # misses with the explanation over misses with the given poses, at most
_PAIRS = 80  # pairs to which lenses are fitted
_LONGER, _ASIDE = 1.0, 0.35  # bounds: logarithm of a change of the focal length, shift as a share of the image
_LENS_FITS = (0.85, 2.0)  # for a lens explanation: least share of the pairs that agree, largest median miss in pixels
_NAMED = 3  # explanations that are named if they fit equally well
_NOTICEABLE = 0.02  # smallest relative change of a lens that is reported
_GL = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Explanation:
    """message  what is wrong with the poses or the lens, as text
    axes     the value of --axes that corrects it, "" if no value does
    share    share of the pairs that agree after the correction; `miss` is their median in pixels of a 640-pixel image
    is_lens  whether the lens is wrong, not the poses
    """

    message: str
    axes: str
    share: float
    miss: float
    is_lens: bool = False


def explain(
    poses: Float, read: Float, own: str, names: Sequence[str], order: Sequence[int], evidence: Evidence
) -> Explanation | None:
    """Finds the mistake whose correction makes poses (N, 4, 4) agree with the images. None if no correction does.

    read   (N, 4, 4) the poses in the format's `own` camera axes ("opencv" or "opengl"), before --axes is applied
    names  of the frames; `order` has the frame indices in order of time
    """
    rays, focal = evidence.rays(), evidence.focal()
    given = match_errors(poses, evidence, rays, focal)
    found = [lens] if (lens := _lens_explanation(poses, evidence)) is not None else []
    tried = []
    for message, axes, undone in (*_conventions(read, own), *_orders(poses, names, order)):
        valid = np.isfinite(undone[evidence.frames]).all(axis=(1, 2, 3))
        if np.count_nonzero(valid) >= max(6, len(evidence) // 3):
            left = match_errors(np.nan_to_num(undone), evidence, rays, focal)[valid]
            tried.append(Explanation(message, axes, float(np.mean(left < AGREES)), float(np.median(left))))
    best = max((t.share for t in tried), default=0.0)
    least = min((t.miss for t in tried if t.share >= best - 0.03), default=0.0)
    alike = [t for t in tried if t.share >= best - 0.03 and t.miss < 1.5 * least + 0.1]
    if alike:  # several fit if the camera moved in a plane or never rotated
        words = list(dict.fromkeys(t.message for t in alike))[:_NAMED]
        found.append(replace(alike[0], message=", or ".join(words)))
    before, share = float(np.median(given)), float(np.mean(given < AGREES))
    good = [f for f in found if f.share >= max(_WELL, share) and f.miss < _BETTER * before]
    return min((f for f in good if f.is_lens or f.share > share + 0.2), key=lambda f: f.miss, default=None)


def _conventions(poses: Float, own: str) -> Iterator[tuple[str, str, Float]]:
    for axes in CHOICES:
        if axes != "auto":
            yield _words(axes, own), axes, convert_axes(poses, own, axes)
    # Only the rotation is wrong. Test it in each direction and with the axes in which a format may store it.
    for change, words in (
        (lambda r: np.swapaxes(r, 1, 2), "their rotations are transposed (rows and columns are exchanged)"),
        (
            partial(_shift_quaternion_components, turn=1),
            "their quaternions are in another order (x y z w instead of w x y z)",
        ),
        (
            partial(_shift_quaternion_components, turn=-1),
            "their quaternions are in another order (w x y z instead of x y z w)",
        ),
    ):
        yield words, "", _change_rotations(poses, change)
        yield words, "", _change_rotations(poses @ _GL, change) @ _GL
        yield words, "", _invert_poses(_change_rotations(_invert_poses(poses), change))
    turn, place = poses[:, :3, :3], poses[:, :3, 3]
    mixed = "their positions and rotations are of opposite directions (camera to world and world to camera)"
    for moved in (
        np.swapaxes(turn, 1, 2) @ -place[..., None],
        turn @ -place[..., None],
        turn @ -(place * (1, -1, -1))[..., None],
    ):
        yield mixed, "", _change_positions(poses, moved[..., 0])
    for axis, name in enumerate("xyz"):
        yield (
            f"their positions are mirrored along {name}",
            "",
            _change_positions(poses, place * (1 - 2 * (np.arange(3) == axis))),
        )
    for sign in (1, -1):
        swapped = place[:, [0, 2, 1]] * (1, sign, -sign)
        yield "the y and z axes of their positions are exchanged", "", _change_positions(poses, swapped)
    for angle, turned in ((180, [[-1, 0], [0, -1]]), (90, [[0, -1], [1, 0]]), (270, [[0, 1], [-1, 0]])):
        yield f"the images are turned by {angle} degrees", "", _change_views(poses, np.array(turned, np.float64))
    for mirror in (np.diag([-1.0, 1.0]), np.diag([1.0, -1.0])):
        yield "the images or the world are mirrored (left-handed)", "", _change_views(poses, mirror)


def _words(axes: Axes, own: str) -> str:
    name, _, opposite = axes.partition("-")
    parts = []
    if opposite:
        parts.append("they are in the opposite direction (camera to world exchanged with world to camera)")
    if name != own or not opposite:
        parts.append(f"they have {DESCRIPTIONS[name]}")
    return " and ".join(parts)


def _orders(poses: Float, names: Sequence[str], order: Sequence[int]) -> Iterator[tuple[str, str, Float]]:
    index = np.array(order)
    by_text = sorted(order, key=lambda i: names[i])
    by_number = sorted(order, key=lambda i: [int(w) if w.isdigit() else w for w in re.split(r"(\d+)", names[i])])
    missing = np.full_like(poses, np.nan)
    yield "they are in reverse order", "", _with_rows(missing, index, poses[index[::-1]])
    if by_text != by_number:
        words = "their order is by number, that of the images by letters (2 after 10), or the reverse"
        yield words, "", _with_rows(missing, np.array(by_number), poses[by_text])
        yield words, "", _with_rows(missing, np.array(by_text), poses[by_number])
    for shift in range(1, min(_SHIFTS, len(order) - 1) + 1):
        plural = "s" if shift > 1 else ""
        words = f"there is a time offset: the pose of each image is listed {shift} frame{plural} %s"
        yield words % "later", "", _with_rows(missing, index[:-shift], poses[index[shift:]])
        yield words % "earlier", "", _with_rows(missing, index[shift:], poses[index[:-shift]])


def _with_rows(poses: Float, rows: NDArray[np.int64], values: Float) -> Float:
    result = poses.copy()
    result[rows] = values
    return result


def _change_rotations(poses: Float, change: Callable[[Float], Float]) -> Float:
    result = poses.copy()
    result[:, :3, :3] = change(poses[:, :3, :3])
    return result


def _change_positions(poses: Float, positions: Float) -> Float:
    result = poses.copy()
    result[:, :3, 3] = positions
    return result


def _change_views(poses: Float, image: Float) -> Float:
    """Poses of cameras whose images are rotated or mirrored by `image` (2, 2)."""
    turned = np.eye(4)
    turned[:2, :2] = image
    return poses @ turned


def _invert_poses(poses: Float) -> Float:
    back = np.swapaxes(poses[:, :3, :3], 1, 2)
    return _change_positions(_change_rotations(poses, lambda _: back), -(back @ poses[:, :3, 3, None])[..., 0])


def _shift_quaternion_components(rotations: Float, turn: int) -> Float:
    """Rotations (N, 3, 3) whose quaternions x y z w are shifted by `turn` places."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(np.roll(Rotation.from_matrix(rotations).as_quat(), turn, axis=1)).as_matrix())


@dataclass(frozen=True)
class _LensChange:
    """A change of a lens: factors of the `focal` lengths (x, y) and of the `distortion`. `middle` is the shift of the
    principal point as a share of width and height."""

    focal: tuple[float, float] = (1.0, 1.0)
    middle: tuple[float, float] = (0.0, 0.0)
    distortion: float = 1.0

    def of(self, lens: Lens) -> Lens:
        (fx, fy), (cx, cy) = lens.focal, lens.principal_point
        fx, fy = fx * self.focal[0], fy * self.focal[1]
        cx, cy = cx + self.middle[0] * lens.width, cy + self.middle[1] * lens.height
        head = (fx, fy, cx, cy) if len(lens.params) - len(lens.distortion) == 4 else (np.sqrt(fx * fy), cx, cy)
        return replace(lens, params=(*head, *(k * self.distortion for k in lens.distortion)))


def _lens_explanation(poses: Float, evidence: Evidence) -> Explanation | None:
    """The lens that fits the images best with the given poses, if it fits much better than the given lens."""
    from scipy.optimize import minimize

    rows = np.zeros(len(evidence), bool)
    rows[np.unique(np.linspace(0, len(evidence) - 1, min(_PAIRS, len(evidence))).astype(int))] = True
    sample = evidence.select_pairs(rows)

    def errors_after_change(change: _LensChange) -> Float:
        kinds = [change.of(lens) for lens in sample.kinds]
        # Use the longer focal length: with an ever shorter one, errors in pixels would shrink to zero.
        focal = np.maximum(sample.focal(kinds), sample.focal())
        return match_errors(poses, sample, sample.rays(kinds), focal)

    def cost(change: _LensChange) -> float:
        return float(np.mean(np.log1p(errors_after_change(change))))

    factors = np.exp(np.linspace(-1, 1, 27))
    start = min(factors, key=lambda f: cost(_LensChange((f, f))))

    def fit_change(
        parameters: Callable[[Float], _LensChange], first: Sequence[float], steps: Sequence[float]
    ) -> _LensChange:
        simplex = np.array([first, *(np.array(first) + np.diag(steps))])
        options = {"initial_simplex": simplex, "maxiter": 40 * len(first), "xatol": 1e-3, "fatol": 1e-3}
        bounds = [(-_LONGER, _LONGER) if step < 0.1 else (-_ASIDE, _ASIDE) for step in steps]
        found = minimize(lambda v: cost(parameters(v)), first, method="Nelder-Mead", bounds=bounds, options=options)
        return parameters(found.x)

    lens = sample.kinds[0]
    (fx, fy), (cx, cy) = lens.focal, lens.principal_point
    options = [fit_change(lambda v: _LensChange((np.exp(v[0]), np.exp(v[0]))), [np.log(start)], [0.05])]
    if lens.is_distorted:
        options += [_LensChange(distortion=-1.0), _LensChange(distortion=0.0)]
    options += [
        _LensChange((fy / fx, fx / fy)),
        _LensChange(middle=((cy - cx) / lens.width, (cx - cy) / lens.height)),
        fit_change(lambda v: _LensChange(middle=(v[0], v[1])), [0.0, 0.0], [0.1, 0.1]),
        fit_change(lambda v: _LensChange((np.exp(v[0]), np.exp(v[1]))), [np.log(start)] * 2, [0.05, 0.05]),
        fit_change(
            lambda v: _LensChange((np.exp(v[0]), np.exp(v[0])), (v[1], v[2])),
            [np.log(start), 0.0, 0.0],
            [0.05, 0.1, 0.1],
        ),
    ]
    costs = [cost(option) for option in options]
    simplest = next(o for o, c in zip(options, costs, strict=True) if c < 1.2 * min(costs) + 0.03)
    after = errors_after_change(simplest)
    share, miss = float(np.mean(after < AGREES)), float(np.median(after))
    words = _lens_words(lens, simplest)
    if not words or share < _LENS_FITS[0] or miss > _LENS_FITS[1]:
        return None
    return Explanation(words, "", share, miss, is_lens=True)


def _lens_words(lens: Lens, change: _LensChange) -> str:
    fitting, parts = change.of(lens), []
    (fx, fy), (cx, cy) = lens.focal, lens.principal_point
    (gx, gy), (dx, dy) = fitting.focal, fitting.principal_point
    if change.distortion != 1:
        parts.append(
            "the distortion has the wrong sign"
            if change.distortion < 0
            else "the images are undistorted already, but the lens has distortion"
        )
    elif abs(gx / fy - 1) + abs(gy / fx - 1) < 1e-6 and abs(fx / fy - 1) > _NOTICEABLE:
        parts.append(f"the focal lengths of x and y are exchanged: {gx:.4g} and {gy:.4g} fit")
    elif abs(np.log(gx / fx)) > _NOTICEABLE or abs(np.log(gy / fy)) > _NOTICEABLE:
        ratio = float(np.sqrt(gx * gy / (fx * fy)))
        off = f"{1 / ratio:.3g} times too long" if ratio < 1 else f"{ratio:.3g} times too short"
        alike = abs(np.log(gx / fx) - np.log(gy / fy)) < _NOTICEABLE
        parts.append(
            f"the focal length is {off}: {gx:.4g} pixels fit the images, not {fx:.4g}"
            if alike
            else f"the focal lengths are wrong: {gx:.4g} and {gy:.4g} pixels fit the images, not {fx:.4g} and {fy:.4g}"
        )
    if max(abs(dx - cx) / lens.width, abs(dy - cy) / lens.height) > _NOTICEABLE:
        parts.append(f"the principal point is wrong: ({dx:.4g}, {dy:.4g}) fits the images, not ({cx:.4g}, {cy:.4g})")
    return " and ".join(parts)
