"""How well the models show the frames that they were not trained on, as `nvsim evaluate views` measured it. Knows no
Qt."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from app.state.results import Result, Table

_COLUMNS = ("frame", "psnr", "ssim")


@dataclass(frozen=True)
class Score:
    """PSNR in decibels and SSIM of one frame, over all pixels that count."""

    psnr: float
    ssim: float

    @property
    def words(self) -> str:
        """ "PSNR 24.1 dB, SSIM 0.83"."""
        return f"PSNR {self.psnr:.1f} dB, SSIM {self.ssim:.2f}"


@dataclass(frozen=True)
class Scores:
    """Of every frame that was measured, and when: seconds since the epoch."""

    of: dict[int, Score] = field(default_factory=dict)
    at: float = 0.0


def newest_scores(results: Iterable[Result]) -> Scores:
    """Those of the last evaluation of held-out frames; none where there was none."""
    for result in sorted(results, key=lambda r: -r.at):
        for table in result.tables:
            found = _scores_in(table)
            if found:
                return Scores(found, result.at)
    return Scores()


def _scores_in(table: Table) -> dict[int, Score]:
    """What a table with a row for each frame says; nothing of any other table."""
    if not set(_COLUMNS) <= set(table.columns):
        return {}
    frame, psnr, ssim = (table.columns.index(name) for name in _COLUMNS)
    found = {}
    for row in table.rows:
        values = row[psnr], row[ssim]
        if type(row[frame]) is int and all(type(v) in (int, float) for v in values):
            found[row[frame]] = Score(float(values[0]), float(values[1]))
    return found
