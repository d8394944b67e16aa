"""Judges prefer images, and verdicts become the paper's points: judges at endpoints on a real server, and figures."""

from __future__ import annotations

import base64
import csv
import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import cv2
import numpy as np
import pytest
from endpoint_server import Asked, Reply, Service, said, serving

from nvsim.cli.main import main
from nvsim.evaluation.interval import wilson
from nvsim.evaluation.judging.compared_images import by_folders
from nvsim.evaluation.judging.judges import by_lpips, by_sharpness, read_prompt
from nvsim.evaluation.judging.report import draw_sunburst, file_name
from nvsim.evaluation.judging.verdicts import (
    JudgeVerdicts,
    Reason,
    Verdict,
    consistent_winner,
    reasons_by_category,
    table_rows,
)
from nvsim.figures import save_figure

LEVELS = {"bright": 200, "middle": 120, "dark": 40}


@pytest.fixture(autouse=True)
def no_proxy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.delenv("NVSIM_ENDPOINT_KEY", raising=False)
    monkeypatch.setenv("NVSIM_MODELS", str(tmp_path / "no models"))


@pytest.fixture
def folders(tmp_path: Path) -> list[str]:
    """Three folders of two seen views and three novel ones, each of its own brightness; views differ in a bar."""
    for name, level in LEVELS.items():
        for view in ("seen/a", "seen/b", "novel/a", "novel/b", "novel/c"):
            image = np.full((48, 64, 3), level, np.uint8)
            image[:, 8 * "abc".index(view[-1]) :][:, :4] = 255
            image[:8] = 60 if view.startswith("novel") else 90
            path = tmp_path / name / f"{view}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), image)
    return [str(tmp_path / name) for name in LEVELS]


def level(url: str) -> float:
    data = base64.b64decode(url.partition(",")[2])
    return float(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[40, 60].mean())


def verdict(choice: str, *reasons: tuple[str, bool, str]) -> Reply:
    given = [{"image": i, "good": g, "category": c, "words": "so it is"} for i, g, c in reasons]
    return said(f"I think {json.dumps({'choice': choice, 'reasons': given})}", 800, 40)


def likes_bright(n: int, asked: Asked) -> Reply:
    first, second = map(level, asked.images)
    better, worse = ("first", "second") if first > second else ("second", "first")
    return verdict(better, (better, True, "Floor surface"), (worse, False, "haze"), (worse, False, "its smell"))


def judge(folders: list[str], out: Path, service: Service, *more: str, names: tuple[str, ...] = ("keen",)) -> list[str]:
    judges = [f"{name}@{service.url}" for name in names]
    quick = ["--first-wait", "0.001", "--yes"]
    return ["evaluate", "judge", "--folders", *folders, "--out", str(out), "--judges", *judges, *quick, *more]


def rows_of(out: Path, name: str) -> list[dict[str, str]]:
    with open(out / "judge.csv", newline="") as file:
        return [row for row in csv.DictReader(file) if row["judge"] == name]


