"""Draw reasons as a sunburst chart: models in the center, then good and bad, then the categories in the outer ring."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.figures import FAINT, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLORS = ("#3a6ea5", "#c47828", "#825aa0", "#3c8c96", "#786e5a")
_SIDES = {True: ("#50965a", "#9fc5a4"), False: ("#be5046", "#db9f99")}  # of positive reasons: their sum, categories
_NAMED = 4 / 360  # smaller shares have no name
_SIZE = 1.55  # height of the drawing in radii of the outer ring, from the center
_LINE = 0.085  # distance of names in radii


@style()
def draw_sunburst(title: str, counts: Mapping[tuple[str, bool, str], int]) -> Figure:
    """Draw (model, whether positive, category) -> number of reasons. Sectors are clockwise from the top."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    figure = Figure((6.0, 5.0))
    figure.suptitle(title, y=0.98)
    axes = figure.add_axes((0, 0.09, 1, 0.86))
    total = sum(counts.values())
    models = list(dict.fromkeys(who for who, _, _ in counts))
    sectors = sorted(counts.items(), key=lambda item: (models.index(item[0][0]), not item[0][1], -item[1]))
    sides: dict[tuple[str, bool], int] = {}
    shares = dict.fromkeys(models, 0)
    for (who, good, _), n in sectors:
        sides[who, good] = sides.get((who, good), 0) + n
        shares[who] += n
    colors = dict(zip(models, cycle(_COLORS)))
    edge = {"edgecolor": "white", "linewidth": 0.7}
    ring = partial(axes.pie, startangle=90, counterclock=False)
    if total:
        ring(list(shares.values()), colors=list(colors.values()), radius=0.54, wedgeprops={"width": 0.32, **edge})
        ring(
            list(sides.values()),
            colors=[_SIDES[good][0] for _, good in sides],
            labels=["" if n < _NAMED * total else "+" if good else "\N{MINUS SIGN}" for (_, good), n in sides.items()],
            labeldistance=0.63 / 0.72,
            textprops={"ha": "center", "color": "white", "weight": "bold"},
            radius=0.72,
            wedgeprops={"width": 0.18, **edge},
        )
        outer = [_SIDES[good][1] for (_, good, _), _ in sectors]
        ring([n for _, n in sectors], colors=outer, wedgeprops={"width": 0.28, **edge})
        _name_sectors(axes, [f"{key[2]} ({n})" for key, n in sectors], np.array([n for _, n in sectors]) / total)
    axes.text(0, 0, f"{total}\nreasons" if total else "No reasons were given.", ha="center", va="center")
    axes.set(ylim=(-_SIZE, _SIZE), xlim=(-2.2, 2.2), aspect="equal")
    axes.set_axis_off()
    handles = [Patch(color=colors[who], label=f"{who} ({100 * n / max(total, 1):.0f} %)") for who, n in shares.items()]
    handles += [
        Patch(color=_SIDES[True][0], label="+ positive"),
        Patch(color=_SIDES[False][0], label="\N{MINUS SIGN} negative"),
    ]
    figure.legend(handles=handles, loc="lower center", ncols=3)
    return figure


def _name_sectors(axes: Axes, names: list[str], shares: NDArray[np.float64]) -> None:
    """Write the names of sectors on both sides of the outer ring, at different heights."""
    angles = 2 * np.pi * (np.cumsum(shares) - shares / 2)
    ends = np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    for side, on_side in ((1, ends[:, 0] >= 0), (-1, ends[:, 0] < 0)):
        rows = np.flatnonzero(on_side & (shares > _NAMED))
        rows = rows[np.argsort(ends[rows, 1])]
        steps = _LINE * np.arange(len(rows))
        # From the lowest name up, each is one line above the one below, and none is above the edge.
        heights = (
            steps + np.maximum.accumulate(np.maximum(1.12 * ends[rows, 1], -_SIZE) - steps) if len(rows) else steps
        )
        heights = np.minimum(heights, _SIZE - _LINE + steps - steps[-1:])
        for row, height in zip(rows, heights, strict=True):
            axes.annotate(
                names[row],
                ends[row],
                (side * 1.22, height),
                ha="left" if side > 0 else "right",
                va="center",
                arrowprops={
                    "arrowstyle": "-",
                    "color": FAINT,
                    "linewidth": 0.6,
                    "relpos": (side < 0, 0.5),
                    "shrinkB": 0,
                },
            )
