"""The metric scale of camera poses from positions that a phone or a drone recorded.

A similarity moves the cameras to the recorded positions. Its scale is used only if its standard deviation is below 5 %.
GPS errors change slowly, so averaging neighboring positions does not reduce them. NVSim therefore assumes at most 8
independent positions, however many there are.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture import colmap
from nvsim.capture.alignment import find_up
from nvsim.capture.findings import Findings
from nvsim.errors import InputError
from nvsim.files.opening import is_regular
from nvsim.footage.extraction import read_moments
from nvsim.footage.position_logs import CameraPositions, ar_positions, gps_positions, log_files
from nvsim.footage.sources import Footage
from nvsim.geometry.rotation import fitted_similarity, smallest_rotation
from nvsim.reconstruction.report import MeasuredScale, PosesReport, Stamp

_FEWEST = 8  # different positions, at least
_WIDE = 7.0  # spread of the cameras over the position error, at least: with 8 positions, the scale is exact to 5 %
_AGREEING = 0.7  # share of the positions that agree, at least
_SURE = 0.05  # largest standard deviation of the scale, relative
_AR_DRIFT = 0.02
"""Relative error of lengths from ARKit: 0.02 m per second at walking speed (Kim et al. 2022,
https://doi.org/10.3390/s22249873)."""
_BLOCKS = 8  # parts of the trajectory for the jackknife
_TRIES, _ROUNDS = 300, 20  # random triples of positions, and refinements
_LOOSE = 3.0  # median distances within which a position agrees
_UPRIGHT_DEGREES = 1.0  # largest standard deviation of a vertical that is used


@dataclass(frozen=True, eq=False)
class Similarity:
    """A similarity: target = scale * rotation @ source + a shift.

    rotation     (3, 3) float64
    agrees       (N,) bool, points from which it was computed
    residual     root mean square distance of these points, in the unit of the target
    uncertainty  relative standard deviation of the scale
    """

    scale: float
    rotation: NDArray[np.float64]
    agrees: NDArray[np.bool_]
    residual: float
    uncertainty: float


def fit_similarity(source: NDArray[np.float64], target: NDArray[np.float64], error: float) -> Similarity:
    """Fits the similarity from `source` (N, 3) to `target` (N, 3), N > 3, in the order of a trajectory.

    Up to half of the points may be wrong. Points within `error`, in the unit of the target, always agree. The fit
    starts from the triple of points with the least median distance (Rousseeuw 1984). The uncertainty is a jackknife
    over 8 parts of the trajectory, which accounts for slow errors. It is at least that of 8 independent positions.
    """
    dice = np.random.default_rng(0)
    triples = np.argsort(dice.random((_TRIES, len(source))), axis=1)[:, :3]
    starts = [np.arange(len(source)), *triples]
    off = min((_distances(source, target, start) for start in starts), key=lambda d: float(np.median(d)))
    agrees = np.zeros(len(source), bool)
    for _ in range(_ROUNDS):
        nearer = off <= max(_LOOSE * float(np.median(off)), error)
        if np.array_equal(nearer, agrees):
            break
        agrees, off = nearer, _distances(source, target, nearer)
    scale, rotation, _ = fitted_similarity(source[agrees], target[agrees])
    residual = float(np.sqrt(np.mean(off[agrees] ** 2)))
    spread = max(scale * spread_of(source[agrees]), 1e-12)
    without = []
    for part in np.array_split(np.flatnonzero(agrees), _BLOCKS):
        kept = agrees.copy()
        kept[part] = False
        without.append(fitted_similarity(source[kept], target[kept])[0])
    jackknife = math.sqrt((_BLOCKS - 1) * float(np.var(without))) / max(scale, 1e-12)
    uncertainty = max(jackknife, max(residual, error) / (spread * math.sqrt(_BLOCKS)))
    return Similarity(scale, rotation, agrees, residual, uncertainty)


def spread_of(points: NDArray[np.float64]) -> float:
    """Root mean square distance of points (N, 3) from their mean."""
    return float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))


def _distances(
    source: NDArray[np.float64], target: NDArray[np.float64], used: NDArray[np.bool_] | NDArray[np.int64]
) -> NDArray[np.float64]:
    """(N,) distances of all points after the similarity of the `used` points, given as a mask or as indices."""
    scale, rotation, shift = fitted_similarity(source[used], target[used])
    return np.asarray(np.linalg.norm(scale * source @ rotation.T + shift - target, axis=1))


