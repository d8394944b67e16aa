"""Static figures: their style in matplotlib, marks without color, the scale bar of maps, and PNG, SVG and PDF files."""

from __future__ import annotations

import io
import logging
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.plain_text import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 180 / 25.4
"""Width of a page in inches."""
LETTERS = 7.0
"""Height of letters in points."""
INK, PAPER, FAINT = "#282828", "#ffffff", "#cdcdcd"
_STYLE: dict[Any, Any] = {
    "font.size": LETTERS,
    "font.sans-serif": ["DejaVu Sans", "Arial", "Helvetica"],
    "axes.titlesize": LETTERS,
    "figure.titlesize": LETTERS + 1,
    "axes.edgecolor": INK,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "text.color": INK,
    "text.parse_math": False,  # names may contain dollar signs
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "savefig.dpi": "figure",
    "figure.dpi": 300,
    "svg.fonttype": "none",  # texts stay texts
    "svg.hashsalt": "nvsim",  # equal figures are equal files
    "pdf.fonttype": 42,
}
_BARS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)  # lengths of the scale bar, in its unit
_LINK = re.compile(rb'<a [^>]*?xlink:href="([^"]*)"[^>]*>(.*?)</a>', re.DOTALL)


@contextmanager
def style() -> Iterator[None]:
    """Apply the common style, in place of the settings of the user, to what the block or the decorated function
    draws."""
    # Without a writable home, matplotlib would report that it lists the fonts again.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    import matplotlib

    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # a letter that the font lacks becomes a box
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        yield


@style()
def save_figure(figure: Figure, path: Path, kind: str = "") -> Path:
    """Write "png", "svg" or "pdf", by default the suffix of `path`, without the date. Return `path`.

    The label of the figure is the title of the document. In SVG, the URLs of artists become their titles. Raises
    InputError if writing fails or for other suffixes."""
    title = figure.get_label()
    kind = kind or path.suffix[1:].lower()
    metadata: dict[str, dict[str, object]] = {
        "png": {"Software": None},
        "svg": {"Title": title, "Creator": "NVSim", "Date": None},
        "pdf": {"Title": title, "Creator": "NVSim", "CreationDate": None},
    }
    if kind not in metadata:
        raise InputError(f"{path} does not have the suffix of an image; name a .png file.")
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_text(printable(text.get_text(), "\n"))
    data = io.BytesIO()
    figure.savefig(data, format=kind, metadata=metadata[kind])
    written = data.getvalue()
    if kind == "svg":
        written = _LINK.sub(rb"<g><title>\1</title>\2</g>", written)
    atomic.write_bytes(path, written)
    return path


def add_scale_bar(axes: Axes, unit: tuple[str, float] = ("m", 1.0)) -> None:
    """Add a scale bar to axes in meters. `unit` is its unit: symbol and length in meters."""
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    symbol, meters = unit
    left, right = axes.get_xlim()
    length = max((b for b in _BARS if b * meters <= 0.25 * (right - left)), default=_BARS[0])
    bar = AnchoredSizeBar(
        axes.transData, length * meters, f"{length:g} {symbol}", "lower left", pad=0.4, borderpad=0.8, sep=3,
        size_vertical=0.02 * length * meters, color=INK, label_top=True,
    )  # fmt: skip
    bar.patch.set(edgecolor="none", alpha=0.8)
    axes.add_artist(bar)


SHAPES = ("disc", "square", "diamond", "triangle", "point", "cross")
CORNERS = {
    "square": ((0.06, 0.06), (0.94, 0.06), (0.94, 0.94), (0.06, 0.94)),
    "diamond": ((0.5, -0.04), (1.04, 0.5), (0.5, 1.04), (-0.04, 0.5)),
    "triangle": ((0.5, -0.02), (1.04, 0.96), (-0.04, 0.96)),
    "point": ((0.5, 1.02), (1.04, 0.04), (-0.04, 0.04)),
    "cross": ((0.3, 0.0), (0.7, 0.0), (0.7, 0.3), (1.0, 0.3), (1.0, 0.7), (0.7, 0.7),
              (0.7, 1.0), (0.3, 1.0), (0.3, 0.7), (0.0, 0.7), (0.0, 0.3), (0.3, 0.3)),
}  # fmt: skip
"""Corners of the shapes other than the disc: x, y as shares of the disc's diameter, from the upper left."""
DASHES: tuple[tuple[float, ...], ...] = ((), (4, 2), (1, 2), (4, 2, 1, 2), (4, 2, 1, 2, 1, 2))
"""Dash patterns of lines: lengths of strokes and gaps in turn, in line widths. The first pattern is a solid line."""
