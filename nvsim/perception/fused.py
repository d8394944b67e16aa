"""The geometric provider combined with networks where geometry is undecided. The cloud is best at objects on the floor.
A network is best at floor in holes of the LiDAR scan, and at vertical surfaces for which the images give no depth.

In rooms unlike those of its training, a network is more certain than it should be. Its floor probability is therefore
calibrated on the capture itself: where geometry is certain, it shows how often the network is right. Temperature
scaling (Guo et al. 2017) divides the log odds of the network by one number, here per floor surface. If the network is
often wrong, the colors of certain floor count, too."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.optimize import minimize, minimize_scalar

from nvsim.geometry.camera import Camera
from nvsim.geometry.sampling import evenly_spaced
from nvsim.perception.geometric import GeometricFloor
from nvsim.perception.roles import Float32, FloorMask, Image, Mask, SemanticFloor, SurfaceNormals

_GLIMPSES = 24  # views from which a network is measured
_FEWEST = 500  # pixels of floor, and of other surfaces, needed
_LEAST = 1e-7  # probability that counts as 0, and its distance from 1
_RANGE = (0.25, 10.0)  # temperatures
_OFTEN_WRONG = 2.0  # temperature from which on colors count
_SMOOTH = 80  # the color of a pixel is the mean over a square of this share of the image's width
_BINS = (8, 32, 32)  # of luminance, and of red and blue against green
_SPREAD = (0.7, 1.2, 1.2)  # bins, standard deviation of the smoothing
_DARK = 10.0  # added before the logarithm, so that noise in dark pixels does not count as color
_REACH = 1.6  # largest log ratio of red or blue to green
_RARE = 3e-5  # share of the pixels below which a color is as good as unseen


class View(NamedTuple):
    """A frame: its camera, and functions that read its image (H, W, 3) uint8 RGB of the camera's size, its valid pixels
    (H, W) bool (None for all) and, if it has one, its own depth (h, w) in meters."""

    camera: Camera
    image: Callable[[], Image]
    usable: Callable[[], Mask | None]
    depth: Callable[[], Float32] | None


@dataclass(frozen=True, eq=False)
class FloorColors:
    """The colors of the floor in a capture: how much more frequent each color is on floor than on other surfaces.

    odds  (8, 32, 32) float32, natural logarithm of the ratio of both shares, by luminance and two chromaticities
    """

    odds: Float32

    @staticmethod
    def learn(colors: NDArray[np.number], is_floor: NDArray[np.bool_]) -> FloorColors:
        """The colors of pixels (N, 3) RGB, 0 to 255, that are floor or not (N,). Both kinds must occur."""
        shares = []
        for chosen in (is_floor, ~is_floor):
            counts = np.zeros(_BINS)
            np.add.at(counts, _bins_of(colors[chosen]), 1.0)
            shares.append(gaussian_filter(counts / chosen.sum(), _SPREAD) + _RARE)
        return FloorColors(np.log(shares[0] / shares[1]).astype(np.float32))

    def log_odds(self, colors: NDArray[np.number]) -> Float32:
        """(...) float32 evidence of pixels (..., 3) RGB, 0 to 255: above 0 for the colors of floor."""
        return np.asarray(self.odds[_bins_of(colors)], np.float32)


def _bins_of(colors: NDArray[np.number]) -> tuple[NDArray[np.int64], ...]:
    logs = np.log(np.asarray(colors, np.float32) + np.float32(_DARK))
    brightest = np.log((255 + _DARK) / _DARK)
    shares = (
        (logs.mean(axis=-1) - np.log(_DARK)) / brightest,
        (logs[..., 0] - logs[..., 1]) / (2 * _REACH) + 0.5,
        (logs[..., 2] - logs[..., 1]) / (2 * _REACH) + 0.5,
    )
    return tuple(np.clip(share * bins, 0, bins - 1).astype(np.int64) for share, bins in zip(shares, _BINS, strict=True))


@dataclass(frozen=True, eq=False)
class CalibratedFloor:
    """A SemanticFloor whose log odds are divided by a temperature: above 1, it is less certain than the network. With
    `colors`, `weight` times their log odds are added."""

    network: SemanticFloor
    temperature: float
    colors: FloorColors | None = None
    weight: float = 0.0

    def floor_probability(self, image: Image, camera: Camera) -> Float32:
        """(H, W) float32, 0 to 1, see SemanticFloor."""
        said = log_odds(self.network.floor_probability(image, camera)) / np.float32(self.temperature)
        if self.colors is not None:
            said += np.float32(self.weight) * self.colors.log_odds(_smooth(image))
        return np.asarray(1 / (1 + np.exp(-said)), np.float32)


def _smooth(image: Image) -> Image:
    import cv2

    side = 2 * (image.shape[1] // (2 * _SMOOTH)) + 1
    return np.asarray(cv2.blur(image, (side, side)), np.uint8)


class _Certain(NamedTuple):
    """Pixels of which geometry is certain: the log odds (N,) of the network, whether they are floor (N,), and their
    colors (N, 3)."""

    odds: Float32
    is_floor: Mask
    colors: Image

    def is_enough(self) -> bool:
        return min(int(self.is_floor.sum()), int((~self.is_floor).sum())) >= _FEWEST

    @staticmethod
    def joined(parts: Sequence[_Certain]) -> _Certain:
        return _Certain(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def calibrate(
    network: SemanticFloor, floor: GeometricFloor, views: Sequence[View], threads: int = 1
) -> CalibratedFloor:
    """The network with the temperature that fits the pixels of which `floor` is certain, in views evenly selected from
    `views`. The temperature is 1 if there are too few such pixels. Colors count if depth comes from the images and the
    temperature is 2 or more."""

    def measured(index: int) -> _Certain:
        import cv2

        camera, read, usable_of, depth = views[index]
        level, high = floor.certain(camera, None if depth is None else depth())
        if not (level.any() or high.any()):
            return _Certain(np.zeros(0, np.float32), np.zeros(0, bool), np.zeros((0, 3), np.uint8))
        image, size = read(), (level.shape[1], level.shape[0])
        small = cv2.resize(network.floor_probability(image, camera), size, interpolation=cv2.INTER_AREA)
        shown = cv2.resize(_smooth(image), size, interpolation=cv2.INTER_AREA)
        known, usable = level | high, usable_of()
        if usable is not None:
            known &= cv2.resize(usable.astype(np.uint8), known.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        odds = log_odds(np.asarray(small[known], np.float32))
        return _Certain(odds, level[known], np.asarray(shown[known], np.uint8))

    chosen = evenly_spaced(len(views), _GLIMPSES)
    with ThreadPoolExecutor(threads) as pool:
        parts = list(pool.map(measured, chosen))
    found = _Certain.joined(parts)
    if not found.is_enough():
        return CalibratedFloor(network, 1.0)
    temperature = fitting_temperature(found.odds, found.is_floor)
    if temperature < _OFTEN_WRONG or any(views[index].depth is None for index in chosen):
        return CalibratedFloor(network, temperature)
    return _with_colors(network, temperature, parts)


def _with_colors(network: SemanticFloor, temperature: float, parts: Sequence[_Certain]) -> CalibratedFloor:
    """The network with the temperature and the weight of colors that fit together. The weight is measured with colors
    of other views: those of every second view are learned from the rest."""
    halves = [_Certain.joined(parts[k::2]) for k in (0, 1)]
    if not all(half.is_enough() for half in halves):
        return CalibratedFloor(network, temperature)
    learned = [FloorColors.learn(half.colors, half.is_floor) for half in halves]
    sign = np.concatenate([np.where(half.is_floor, 1.0, -1.0) for half in halves])
    odds = np.concatenate([half.odds for half in halves])
    color = np.concatenate([learned[1 - k].log_odds(half.colors) for k, half in enumerate(halves)])

    def entropy(weights: NDArray[np.float64]) -> float:
        return float(np.logaddexp(0, -sign * (weights[0] * odds + weights[1] * color)).mean())

    bounds = ((1 / _RANGE[1], 1 / _RANGE[0]), (0.0, 1.5))
    sharpness, weight = minimize(entropy, (1 / temperature, 0.3), bounds=bounds).x
    every = _Certain.joined(parts)
    return CalibratedFloor(
        network, float(1 / sharpness), FloorColors.learn(every.colors, every.is_floor), float(weight)
    )


def fitting_temperature(odds: Float32, is_floor: NDArray[np.bool_]) -> float:
    """The temperature with the least cross entropy for pixels with these log odds (N,) that are floor or not (N,)."""
    wrong = np.where(is_floor, -odds, odds).astype(np.float64)

    def entropy(sharpness: float) -> float:
        return float(np.logaddexp(0, sharpness * wrong).mean())

    found = minimize_scalar(entropy, bounds=(1 / _RANGE[1], 1 / _RANGE[0]), method="bounded")
    return float(1 / found.x)


def log_odds(probability: Float32) -> Float32:
    """Natural logarithm of p / (1 - p), for probabilities of any shape."""
    kept = np.clip(probability, _LEAST, 1 - _LEAST)
    return np.asarray(np.log(kept / (1 - kept)), np.float32)


@dataclass(frozen=True)
class FusedFloor:
    """A FloorSegmenter that combines the geometric provider with networks.

    With a LiDAR scan, the semantic network adds unoccluded floor and the pixel by which the points of objects overhang.
    It removes floor only if it is almost certain, because it misses floor more often than a LiDAR scan misses
    obstacles. Depth from images misses more obstacles and makes thin objects too thick. There a confident network
    decides, unless the image's own depth contradicts it. Normals then tell which near surfaces without depth are
    vertical."""

    floor: GeometricFloor
    semantic: SemanticFloor
    surface_normals: SurfaceNormals | None = None

    def segment(self, camera: Camera, image: Image, depth: Float32 | None = None) -> FloorMask:
        """The mask of an image (H, W, 3). `depth` (H, W) is the image's own, meters, 0 if unknown."""
        upward = None
        if depth is not None and self.surface_normals is not None:
            upward = np.ascontiguousarray(self.surface_normals.normals(image, camera)[..., 2])
        return self.floor.segment(camera, image, depth, self.semantic.floor_probability(image, camera), upward)
