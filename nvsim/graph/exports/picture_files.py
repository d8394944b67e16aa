"""Write the image of a graph to a file: SVG for papers, PNG for everything else."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from nvsim.files import atomic
from nvsim.graph.exports.graphml import legal
from nvsim.graph.exports.picture import INK, PAPER, Colour, Dot, Key, Line, Picture
from nvsim.graph.marks import CORNERS, DASHES


def write_svg(picture: Picture, path: Path) -> Path:
    """Write an SVG file and return `path`. Raises InputError if writing fails."""
    atomic.write_text(path, svg(picture))
    return path


def svg(picture: Picture) -> str:
    """Return the text of the SVG file. Lines and dots are vectors with the ids as titles; the map is an embedded
    image."""
    p = picture
    rows = [
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="{p.width}" '
        f'height="{p.whole_height}" viewBox="0 0 {p.width} {p.whole_height}">',
        f"<title>{escape(legal(p.scan))}</title>",
        f'<rect width="100%" height="100%" fill="{_hex(PAPER)}"/>',
    ]
    if p.ground is not None:
        data = base64.b64encode(_png(p.ground)).decode()
        rows.append(f'<image width="{p.width}" height="{p.height}" xlink:href="data:image/png;base64,{data}"/>')
    rows.append('<g stroke-linecap="round">')
    for line in p.lines:
        rows.append(_svg_line(line))
    rows.append("</g>")
    rows += [_svg_dot(dot) for dot in p.dots]
    rows += _svg_legend(p)
    x, y, length, size = _bar(p)
    rows.append(f'<path d="M{x:.1f} {y:.1f}h{length:.1f}" stroke="{_hex(INK)}" stroke-width="{size / 5:.1f}"/>')
    rows.append(f'<text x="{x:.1f}" y="{y - size / 2:.1f}" font-family="sans-serif" font-size="{size:.1f}" fill="{_hex(INK)}">{p.bar[1]}</text>')  # fmt: skip # noqa: E501
    rows.append("</svg>\n")
    return "\n".join(rows)


def _svg_line(line: Line) -> str:
    (x0, y0), (x1, y1) = line.a, line.b
    dashes = " ".join(f"{part * line.width:.2f}" for part in DASHES[line.dash % len(DASHES)])
    return (
        f'<line x1="{x0:.2f}" y1="{y0:.2f}" x2="{x1:.2f}" y2="{y1:.2f}" stroke="{_hex(line.colour)}" '
        f'stroke-width="{line.width:.2f}"'
        + (f' stroke-linecap="butt" stroke-dasharray="{dashes}"/>' if dashes else "/>")
    )


def _svg_dot(dot: Dot) -> str:
    paint = f'fill="{_hex(dot.colour)}"' if dot.filled else f'fill="none" stroke="{_hex(dot.colour)}"'
    title = f"<title>{escape(legal(dot.name))}</title>" if dot.name else ""
    if dot.shape in CORNERS:
        corners = " ".join(f"{x:.2f},{y:.2f}" for x, y in _corners(dot))
        return f'<polygon points="{corners}" {paint}>{title}</polygon>'
    x, y = dot.at
    return f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{dot.radius:.2f}" {paint}>{title}</circle>'


def _svg_legend(p: Picture) -> list[str]:
    ink = f'font-family="sans-serif" font-size="{p.size:.1f}" fill="{_hex(INK)}"'
    rows = (
        [f'<text x="{p.size:.1f}" y="{p.row(0) + 0.35 * p.size:.1f}" {ink}>{escape(p.title)}</text>'] if p.title else []
    )
    for number, key in enumerate(p.legend, 1):
        line, dot = _sample(p, number, key)
        rows += [_svg_line(line)] if line else []
        rows += [_svg_dot(dot)] if dot else []
        x, y = 4.5 * p.size, p.row(number) + 0.35 * p.size
        rows.append(f'<text x="{x:.1f}" y="{y:.1f}" {ink}>{escape(legal(key.words))}</text>')
    return rows


def _sample(p: Picture, number: int, key: Key) -> tuple[Line | None, Dot | None]:
    """The symbols before the text of a row of the legend."""
    y, size = p.row(number), p.size
    line = Line((size, y), (4 * size, y), key.colour, 0.2 * size, key.dash) if key.dash >= 0 else None
    dot = Dot((2.5 * size, y), 0.42 * size, key.colour, key.filled, "", key.shape) if key.shape else None
    return line, dot


def _corners(dot: Dot) -> list[tuple[float, float]]:
    (x, y), r = dot.at, dot.radius
    return [(x + (2 * u - 1) * r, y + (2 * v - 1) * r) for u, v in CORNERS[dot.shape]]


def _strokes(line: Line) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Yield the parts of a line that are drawn."""
    dashes = [part * line.width for part in DASHES[line.dash % len(DASHES)]]
    length = math.dist(line.a, line.b)
    if not dashes or length == 0:
        yield line.a, line.b
        return
    at, number = 0.0, 0
    while at < length:
        end = min(at + dashes[number % len(dashes)], length)
        if number % 2 == 0:
            yield _along(line, at / length), _along(line, end / length)
        at, number = end, number + 1


