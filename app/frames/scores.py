"""The scores of renders of held-out frames, measured by `nvsim evaluate views`. Does not use Qt."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from app.state.results import Result, Table

_COLUMNS = ("frame", "psnr", "ssim")


@dataclass(frozen=True)
class Score:
    """PSNR in decibels and SSIM of one frame, over all usable pixels."""

    psnr: float
    ssim: float

    @property
    def words(self) -> str:
        """The scores as text, for example "PSNR 24.1 dB, SSIM 0.83"."""
        return f"PSNR {self.psnr:.1f} dB, SSIM {self.ssim:.2f}"


@dataclass(frozen=True)
class Scores:
    """The scores of all measured frames, by frame index, and the time of measurement in seconds since the epoch."""

    of: dict[int, Score] = field(default_factory=dict)
    at: float = 0.0


def newest_scores(results: Iterable[Result]) -> Scores:
    """The scores of the last evaluation of held-out frames; empty if there was none."""
    for result in sorted(results, key=lambda r: -r.at):
        for table in result.tables:
            found = _scores_in(table)
            if found:
                return Scores(found, result.at)
    return Scores()


def _scores_in(table: Table) -> dict[int, Score]:
    """The scores in a table that has a row for each frame; empty for other tables."""
    if not set(_COLUMNS) <= set(table.columns):
        return {}
    frame, psnr, ssim = (table.columns.index(name) for name in _COLUMNS)
    found = {}
    for row in table.rows:
        values = row[psnr], row[ssim]
        if type(row[frame]) is int and all(type(v) in (int, float) for v in values):
            found[row[frame]] = Score(float(values[0]), float(values[1]))
    return found
