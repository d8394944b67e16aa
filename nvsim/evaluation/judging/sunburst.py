"""Draw reasons as a sunburst chart: models in the center, then good and bad, then the categories in the outer ring."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.chart_canvas import FAINT, INK, ChartCanvas, Colour, blended

_SIZE = (900, 620)  # pixels
_MIDDLE = (450.0, 320.0)
_RINGS = (48.0, 118.0, 158.0, 218.0)  # radii in pixels: the start of each ring, and the end of the last
_LABELS = 240.0  # radius in pixels of the category names
_COLOURS: tuple[Colour, ...] = ((58, 110, 165), (196, 120, 40), (130, 90, 160), (60, 140, 150), (120, 110, 90))
_GOOD, _BAD = (80, 150, 90), (190, 80, 70)
_NAMED = math.radians(4)  # narrower sectors have no name
_LINE = 15.0  # pixels between names
_ROUND = math.radians(2)  # angle between two corners of an arc


@dataclass(frozen=True)
class _Name:
    x: float
    y: float
    text: str
    at: tuple[float, float]


def draw_sunburst(path: Path, title: str, counts: Mapping[tuple[str, bool, str], int]) -> list[Path]:
    """Writes `path` with the suffixes .svg and .png; returns both. counts: (model, whether positive, category) ->
    number of reasons. Raises InputError if the disk refuses."""
    canvas = ChartCanvas(*_SIZE)
    canvas.words(title, 20, 26)
    total = sum(counts.values())
    if not total:
        canvas.words("No reasons were given.", _MIDDLE[0], _MIDDLE[1], 0.5)
        return canvas.write(path)
    names: list[_Name] = []
    begin = 0.0
    contestants = list(dict.fromkeys(who for who, _, _ in counts))
    for i, who in enumerate(contestants):
        colour = _COLOURS[i % len(_COLOURS)]
        mine = {key: n for key, n in counts.items() if key[0] == who}
        end = begin + 2 * math.pi * sum(mine.values()) / total
        _part(canvas, begin, end, _RINGS[0], _RINGS[1], colour)
        at = begin
        for good in (True, False):
            sided = {key: n for key, n in mine.items() if key[1] == good}
            stop = at + 2 * math.pi * sum(sided.values()) / total
            if sided:
                _part(canvas, at, stop, _RINGS[1], _RINGS[2], _GOOD if good else _BAD)
                if stop - at > _NAMED:
                    x, y = _on(0.5 * (at + stop), 0.5 * (_RINGS[1] + _RINGS[2]))
                    canvas.words("+" if good else "-", x, y + 4, 0.5, (255, 255, 255))
            for (_, _, category), n in sorted(sided.items(), key=lambda item: -item[1]):
                angle = 2 * math.pi * n / total
                _part(canvas, at, at + angle, _RINGS[2], _RINGS[3], blended(_GOOD if good else _BAD, 0.45))
                if angle > _NAMED:
                    x, y = _on(at + angle / 2, _LABELS)
                    names.append(_Name(x, y, f"{category} ({n})", _on(at + angle / 2, _RINGS[3])))
                at += angle
        begin = end
    _write_names(canvas, names)
    canvas.words(str(total), _MIDDLE[0], _MIDDLE[1], 0.5)
    canvas.words("reasons", _MIDDLE[0], _MIDDLE[1] + 14, 0.5)
    y = _SIZE[1] - 14.0
    x = 20.0
    for i, who in enumerate(contestants):
        share = 100 * sum(n for key, n in counts.items() if key[0] == who) / total
        text = f"{who} ({share:.0f} %)"
        canvas.area(np.array([[x, y - 10], [x + 12, y - 10], [x + 12, y + 2], [x, y + 2]]), _COLOURS[i % len(_COLOURS)])
        canvas.words(text, x + 18, y)
        x += 18 + 8.0 * len(text) + 20
    canvas.words("+ positive, - negative", _SIZE[0] - 20, y, 1.0)
    return canvas.write(path)


def _part(canvas: ChartCanvas, begin: float, end: float, inner: float, outer: float, colour: Colour) -> None:
    """A sector of a ring with a thin border. Angles are clockwise from the top."""
    steps = max(2, math.ceil((end - begin) / _ROUND) + 1)
    angles = np.linspace(begin, end, steps)
    ring = np.concatenate([_points(angles, outer), _points(angles[::-1], inner)])
    canvas.area(ring, colour)
    canvas.line(np.concatenate([ring, ring[:1]]), (255, 255, 255), 1.0)


def _points(angles: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    return np.stack([_MIDDLE[0] + radius * np.sin(angles), _MIDDLE[1] - radius * np.cos(angles)], axis=-1)


def _on(angle: float, radius: float) -> tuple[float, float]:
    x, y = _points(np.array([angle]), radius)[0]
    return float(x), float(y)


def _write_names(canvas: ChartCanvas, names: list[_Name]) -> None:
    """Writes names outside the outer ring. Names on one side are moved vertically so that they do not overlap."""
    for right in (True, False):
        mine = sorted((n for n in names if (n.x >= _MIDDLE[0]) == right), key=lambda n: n.y)
        places = _apart([n.y for n in mine], 46.0, _SIZE[1] - 44.0)
        for name, y in zip(mine, places, strict=True):
            out = 14 if right else -14
            # The distance of the circle of names at that height.
            reach = math.sqrt(max(_LABELS**2 - (y - _MIDDLE[1]) ** 2, 60.0**2))
            x = _MIDDLE[0] + (reach if right else -reach)
            canvas.line(np.array([name.at, (x, y - 4), (x + out, y - 4)]), FAINT)
            canvas.words(name.text, x + 1.3 * out, y, 0.0 if right else 1.0, INK)


def _apart(wanted: list[float], low: float, high: float) -> list[float]:
    """Ascending positions as close as possible to `wanted`, at least one line apart and between both limits."""
    found: list[float] = []
    for y in wanted:
        found.append(max(y, low, found[-1] + _LINE if found else low))
    over = found[-1] - high if found else 0.0
    for i in range(len(found) - 1, -1, -1):
        if over <= 0:
            break
        most = high if i == len(found) - 1 else found[i + 1] - _LINE
        found[i] = min(found[i], most)
    return found
