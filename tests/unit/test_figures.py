"""The style and the files of static figures."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import pytest
from matplotlib.figure import Figure

from nvsim.errors import InputError
from nvsim.figures import add_scale_bar, save_figure, style


@style()
def drawn() -> Figure:
    figure = Figure((2, 1), label="a & b")
    axes = figure.add_subplot(xlim=(0, 30), xlabel="$x$ in m")
    axes.scatter([1, 2], [0, 1], urls=["first", "second <"])
    add_scale_bar(axes, ("ft", 0.3048))
    return figure


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_equal_figures_are_equal_files(tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    once = save_figure(drawn(), tmp_path / f"a.{kind}").read_bytes()
    monkeypatch.setitem(matplotlib.rcParams, "lines.markersize", 20.0)  # as a user could set it
    assert save_figure(drawn(), tmp_path / f"b.{kind}").read_bytes() == once
    assert matplotlib.rcParams["lines.markersize"] == 20.0
    assert [path.name for path in tmp_path.iterdir() if path.name[0] not in "ab"] == []


def test_texts_and_titles_are_kept_in_svg(tmp_path: Path) -> None:
    text = save_figure(drawn(), tmp_path / "a.svg").read_text()
    assert all(f"<title>{title}</title>" in text for title in ("a &amp; b", "first", "second &lt;"))
    assert ">$x$ in m</text>" in text and ">20 ft</text>" in text, "a round length below a quarter of the width"


@pytest.mark.filterwarnings("error")
def test_letters_that_cannot_be_drawn_are_shown_by_their_codes(tmp_path: Path) -> None:
    figure = drawn()
    figure.axes[0].set(title="a\x00\ud800\x1b", xlabel="模型\nmodel")
    for kind in ("png", "pdf", "svg"):
        path = save_figure(figure, tmp_path / f"a.{kind}")
    assert ">a\\x00\\ud800\\x1b</text>" in path.read_text()


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="suffix of an image"):
        save_figure(drawn(), tmp_path / "a.txt")
    assert save_figure(drawn(), tmp_path / "a", "png").read_bytes()[:4] == b"\x89PNG"
