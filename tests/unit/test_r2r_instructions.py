"""Instructions describe the path, a follower without the path finds it again, and texts contain only facts."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from random import Random
from typing import get_args

import pytest
from export_samples import random_graph
from task_samples import exported, house

from nvsim.cli.main import main
from nvsim.graph.paths import PathGraph
from nvsim.graph.quantities import Slope
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.r2r.instructions import Register
from nvsim.r2r.instructions.cues import Cue
from nvsim.r2r.instructions.generating import InstructedDataset, describe_path, find_described_path, instruct
from nvsim.r2r.instructions.ground import (
    DETAILS,
    TURNS,
    Detail,
    Leg,
    PathSteps,
    Step,
    View,
    continues_leg,
    is_bend,
    round_legs,
    turn_before_step,
    wrap_angle,
)
from nvsim.r2r.instructions.short_wording import short_instruction
from nvsim.r2r.instructions.statistics import statistics_of
from nvsim.r2r.instructions.wording import (
    AHEAD_PHRASES,
    CLOCK_PHRASES,
    DEGREE_PHRASES,
    HALF_METER,
    METER_PHRASES,
    ONE_METER,
    TURN_PHRASES,
    WALK_PHRASES,
    instruction_of,
    long_instruction,
)
from nvsim.r2r.tasks.shortest import PathBounds
from nvsim.r2r.tasks.splitting import SPLITS, PathCounts, sample_tasks

TURN_TO = {name: math.radians(degrees) for degrees, name in TURNS.items()}


def row_of(*places: tuple[float, float, float]) -> PathSteps:
    """A path over places in this order."""
    ids = [f"v{i}" for i in range(len(places))]
    edges = [edge(a, b) for a, b in zip(ids, ids[1:])]
    return PathSteps(
        PathGraph.of(NavGraph("row", {id: Viewpoint(id, p) for id, p in zip(ids, places)}, {e.key: e for e in edges}))
    )


def told(*graphs: NavGraph, count: int = 300, register: Register = "short") -> InstructedDataset:
    dataset = sample_tasks(graphs, (), PathBounds(), PathCounts(count, 20, 0))
    return instruct(dataset, graphs, 3, 0, register=register)


def test_legs_are_what_the_path_does() -> None:
    # 2 m north, 3 m north-north-east, 2 m west, a stair of 3 m to the west that rises 1.8 m, 1 m south.
    bend = math.radians(20)
    ground = row_of(
        (0, 0, 1),
        (0, 2, 1),
        (3 * math.sin(bend), 2 + 3 * math.cos(bend), 1),
        (3 * math.sin(bend) - 2, 2 + 3 * math.cos(bend), 1),
        (3 * math.sin(bend) - 2 - 2.4, 2 + 3 * math.cos(bend), 2.8),
        (3 * math.sin(bend) - 2 - 2.4, 1 + 3 * math.cos(bend), 2.8),
    )
    legs = ground.legs(range(6), math.radians(270))
    assert [leg.slope for leg in legs] == ["level", "level", "up", "level"]
    assert [leg.meters for leg in legs] == pytest.approx([5, 2, 1.8, 1])
    assert [math.degrees(leg.turn) for leg in legs] == pytest.approx([90, -110, 0, -90])


def test_stairs_are_said_with_their_height_and_where_they_end() -> None:
    # 3 m north on the level, a stair of two steps of the graph with a rise of 1.2 m each, 2 m east.
    ground = row_of((0, 0, 1), (0, 3, 1), (0, 5, 2.2), (0, 7, 3.4), (2, 7, 3.4))
    there = ground.legs(range(5), 0.0)
    assert [leg.cues for leg in there] == [
        frozenset([Cue("to stairs", "up")]),
        frozenset([Cue("stairs", "top")]),
        frozenset(),
    ]
    assert there[1].meters == pytest.approx(2.4)
    back = ground.legs([4, 3, 2, 1, 0], math.radians(270))
    assert [sorted(leg.cues) for leg in back] == [[Cue("to stairs", "down")], [Cue("stairs", "bottom")], []]
    (partway,) = ground.legs([1, 2], 0.0)
    assert not partway.cues and round_legs([partway], "words")[0].meters == 1.0
    text = instruction_of(round_legs([there[1]], "words"), "words", Random(0))
    assert "stairs" in text and "2.5 meters" in text and ("top" in text or "all the way up" in text)


@pytest.mark.parametrize(
    "degrees, word", [(10, "ahead"), (-50, "slightly left"), (100, "right"), (-130, "sharply left"), (-175, "around")]
)
def test_turns_are_said_in_the_nearest_word(degrees: float, word: str) -> None:
    (leg,) = round_legs([Leg(math.radians(degrees), 2.4, "level")], "words")
    assert leg == Leg(TURN_TO[word], 2.0, "level")
    assert abs(math.degrees(leg.turn) - degrees) <= 22.5 or word == "around"


def pattern_of(phrase: str) -> str:
    before, after = (re.escape(part) for part in phrase.split("{}"))
    return before.replace(r"\*", "[a-z ]*") + r"(about|roughly|some|one|a single|half|\d)[^,]*" + after


def read(text: str, detail: Detail) -> list[Leg]:
    """The facts in every sentence but the last, for a reader who knows the phrases."""
    legs = []
    for sentence in re.findall(r"[^.]+(?:\.\d+[^.]*)*\.", text)[:-1]:
        words = sentence.lower()
        number = re.search(r"([\d.]+) meters", words)
        meters = float(number[1]) if number else 1.0
        meters = 0.5 if any(phrase in words for phrase in HALF_METER) else meters
        assert number or any(phrase in words for phrase in (*ONE_METER, *HALF_METER))
        slopes = {
            slope
            for slope, phrases in WALK_PHRASES.items()
            for phrase in phrases
            if re.search(pattern_of(phrase), words)
        }
        hour = re.search(r"(\d+) o'clock", words)
        if detail == "clock" and hour:
            turn = wrap_angle(math.radians(30 * int(hour[1])))
        elif any(phrase in words for phrase in AHEAD_PHRASES):
            turn = 0.0
        elif detail == "degrees":
            degrees, side = re.search(r"(\d+) degrees (?:to the )?(right|left)", words).groups()
            turn = math.radians(int(degrees)) * (1 if side == "right" else -1)
        else:
            (turn,) = {TURN_TO[name] for name, phrases in TURN_PHRASES.items() for p in phrases if p.lower() in words}
        (slope,) = slopes
        legs.append(Leg(turn, meters, slope))
    return legs


@pytest.mark.parametrize("detail", DETAILS)
def test_every_fact_can_be_read_back_from_the_words(detail: Detail) -> None:
    random = Random(0)
    for _ in range(500):
        legs = [
            Leg(random.uniform(-math.pi, math.pi), random.uniform(0.3, 15), random.choice(["level", "up", "down"]))
            for _ in range(random.randint(1, 6))
        ]
        said = round_legs(legs, detail)
        text = instruction_of(said, detail, random)
        found = read(text, detail)
        assert [
            (round(math.cos(leg.turn), 6), round(math.sin(leg.turn), 6), leg.meters, leg.slope) for leg in found
        ] == [(round(math.cos(leg.turn), 6), round(math.sin(leg.turn), 6), leg.meters, leg.slope) for leg in said], text
        assert "  " not in text and "then" not in re.findall(r"Then [^.]*?, (then)", text)


@pytest.mark.parametrize("slope", ["level", "up", "down"])
def test_a_long_instruction_without_a_distance_has_no_gap(slope: Slope) -> None:
    legs = [Leg(0.0, 2.0, "level"), Leg(1.6, None, slope)]
    for seed in range(50):
        sentences = long_instruction(legs, [View(""), View(""), View("")], "words", Random(seed))
        text = " ".join(words for words, _ in sentences)
        assert "  " not in text and " ," not in text and " ." not in text and "you are ." not in text, text


def test_no_phrase_has_two_meanings() -> None:
    phrases = [p for group in (*TURN_PHRASES.values(), *WALK_PHRASES.values()) for p in group]
    phrases += [*AHEAD_PHRASES, *CLOCK_PHRASES, *DEGREE_PHRASES, *METER_PHRASES, *HALF_METER, *ONE_METER]
    assert len(set(phrases)) == len(phrases)


@pytest.mark.parametrize("register", get_args(Register))
def test_a_follower_finds_nine_paths_of_ten_again(register: Register) -> None:
    graphs = [house("one", 8), house("two", 8, seed=2), random_graph("steep", 80, 3, reach=3.5)]
    for graph in graphs:
        found = told(graph, count=150, register=register)
        assert found.paths > 100 and len(found.found) >= 0.9 * found.paths


def test_the_follower_is_one_that_weighs_all_paths_one_by_one() -> None:
    graph = random_graph("hall", 22, 5, reach=4.5)
    ground = PathSteps(PathGraph.of(graph))
    random = Random(1)

    def step_between(a: int, b: int) -> Step:
        return next(step for step in ground.steps[a] if step.to == b)

    def costs(path: list[int], heading: float, said: list[Leg]) -> list[float]:
        """Of every way to share the steps of a path out among the legs."""
        found = []

        def share(i: int, facing: float, k: int, walked: float, cost: float) -> None:
            slack = 1.0 + 0.2 * said[k].meters if k >= 0 else 0.0
            ended = k >= 0 and abs(walked - said[k].meters) <= slack
            here = cost + ((walked - said[k].meters) / 0.5) ** 2 if ended else math.inf
            if i == len(path) - 1:
                if ended and k == len(said) - 1:
                    found.append(here)
                return
            step = step_between(path[i], path[i + 1])
            after = facing if step.heading is None else step.heading
            turn = turn_before_step(facing, step)
            if k >= 0 and (continues_leg(said[k].slope, turn, step) or is_bend(said[k].slope, turn, step)):
                bend = 0.0 if continues_leg(said[k].slope, turn, step) else (turn / math.radians(70)) ** 2
                share(i + 1, after, k, walked + step.meters, cost + bend)
            if (ended or k < 0) and k + 1 < len(said) and step.slope == said[k + 1].slope:
                off = wrap_angle(turn_before_step(facing, step) - said[k + 1].turn)
                if abs(off) <= math.radians(60):
                    new = (0.0 if k < 0 else here) + (off / math.radians(22.5)) ** 2
                    share(i + 1, after, k + 1, step.meters, new)

        share(0, heading, -1, 0.0, 0.0)
        return found

    def simple_paths(path: list[int]) -> list[list[int]]:
        longer = [[*path, step.to] for step in ground.steps[path[-1]] if step.to not in path] if len(path) < 5 else []
        return [path, *(deeper for one in longer for deeper in simple_paths(one))]

    compared = 0
    for _ in range(25):
        start, heading = random.randrange(len(ground.steps)), random.uniform(0, 2 * math.pi)
        paths = [path for path in simple_paths([start]) if len(path) > 1]
        if not paths:
            continue
        # At most 3 m: no path of more than four steps of these lengths is as short.
        goal = min(paths, key=lambda path: abs(sum(leg.meters for leg in ground.legs(path, heading)) - 3))
        said = round_legs(ground.legs(goal, heading), "words")
        best = min((cost, path) for path in paths for cost in costs(path, heading, said))
        found = find_described_path(ground, start, heading, said)
        assert found is not None and min(costs(found, heading, said)) == pytest.approx(best[0])
        compared += 1
    assert compared > 15


def test_nobody_can_follow_what_fits_no_path() -> None:
    ground = row_of((0, 0, 1), (0, 2, 1), (0, 4, 1))
    assert find_described_path(ground, 0, 0.0, [Leg(0.0, 4.0, "level")]) == [0, 1, 2]
    assert find_described_path(ground, 0, 0.0, [Leg(math.pi, 4.0, "level")]) is None
    assert find_described_path(ground, 0, 0.0, [Leg(0.0, 4.0, "up")]) is None


@pytest.mark.parametrize(
    "others, detail, found, said_turn",
    [
        ((10,), "words", True, 90),
        ((95,), "clock", True, 60),
        ((62, 95), "degrees", True, 70),
        ((62, 70), "degrees", False, 70),
    ],
)
def test_an_instruction_is_as_fine_as_it_has_to_be(
    others: tuple[int, ...], detail: str, found: bool, said_turn: int
) -> None:
    """The path leads off at 69 degrees, and other ways at `others`."""
    at = {"start": (0.0, 0.0)}
    at |= {f"to{d}": (3 * math.sin(math.radians(d)), 3 * math.cos(math.radians(d))) for d in (69, *others)}
    ends = [edge("start", f"to{d}") for d in (69, *others)]
    graph = NavGraph("fork", {id: Viewpoint(id, (*p, 1.5)) for id, p in at.items()}, {e.key: e for e in ends})
    ground = PathSteps(PathGraph.of(graph))
    (said,), how, again = describe_path(ground, [ground.row["start"], ground.row["to69"]], 0.0)
    assert (how, again, round(math.degrees(said.turn))) == (detail, found, said_turn)


def test_five_hundred_instructions_are_worded_in_three_hundred_ways() -> None:
    dataset = told(house("one", 8), count=170).dataset
    texts = [text for name in SPLITS for task in dataset.splits[name] for text in task.instructions][:500]
    assert len(texts) == 500 and len(set(texts)) >= 300


@pytest.mark.parametrize("register", get_args(Register))
def test_a_register_has_its_length_and_its_unit(register: Register) -> None:
    dataset = told(house("one", 8), count=60, register=register).dataset
    found = statistics_of([text for name in SPLITS for task in dataset.splits[name] for text in task.instructions])
    least, most = {"short": (10, 28), "detailed": (20, 60), "rxr": (20, 150)}[register]
    assert least < found.words < most
    assert found.metres == 0 if register == "short" else found.metres > 0.9


def test_a_rough_distance_is_understood_and_paces_are_counted() -> None:
    ground = row_of(*((0, float(y), 1) for y in range(12)))
    rough = round_legs([Leg(0.0, 2.2, "level", measure="roughly")], "words")
    assert rough[0].meters == 2.5 and find_described_path(ground, 0, 0.0, rough) is None  # 2 or 3 m
    paces = round_legs([Leg(0.0, 4.1, "level", measure="paces")], "words")
    assert paces[0].meters == pytest.approx(4) and find_described_path(ground, 0, 0.0, paces) == [0, 1, 2, 3, 4]
    assert "eight " in short_instruction(paces, "words", Random(0))
    words = short_instruction(rough, "words", Random(0))
    assert any(word in words for word in ("few", "some", "couple", "little", "handful"))


def test_a_leg_goes_around_a_bend_if_the_text_does_not_mention_it() -> None:
    bend = math.radians(40)
    ground = row_of((0, 0, 1), (0, 3, 1), (3 * math.sin(bend), 3 + 3 * math.cos(bend), 1))
    forms = list(ground.legs_with_bends(range(3), 0.0))
    assert [len(legs) for legs in forms] == [1, 2]
    assert forms[0][0].meters == pytest.approx(6) and forms[0][0].turn == 0
    assert find_described_path(ground, 0, 0.0, forms[0]) == [0, 1, 2]


def test_statistics_are_those_of_the_words() -> None:
    texts = ["Walk two metres to the sofa.", "Go to the thing.", "Turn left and go 3 m.", "Stop."]
    found = statistics_of(texts)
    assert (found.instructions, found.words, found.vocabulary) == (4, 4.2, 14)
    assert (found.metres, found.vague, found.without_landmark) == (0.5, 0.25, 0.5)
    assert statistics_of([]).words == 0


def test_exported_tasks_have_instructions_and_joined_ones_both(tmp_path: Path) -> None:
    command = ["export", "tasks", "--scans", str(exported(tmp_path, house("one", 6))), "--joined", "4"]
    assert main([*command, "--out", str(tmp_path / "a")]) == main([*command, "--out", str(tmp_path / "b")]) == 0
    assert main([*command, "--out", str(tmp_path / "none"), "--instructions", "0"]) == 0
    for name in SPLITS:
        files = [tmp_path / folder / f"R2R_{name}.json" for folder in ("a", "b", "none")]
        assert files[0].read_text() == files[1].read_text()
        tasks = {item["path_id"]: item["instructions"] for item in json.loads(files[0].read_text())}
        assert all(len(set(texts)) >= 2 and len(texts) == 3 for texts in tasks.values())
        assert all(item["instructions"] == [] for item in json.loads(files[2].read_text()))
        for item in json.loads((tmp_path / "a" / f"R4R_{name}.json").read_text()):
            first, second = tasks[item["first_path_id"]], tasks[item["second_path_id"]]
            assert item["instructions"] == [f"{a} {b}" for a in first for b in second]
    about = json.loads((tmp_path / "a" / "tasks.json").read_text())["instructions"]
    assert about["register"] == "short" and about["statistics"]["instructions"] == 3 * about["paths"]
    assert about["each"] == 3 and about["found_again"] >= 0.9 * about["paths"]


def test_indefinite_articles_fit_the_next_word() -> None:
    from nvsim.r2r.instructions.phrases import sentence

    assert sentence("ahead of you is a indoor plant, then a unit and a orange sofa") == (
        "Ahead of you is an indoor plant, then a unit and an orange sofa."
    )
    assert sentence("a open door") == "An open door."
