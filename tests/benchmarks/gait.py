"""Simulate how a person carries a camera along a route: speed, gait, sideways glances, and hand tremor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

RATE = 200.0  # samples per second
_PACE, _TURN = 0.9, 40.0  # meters and degrees per second
_FASTEST_TURN = 43.0  # degrees per second, glances included
_GLANCE = 24.0  # degrees to either side
_DOWN = 7.5  # degrees below the horizon
_HEIGHT = 1.45  # meters above the floor
_BOB, _SWAY = 0.018, 0.02  # meters
_STEPS = 1.9  # per second


@dataclass(frozen=True, eq=False)
class Motion:
    """Camera positions (N, 3) in meters, and yaw, pitch, and roll (N,) in radians, at `RATE` samples per second."""

    positions: NDArray[np.float64]
    yaw: NDArray[np.float64]
    pitch: NDArray[np.float64]
    roll: NDArray[np.float64]

    @property
    def seconds(self) -> float:
        return (len(self.yaw) - 1) / RATE

    def poses(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 4, 4) camera-to-world matrices with OpenCV axes at times (...) in seconds."""
        flat = np.clip(np.ravel(times), 0, self.seconds)
        grid = np.arange(len(self.yaw)) / RATE
        yaw, pitch, roll = (np.interp(flat, grid, v) for v in (self.yaw, self.pitch, self.roll))
        out = np.zeros((len(flat), 4, 4))
        sh, ch, se, ce = np.sin(yaw), np.cos(yaw), np.sin(pitch), np.cos(pitch)
        right = np.stack([ch, -sh, np.zeros_like(ch)], axis=1)
        forward = np.stack([sh * ce, ch * ce, se], axis=1)
        down = np.cross(forward, right)
        c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
        out[:, :3, 0], out[:, :3, 1], out[:, :3, 2] = c * right + s * down, c * down - s * right, forward
        for axis in range(3):
            out[:, axis, 3] = np.interp(flat, grid, self.positions[:, axis])
        out[:, 3, 3] = 1
        return out.reshape(*np.shape(times), 4, 4)


def carry(route: NDArray[np.float64], rng: np.random.Generator) -> Motion:
    """The motion along a dense route (N, 5) from `walk.with_floor_heights`: x, y, heading, height of the floor, and
    elevation."""
    moved = np.linalg.norm(np.diff(route[:, [0, 1, 3]], axis=0), axis=1)
    turned = np.abs(np.diff(route[:, 2]))
    pace = _PACE * (1 + 0.08 * _wander(len(moved), 150.0, rng))
    spent = np.maximum(moved / pace, turned / np.radians(_TURN))
    clock = np.concatenate([[0.0], np.cumsum(np.maximum(spent, 1e-9))])
    times = np.arange(int(clock[-1] * RATE) + 1) / RATE
    x, y, heading, floor, elevation = (np.interp(times, clock, route[:, i]) for i in range(5))
    x, y, floor = (gaussian_filter1d(v, 0.15 * RATE, mode="nearest") for v in (x, y, floor))
    count = len(times)
    glance = np.radians(_GLANCE) * np.clip(_wander(count, 1.6 * RATE, rng), -1.5, 1.5)
    yaw = gaussian_filter1d(_limited(heading + glance, np.radians(_FASTEST_TURN) / RATE), 0.2 * RATE, mode="nearest")
    phase = 2 * np.pi * np.cumsum(_STEPS * (1 + 0.04 * _wander(count, 2 * RATE, rng))) / RATE
    speed = gaussian_filter1d(np.hypot(np.gradient(x), np.gradient(y)) * RATE, 0.2 * RATE, mode="nearest")
    gait = np.clip(speed / _PACE, 0.15, 1.0)
    sway = gait * _SWAY * np.sin(phase / 2) + 0.008 * _wander(count, 0.4 * RATE, rng)
    z = floor + _HEIGHT + gait * _BOB * np.sin(phase) + 0.015 * _wander(count, 3 * RATE, rng)
    positions = np.column_stack([x + sway * np.cos(heading), y - sway * np.sin(heading), z])
    pitch = 0.7 * gaussian_filter1d(elevation, 0.3 * RATE, mode="nearest") - np.radians(_DOWN)
    pitch += np.radians(1.6) * _wander(count, 1.5 * RATE, rng) + np.radians(0.6) * _wander(count, 0.12 * RATE, rng)
    pitch += gait * np.radians(0.4) * np.sin(phase + 1.0)
    roll = np.radians(0.8) * _wander(count, 0.5 * RATE, rng) + np.radians(0.4) * _wander(count, 0.1 * RATE, rng)
    yaw += np.radians(0.5) * _wander(count, 0.12 * RATE, rng) + gait * np.radians(0.6) * np.sin(phase / 2 + 0.5)
    return Motion(positions, yaw, pitch, roll + gait * np.radians(0.5) * np.sin(phase / 2))


def _wander(count: int, smooth: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """(count,) noise of mean 0 and deviation 1, filtered by a Gaussian of `smooth` samples."""
    margin = int(4 * smooth)
    noise = gaussian_filter1d(rng.standard_normal(count + 2 * margin), smooth)[margin : margin + count]
    return np.asarray(noise * np.sqrt(2 * np.sqrt(np.pi) * smooth))


def _limited(values: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Follows the values (N,) by at most `step` per sample."""
    out = values.copy()
    for i in range(1, len(out)):
        out[i] = out[i - 1] + np.clip(values[i] - out[i - 1], -step, step)
    return out