def judge(poses: NDArray[np.float64], known: CameraPositions, upright: bool) -> MeasuredScale:
    """The scale of `poses` (N, 4, 4), camera to world, from the N positions in `known`, or the reason why there is
    none. `upright`: whether z of the poses is up."""
    source, target = poses[:, :3, 3], known.places
    count = len(np.unique(np.round(target, 3), axis=0)) if len(target) else 0
    if count < _FEWEST:
        return _refused_scale(
            known, f"only {count} different positions belong to frames with a pose, at least {_FEWEST} are needed"
        )
    if known.is_gps:  # use horizontal positions only
        level = np.eye(3) if upright else smallest_rotation(find_up(poses)[0], [0.0, 0.0, 1.0])
        source = source @ level.T * [1.0, 1.0, 0.0]
    fit = fit_similarity(source, target, known.error)
    spread, error = fit.scale * spread_of(source[fit.agrees]), max(known.error, fit.residual)
    share = float(fit.agrees.mean())
    uncertainty = max(fit.uncertainty, 0.0 if known.is_gps else _AR_DRIFT)
    if spread < _WIDE * error:
        return _refused_scale(
            known,
            f"the cameras spread by {spread:.2g} m around their middle, less than {_WIDE:g} times the error of a "
            f"position ({error:.2g} m)",
        )
    if share < _AGREEING:
        return _refused_scale(known, f"only {100 * share:.0f} % of the positions fit the poses, at least 70 % must")
    if uncertainty > _SURE:
        return _refused_scale(known, f"the scale would be uncertain by {100 * uncertainty:.0f} %, more than 5 %")
    return MeasuredScale(
        source=known.source,
        refused="",
        scale=float(f"{fit.scale:.6g}"),
        uncertainty=round(100 * uncertainty, 1),
        positions=len(target),
        agreeing=int(fit.agrees.sum()),
        residual_m=round(fit.residual, 3),
        up=() if upright or known.is_gps else _vertical(fit, source),
    )


def _refused_scale(known: CameraPositions, why: str) -> MeasuredScale:
    return MeasuredScale(known.source, why, positions=len(known.names))


def _vertical(fit: Similarity, source: NDArray[np.float64]) -> tuple[float, ...]:
    """The vertical in the frame of the poses. Empty if the trajectory is too straight to determine it."""
    centered = source[fit.agrees] - source[fit.agrees].mean(axis=0)
    aside = fit.scale * float(np.linalg.svd(centered, compute_uv=False)[1]) / np.sqrt(len(centered))
    if fit.residual > aside * np.sqrt(_BLOCKS) * np.radians(_UPRIGHT_DEGREES):
        return ()
    return tuple(float(value) for value in np.round(fit.rotation[2], 6))


# Of a report ----------------------------------------------------------------------------------------------------------


def with_measured_scales(report: PosesReport, footage: Footage, folder: Path) -> PosesReport:
    """Adds the scale of each piece in `folder` to `report`, from the positions that were recorded with `footage`.

    Returns `report` unchanged if these files were already used. If a file is damaged, the report states this as the
    reason for a missing scale. Raises InputError if the poses cannot be read."""
    stamp = _stamp(footage)
    if report.position_logs == stamp:
        return report
    sources, faults = list[CameraPositions](), list[MeasuredScale]()
    for positions_of in (ar_positions, gps_positions):
        try:
            moments = read_moments(folder / "images") if footage.kind == "video" else {}
            known = positions_of(footage, moments)
        except InputError as error:
            faults.append(MeasuredScale("a position log", str(error).rstrip(".")))
        else:
            sources += [] if known is None else [known]
    models = [folder / "sparse" / str(piece) for piece in range(report.models)]
    models = [model for model in models if any(is_regular(model / f"images.{end}") for end in ("bin", "txt"))]
    measured = [
        _measure_scale(model, sources, faults, piece < len(report.upright) and report.upright[piece])
        for piece, model in enumerate(models)
        if sources or faults
    ]
    return dataclasses.replace(report, measured=tuple(measured), position_logs=stamp)


def _stamp(footage: Footage) -> Stamp:
    found = [(path.absolute(), path.stat()) for path in log_files(footage)]
    return tuple((str(path), stat.st_size, stat.st_mtime_ns) for path, stat in found)


def _measure_scale(
    model: Path, sources: list[CameraPositions], faults: list[MeasuredScale], upright: bool
) -> MeasuredScale:
    """The scale from the first source that gives one, or else the reason why the first source gives none."""
    frames = [frame for frame in colmap.read(model, Findings()).frames if frame.camera_to_world is not None]
    poses = {frame.name.removeprefix("side0/"): frame.camera_to_world for frame in frames}
    judged = list[MeasuredScale]()
    for known in sources:
        used = [k for k, name in enumerate(known.names) if name in poses]
        names = tuple(known.names[k] for k in used)
        at = np.array([poses[name] for name in names], np.float64).reshape(-1, 4, 4)
        judged.append(judge(at, dataclasses.replace(known, names=names, places=known.places[used]), upright))
    return next((each for each in judged if not each.refused), (*faults, *judged)[0])