def _along(line: Line, share: float) -> tuple[float, float]:
    return tuple(p + share * (q - p) for p, q in zip(line.a, line.b, strict=True))  # type: ignore[return-value]


def write_png(picture: Picture, path: Path) -> Path:
    """Write a PNG file and return `path`. Raises InputError if writing fails."""
    import cv2

    p = picture
    pixels = np.full((p.whole_height, p.width, 3), PAPER, np.uint8)
    if p.ground is not None:
        pixels[: p.height] = p.ground

    def fixed(at: tuple[float, float]) -> tuple[int, int]:
        return round(at[0] * 16), round(at[1] * 16)  # sixteenths of a pixel: cv2's `shift` of 4

    def draw_line(line: Line) -> None:
        for a, b in _strokes(line):
            cv2.line(pixels, fixed(a), fixed(b), line.colour, max(1, round(line.width)), cv2.LINE_AA, 4)

    def draw_dot(dot: Dot) -> None:
        if dot.shape in CORNERS:
            corners = np.array([fixed(corner) for corner in _corners(dot)], np.int32)
            if dot.filled:
                cv2.fillPoly(pixels, [corners], dot.colour, cv2.LINE_AA, 4)
            else:
                cv2.polylines(pixels, [corners], True, dot.colour, 1, cv2.LINE_AA, 4)
        else:
            filled = -1 if dot.filled else 1
            cv2.circle(pixels, fixed(dot.at), round(dot.radius * 16), dot.colour, filled, cv2.LINE_AA, 4)

    def write(words: str, x: float, y: float) -> None:
        at, thick = (round(x), round(y)), max(1, round(size / 14))
        cv2.putText(pixels, words, at, cv2.FONT_HERSHEY_SIMPLEX, size / 24, INK, thick, cv2.LINE_AA)

    x, y, length, size = _bar(p)
    for line in p.lines:
        draw_line(line)
    for dot in p.dots:
        draw_dot(dot)
    if p.title:
        write(p.title, size, p.row(0) + 0.35 * size)
    for number, key in enumerate(p.legend, 1):
        sample = _sample(p, number, key)
        if sample[0] is not None:
            draw_line(sample[0])
        if sample[1] is not None:
            draw_dot(sample[1])
        write(key.words, 4.5 * size, p.row(number) + 0.35 * size)
    cv2.line(pixels, fixed((x, y)), fixed((x + length, y)), INK, max(1, round(size / 5)), cv2.LINE_AA, 4)
    write(p.bar[1], x, y - size / 2)
    atomic.write_bytes(path, _png(pixels))
    return path


def _bar(picture: Picture) -> tuple[float, float, float, float]:
    """Left end, y, length and letter height of the scale bar, pixels."""
    return picture.size, picture.height - picture.size, picture.bar[0], picture.size


def _png(pixels: NDArray[np.uint8]) -> bytes:
    import cv2

    return bytes(cv2.imencode(".png", pixels[..., ::-1])[1].tobytes())


def _hex(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