def test_a_judge_with_one_taste_wins_in_both_orders(
    folders: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    with serving(likes_bright) as service:
        assert main(judge(folders, out, service)) == 0
        printed = capsys.readouterr()
        sent = len(service.asked)
        assert main(judge(folders, out, service)) == 0
        assert len(service.asked) == sent == 5 * 3 * 2
    assert "30 requests with 60 images" in printed.err
    # Every pair of images was shown in both orders.
    shown = sorted(tuple(round(level(url), -1) for url in a.images) for a in service.asked)
    assert shown == sorted(5 * [(x, y) for x in (40, 120, 200) for y in (40, 120, 200) if x != y])
    rows = rows_of(out, "keen")
    assert [(r["a"], r["b"]) for r in rows] == [("bright", "middle"), ("bright", "dark"), ("middle", "dark")]
    low, high = wilson(5, 5)
    for row in rows:
        assert (row["pairs"], float(row["points_a"]), float(row["points_b"]), row["ties"]) == ("5", 5, 0, "0")
        assert (float(row["share_low"]), float(row["share_high"])) == pytest.approx((100 * low, 100 * high))
        assert (row["seen_pairs"], row["novel_pairs"], row["unanswered"]) == ("2", "3", "0")
    counts = reasons_by_category([_judged(out, "keen")])
    assert counts == {
        ("bright", True, "floor surface"): 20,
        ("dark", False, "haze"): 20,
        ("dark", False, "other"): 20,
        ("middle", False, "haze"): 10,
        ("middle", False, "other"): 10,
        ("middle", True, "floor surface"): 10,
    }
    assert re.search(r"bright vs. middle +100 \(5\)", printed.out) and "no LPIPS model" in printed.out
    assert r"\textbf{bright} vs. dark & 100\% (5) & 0\% (0)" in (out / "judge.tex").read_text()
    kept = next(p for p in (out / "answers").rglob("*.json"))
    transcript = json.loads(kept.read_text())["messages"][1]["parts"]
    assert [re.sub(r".*, ", "", p["image"]) for p in transcript if isinstance(p, dict)][0] in LEVELS


def _judged(out: Path, name: str) -> JudgeVerdicts:
    found = next(one for one in json.loads((out / "verdicts.json").read_text()) if one["judge"] == name)
    verdicts = [
        Verdict(**{**v, "said": tuple(v["said"]), "reasons": tuple(Reason(**r) for r in v["reasons"])})
        for v in found["verdicts"]
    ]
    return JudgeVerdicts(name, found["what"], verdicts)


def test_a_judge_that_likes_what_comes_first_gives_ties_alone(folders: list[str], tmp_path: Path) -> None:
    with serving(lambda n, asked: verdict("first" if asked.body["model"] == "hasty" else "tie")) as service:
        assert main(judge(folders[:2], tmp_path / "out", service, names=("hasty", "calm"))) == 0
    for name in ("hasty", "calm"):
        (row,) = rows_of(tmp_path / "out", name)
        assert (float(row["points_a"]), float(row["tie_rate"]), row["ties"]) == (2.5, 100, "5")


def test_a_judge_without_any_usable_answer_fails(
    folders: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with serving(lambda n, asked: said(None, refusal="I judge nobody.")) as service:
        assert main(judge(folders[:2], tmp_path / "out", service, "--parallel", "1")) == 1
    assert "error: no answer of keen was usable" in capsys.readouterr().err
    assert (tmp_path / "out").is_dir()


def test_pairs_without_a_verdict_are_left_out_and_said(
    folders: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def shy(n: int, asked: Asked) -> Reply:
        if n % 10 == 3:
            return said(None, refusal="I judge nobody.")
        return (
            said('{"choice": "the red one"}')
            if n % 10 == 6 and len(asked.body["messages"]) == 2
            else likes_bright(n, asked)
        )

    with serving(shy) as service:
        assert main(judge(folders[:2], tmp_path / "out", service, "--parallel", "1")) == 0
    (row,) = rows_of(tmp_path / "out", "keen")
    assert (row["pairs"], row["unanswered"], float(row["points_a"])) == ("4", "1", 4)
    printed = capsys.readouterr()
    assert (
        "gives no verdict on bright and middle" in printed.err and "there is no usable verdict: 1 pairs" in printed.out
    )


def test_an_endpoint_that_fails_leaves_the_figures_and_the_judges_before_it(folders: list[str], tmp_path: Path) -> None:
    def behave(n: int, asked: Asked) -> Reply:
        if asked.body["model"] == "gone":
            return Reply({"error": {"message": "bad key"}}, 401)
        return likes_bright(n, asked)

    out = tmp_path / "out"
    with serving(behave) as service:
        command = judge(folders[:2], out, service, names=("keen", "gone"))
        assert main(command) == 2
        assert rows_of(out, "keen")[0]["pairs"] == "5" and rows_of(out, "sharpness (offline, no reference)")
        assert not rows_of(out, "gone")
        before = len(service.asked)
        service.behave = likes_bright
        assert main(command) == 0
        assert len(service.asked) == before + 10
    assert rows_of(out, "gone")[0]["pairs"] == "5"


def test_without_judges_nothing_is_asked_and_the_table_has_rows(
    folders: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate", "judge", "--folders", *folders, "--out", str(tmp_path / "out"), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out.splitlines()[-1])["rows"]
    assert [row["judge"].split()[0] for row in rows] == ["LPIPS", *["sharpness"] * 3]
    assert "no LPIPS model" in rows[0]["why"]
    assert not (tmp_path / "out" / "answers").exists() and not list((tmp_path / "out").glob("*.svg"))


@pytest.mark.parametrize(
    ("forth", "back", "won"),
    [
        ("first", "second", "A"),
        ("second", "first", "B"),
        ("first", "first", ""),
        ("second", "second", ""),
        ("tie", "tie", ""),
        ("first", "tie", ""),
        ("tie", "first", ""),
    ],
)
def test_a_win_needs_both_orders(forth: str, back: str, won: str) -> None:
    assert consistent_winner("A", "B", forth, back) == won  # type: ignore[arg-type]


def test_points_are_the_papers(tmp_path: Path, folders: list[str]) -> None:
    """Table III: 290 points of 375 with 80 ties are 77 % and 21 %."""
    shown = by_folders({"ours": Path(folders[0]), "theirs": Path(folders[1])}, None)
    won = ["ours"] * 250 + [""] * 80 + ["theirs"] * 45 + [None]
    verdicts = [Verdict(str(i), "novel", "ours", "theirs", w) for i, w in enumerate(won)]
    (row,) = table_rows([JudgeVerdicts("j", "", verdicts)], shown)
    assert (row["points_a"], row["points_b"], row["pairs"], row["ties"], row["unanswered"]) == (290, 85, 375, 80, 1)
    assert (round(row["share_a"]), round(row["tie_rate"])) == (77, 21) and row["seen_share"] is None
    turned = [
        Verdict(str(i), "novel", "ours", "theirs", w and {"ours": "theirs"}.get(w, "ours")) for i, w in enumerate(won)
    ]
    (row,) = table_rows([JudgeVerdicts("j", "", turned)], shown)
    assert (row["a"], row["points_a"]) == ("theirs", 290)


def test_figures_prefer_what_they_say(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    sharp = cv2.resize(random.integers(0, 255, (12, 16, 3), np.uint8), (160, 120), interpolation=cv2.INTER_NEAREST)
    images = {"sharp": sharp, "soft": cv2.GaussianBlur(sharp, (0, 0), 3), "same": sharp.copy(), "photo": sharp}
    images["same"][0, 0] = 0
    for name, image in images.items():
        (tmp_path / name).mkdir()
        cv2.imwrite(str(tmp_path / name / "v.png"), image)
    shown = by_folders({n: tmp_path / n for n in ("sharp", "soft", "same")}, tmp_path / "photo")

    def apart(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.abs(a - b).mean())

    for judged in (by_sharpness(shown), by_lpips(shown, apart, "")):
        assert [(v.a, v.b, v.won) for v in judged.verdicts] == [
            ("sharp", "soft", "sharp"),
            ("sharp", "same", ""),
            ("soft", "same", "same"),
        ]
    without = by_folders({n: tmp_path / n for n in ("sharp", "soft")}, None)
    assert by_lpips(without, apart, "").why == "no view has a photograph"


def test_a_sunburst_has_an_area_for_every_count(tmp_path: Path) -> None:
    counts = {("a", True, "floor"): 30, ("a", False, "haze & <co>"): 10, ("b", False, "haze"): 20}
    figure = draw_sunburst("Reasons", counts)
    wedges = [wedge.theta2 - wedge.theta1 for wedge in figure.axes[0].patches]
    # The contestants, then their sides, then the categories, as shares of a full circle.
    assert np.abs(wedges) == pytest.approx([240, 120, 180, 60, 120, 180, 60, 120], abs=0.01)
    svg, png = (save_figure(figure, tmp_path / f"s.{kind}") for kind in ("svg", "png"))
    words = [text.text for text in ElementTree.parse(svg).iter("{http://www.w3.org/2000/svg}text")]
    assert {"haze & <co> (10)", "a (67 %)", "Reasons"} <= set(words)
    assert cv2.imread(str(png)).std() > 10
    assert "No reasons were given." in {text.get_text() for text in draw_sunburst("x", {}).axes[0].texts}
    assert file_name("gpt-4.1 at http://x/v1") == "gpt_4_1_at_http___x_v1"


def test_what_cannot_be_compared_is_said(
    folders: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "other").mkdir()
    cv2.imwrite(str(tmp_path / "other" / "z.png"), np.zeros((4, 4, 3), np.uint8))
    out = ["--out", str(tmp_path / "out")]
    here = ["--judges", "m@http://127.0.0.1:9/v1"]
    for more, words in [
        ([], "exactly one of"),
        (["--folders", *folders], "give --out"),
        (["--folders", folders[0], *out], "two or more"),
        (["--folders", folders[0], str(tmp_path / "other"), *out], "no image of the same name"),
        (["--folders", *folders[:2], *out, "--judges", "m"], "is not MODEL@URL"),
        (["--folders", *folders[:2], *out, *here, "--prices-in", "1", "2"], "2 values for 1 judges"),
        (["--folders", *folders[:2], *out, *here], "give --yes"),
        (["--folders", *folders[:2], *out, "--seen", "0", "--novel", "0"], "no views to compare"),
        (["--folders", folders[0], folders[0], *out], "the same name"),
    ]:
        assert main(["evaluate", "judge", *more]) == 2
        assert words in capsys.readouterr().err
    bad = tmp_path / "p.txt"
    bad.write_text("[system]\n[user]\n$first $second\n[again]\n[categories]\n\n")
    with pytest.raises(Exception, match=r"\[categories\] is empty"):
        read_prompt(bad)
