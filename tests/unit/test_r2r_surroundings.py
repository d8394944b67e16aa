"""Objects near the path are found at their position and with their color, and instructions name them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from random import Random

import numpy as np
import pytest
from boxed_scan import BLUE, BROWN, GRAY, RED, WALL, Block, export_blocks, flat_house

from nvsim.graph.paths import PathGraph
from nvsim.graph.types import NavGraph
from nvsim.r2r.instructions import short_wording as short
from nvsim.r2r.instructions.cues import Cue, cues_along
from nvsim.r2r.instructions.generating import find_described_path, instruct, with_one_name_each
from nvsim.r2r.instructions.ground import Leg, PathSteps
from nvsim.r2r.instructions.phrases import THINGS, TURNS, WordChoice
from nvsim.r2r.instructions.short_wording import short_instruction
from nvsim.r2r.instructions.wording import (
    ALONG,
    BY,
    FLOOR,
    INTO,
    OUT_OF,
    PAST,
    RUG,
    STAIRS,
    STOP_BY,
    THROUGH,
    TO_STAIRS,
    TOWARDS,
    cue_words,
    stop_words,
)
from nvsim.r2r.surroundings.floor_objects import FloorObject
from nvsim.r2r.surroundings.layers import CELL, layers_of
from nvsim.r2r.surroundings.naming import COLORS, NAMELESS, Outline, Shape, lab_of, names_of, shape_of
from nvsim.r2r.surroundings.survey import Surroundings, surroundings_of
from nvsim.r2r.surroundings.visibility import views_from_viewpoints
from nvsim.r2r.tasks.shortest import PathBounds
from nvsim.r2r.tasks.splitting import SPLITS, PathCounts, sample_tasks

Seen = tuple[NavGraph, Surroundings]
IMPLIED = {"plant": "green"}
"""Shapes whose names may omit the color."""


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    blocks, graph = flat_house()
    root = export_blocks(tmp_path_factory.mktemp("scans"), blocks, graph)
    return graph, surroundings_of(graph, list(layers_of(list(views_from_viewpoints(root, graph)), graph)))


@pytest.mark.parametrize(
    "rgb, name",
    [(BLUE, "blue"), (RED, "red"), (BROWN, "brown"), (GRAY, "gray"), (WALL, "white"), ((60, 110, 50), "green")],
)
def test_colors_have_the_names_that_people_give_them(rgb: tuple[int, int, int], name: str) -> None:
    assert COLORS[int(names_of(lab_of(np.array(rgb, float))))] == name


@pytest.mark.parametrize("rgb", [(150, 75, 55), (180, 182, 190), (122, 122, 104), (70, 70, 74)])
def test_a_color_between_two_names_has_none(rgb: tuple[int, int, int]) -> None:
    assert int(names_of(lab_of(np.array(rgb, float)))) == NAMELESS


def test_things_are_found_in_their_color_and_shape_and_nothing_else(house: Seen) -> None:
    things = {thing.color_and_shape: thing for thing in house[1].things}
    assert set(things) == {("blue", "sofa"), ("red", "tall")} and len(house[1].things) == 2
    sofa, cabinet = things["blue", "sofa"], things["red", "tall"]
    assert sofa.middle == pytest.approx((2.2, 4.4), abs=0.15) and sofa.top == pytest.approx(0.82, abs=0.06)
    assert cabinet.middle == pytest.approx((4.6, 3.35), abs=0.25) and cabinet.top == pytest.approx(1.8, abs=0.06)


def test_doorways_rooms_and_corridors_are_where_they_are(house: Seen) -> None:
    graph, seen = house
    assert {pair for pair, meters in seen.doors.items() if meters} == {("c", "f"), ("f", "c")}
    assert seen.doors["c", "f"] == pytest.approx([0.95], abs=0.1)
    assert seen.doors["f", "c"] == pytest.approx([1.15], abs=0.1)
    assert seen.kinds["e"] == "room" and seen.kinds["g"] == seen.kinds["h"] == "corridor"
    assert "corridor" not in {seen.kinds[id] for id in "abcde"} and "room" not in {seen.kinds[id] for id in "fghi"}


def test_sides_are_those_of_one_who_walks(house: Seen) -> None:
    graph, seen = house
    there = cues_along("de", math.radians(85), seen)
    back = cues_along("ed", math.radians(265), seen)
    assert Cue("past", "blue sofa", "left") in there and Cue("past", "blue sofa", "right") in back
    assert Cue("by", "red tall", "ahead") in there
    assert not [cue for cue in cues_along("gh", math.radians(90), seen) if cue.kind in ("past", "by")]


def test_one_who_leaves_the_room_goes_from_brown_to_gray_through_the_door(house: Seen) -> None:
    cues = cues_along("bcfg", math.radians(90), house[1])
    assert {Cue("through", "1"), Cue("into", "corridor"), Cue("floor", "brown to gray")} <= cues
    assert Cue("along", "corridor") in cues_along("gh", math.radians(90), house[1])
    assert not [cue for cue in cues_along("ab", math.radians(90), house[1]) if cue.kind in ("floor", "through")]


def test_sight_tells_apart_what_turns_and_meters_do_not(house: Seen) -> None:
    graph, seen = house
    ways = PathGraph.of(graph)
    plain, seeing = PathSteps(ways), PathSteps(ways, seen)
    rows = [seeing.row[id] for id in "bcfg"]
    somehow = Leg(0.0, None, "level")
    assert find_described_path(plain, rows[0], math.radians(90), [somehow]) is None  # it may end anywhere
    said = [Leg(0.0, None, "level", frozenset([Cue("through", "1"), Cue("into", "corridor")]))]
    found = find_described_path(seeing, rows[0], math.radians(90), said)
    assert found is None or found[:3] == rows[:3]
    ends = [Leg(0.0, 5.5, "level", frozenset([Cue("through", "1")]))]
    assert find_described_path(seeing, rows[0], math.radians(90), ends) == rows
    nowhere = [Leg(0.0, 5.5, "level", frozenset([Cue("past", "green sofa", "left")]))]
    assert find_described_path(seeing, rows[0], math.radians(90), nowhere) == rows  # the best there is


def test_instructions_name_what_is_seen_and_are_followed_again(house: Seen) -> None:
    graph, seen = house
    dataset = sample_tasks(
        [graph], (), PathBounds(fewest_edges=2, least_meters=3), PathCounts(30, 2, 0, unseen_share=0.01)
    )
    told = instruct(dataset, [graph], 3, 0, {graph.scan: seen})
    assert told.paths > 15 and len(told.found) >= 0.9 * told.paths
    texts = [text for name in SPLITS for task in told.dataset.splits[name] for text in task.instructions]
    assert sum(any(word in text for word in ("enter", "exit", "leave", "door", " into ")) for text in texts) > 5
    assert any("sofa" in text or "couch" in text for text in texts)
    again = instruct(dataset, [graph], 3, 0, {graph.scan: seen})
    assert [task.instructions for task in again.dataset.splits["train"]] == [
        task.instructions for task in told.dataset.splits["train"]
    ]
    for task in (task for name in SPLITS for task in told.dataset.splits[name]):
        if any("door" in text for text in task.instructions):
            assert {"c", "f"} <= set(task.path)


def outline(*boxes: tuple[float, float, float, float, float, float], color: str = "brown", **known: float) -> Outline:
    """The form of boxes (x0, y0, z0, x1, y1, z1) in meters, of which all sides are seen."""
    size = np.max([box[3:5] for box in boxes], axis=0)
    columns, rows = np.meshgrid(*((np.arange(round(side / CELL)) + 0.5) * CELL for side in size))
    tops, lowest = np.zeros(columns.shape), np.full(columns.shape, np.inf)
    for x0, y0, z0, x1, y1, z1 in boxes:
        on = (columns > x0) & (columns < x1) & (rows > y0) & (rows < y1)
        edge = on & ((columns < x0 + CELL) | (columns > x1 - CELL) | (rows < y0 + CELL) | (rows > y1 - CELL))
        tops = np.where(on, np.maximum(tops, z1), tops)
        lowest = np.where(on, np.minimum(lowest, np.where(edge, z0, z1)), lowest)
    cells = np.argwhere(tops.T > 0).astype(np.int32)
    at = cells[:, 1], cells[:, 0]
    longer, shorter = max(size), min(size)
    facts = {"color_share": 0.95, "color_start": 0.15, "spread": 2.0} | known
    return Outline(
        cells, tops[at], lowest[at], float(np.quantile(tops[at], 0.9)), longer, shorter, False, color, **facts
    )


@pytest.mark.parametrize(
    "form, shape",
    [
        (outline((0, 0, 0.43, 0.5, 0.5, 0.48), (0, 0.4, 0.48, 0.5, 0.5, 0.92), color="blue"), "chair"),
        (outline((0, 0, 0.4, 0.5, 0.5, 1.3), color="green", color_start=0.4), "plant"),
        (outline((0, 0, 0.12, 0.5, 0.5, 1.3), color="green"), "object"),
        (outline((0, 0, 0.12, 2, 0.85, 0.42), (0, 0, 0.42, 2, 0.25, 0.8), color="green", color_start=0.12), "sofa"),
        (outline((0, 0, 0.7, 1.5, 0.7, 0.74), (1.1, 0, 0.12, 1.5, 0.7, 0.7)), "desk"),
        (outline((0, 0, 0.7, 1.5, 0.8, 0.74)), "table"),
        (outline((0, 0, 0.36, 1.1, 0.6, 0.4)), "low table"),
        (outline((0, 0, 0.12, 1.0, 0.45, 1.1)), "cabinet"),
        (outline((0, 0, 0.12, 1.2, 0.35, 0.85), color_share=0.45, spread=10.0), "bookshelf"),
        (outline((0, 0, 0.12, 0.8, 0.45, 0.6)), "box"),
        (outline((0, 0, 0.12, 1.8, 1.0, 0.15)), "platform"),
        (outline((0, 0, 0.12, 1.5, 0.5, 1.8), color="red"), "tall"),
        (outline((0, 0, 0.12, 0.5, 0.5, 0.9), color="red"), "object"),
    ],
)
def test_the_form_of_an_object_has_a_name_only_if_it_is_clear(form: Outline, shape: str) -> None:
    assert shape_of(form) == shape


def alternatives(pattern: str) -> list[str]:
    """All texts of a pattern, each once."""
    before, opened, after = pattern.partition("[")
    if not opened:
        return [pattern]
    depth, ends = 1, [-1]
    for i, letter in enumerate(after):
        depth += (letter == "[") - (letter == "]")
        if depth == 0 or (depth == 1 and letter == "|"):
            ends.append(i)
        if depth == 0:
            break
    parts = [text for start, end in pairwise(ends) for text in alternatives(after[start + 1 : end])]
    rest = alternatives(after[ends[-1] + 1 :])
    return list(dict.fromkeys(before + part + text for part in parts for text in rest))


NAMES = {name: f"{color} {shape}" for shape, pattern in THINGS.items() for name_of in alternatives(pattern)
         for color in (COLORS if "{}" in name_of else (IMPLIED.get(shape, ""),))
         for name in [name_of.format(color)]}  # fmt: skip
NAMED = re.compile(rf"\bthe ({'|'.join(sorted(map(re.escape, NAMES), key=len, reverse=True))})\b")
Table = Mapping[str, str | Sequence[str]]


@cache
def compiled(pattern: str) -> re.Pattern[str]:
    """Matches all texts of a pattern. Names of objects are in the form <red_sofa>."""
    words = pattern.replace(".", r"\.").replace("[", "(?:").replace("]", ")")
    return re.compile(r"\b(?:" + re.sub(r"\{\d?\}", "<?([a-z_-]+)>?", words) + r")(?![a-z])", re.IGNORECASE)


def cues_in(text: str, tables: Sequence[tuple[str, Table]]) -> set[Cue]:
    """The cues of all phrases in a text, the longest first. A row has a kind, and sides or facts -> phrases."""
    text = NAMED.sub(lambda match: f"the <{NAMES[match[1]].replace(' ', '_')}>", text)
    like = {"wood": "wooden", "tiles": "tiled"}
    found: list[tuple[int, int, Cue]] = []
    for kind, table in tables:
        for key, phrases in table.items():
            for pattern in alternatives(phrases) if kind == "floor" else [joined(phrases)]:
                for match in compiled(pattern).finditer(text):
                    words = [word.replace("_", " ") for word in match.groups() if word is not None]
                    what = " to ".join(like.get(word, word) for word in words) if kind == "floor" else "".join(words)
                    cue = Cue(kind, what, key) if kind in ("past", "by", "towards", "floor") else Cue(kind, key)
                    found.append((*match.span(), Cue("rug", f"{key} {what} rug") if kind == "rug" else cue))
    cues: set[Cue] = set()
    taken: list[tuple[int, int]] = []
    for start, end, cue in sorted(found, key=lambda one: one[0] - one[1]):
        if (start, end) in taken or all(end <= first or start >= last for first, last in taken):
            taken.append((start, end))
            cues.add(cue)
    return cues


def joined(phrases: str | Sequence[str]) -> str:
    return phrases if isinstance(phrases, str) else f"[{'|'.join(phrases)}]"


def rugged(table: Table) -> dict[str, str]:
    """The phrases with a name that has two words, such as "green rug"."""
    return {key: joined(phrases).replace("{}", "(?:{} rug)") for key, phrases in table.items()}


def spread(table: Mapping[str, str]) -> dict[str, list[str]]:
    return {key: alternatives(pattern) for key, pattern in table.items()}


def some_cues(random: Random, sides: Sequence[str]) -> set[Cue]:
    def look() -> str:
        shape = random.choice(list(THINGS))
        return f"{IMPLIED.get(shape) or random.choice(COLORS)} {shape}"

    cues = {Cue("through", "1"), Cue("into", random.choice(list(INTO))), Cue("out of", random.choice(list(OUT_OF)))}
    cues = {cue for cue in cues if random.random() < 0.7}
    cues |= {Cue("through", "1")} if cues else set()
    cues |= {Cue("past", look(), random.choice(sides))} if random.random() < 0.5 else set()
    cues |= {Cue("by", look(), random.choice([*sides, "ahead"]))} if random.random() < 0.5 else set()
    if random.random() < 0.3:
        cues.add(random.choice([Cue("floor", "wooden to tiled"), Cue("rug", f"{random.choice(list(RUG))} green rug")]))
    return cues


DETAILED = [
    *(("past", PAST), ("by", BY), ("by", STOP_BY), ("towards", {"": TOWARDS}), ("through", THROUGH), ("into", INTO)),
    *(
        ("out of", OUT_OF),
        ("along", ALONG),
        ("stairs", STAIRS),
        ("to stairs", TO_STAIRS),
        ("floor", {"": joined(FLOOR)}),
    ),
    ("rug", rugged(RUG)),
]


def test_every_cue_can_be_read_back_from_the_detailed_words() -> None:
    random = Random(3)
    for _ in range(120):
        cues = some_cues(random, ("left", "right"))
        cues |= {Cue("stairs", random.choice(list(STAIRS)))} if random.random() < 0.3 else set()
        cues |= {Cue("to stairs", random.choice(list(TO_STAIRS)))} if random.random() < 0.3 else set()
        text = cue_words(sorted(cues), WordChoice(random))
        assert cues_in(text, DETAILED) == cues, text
        end = Cue("by", "red sofa", random.choice(list(STOP_BY)))
        assert cues_in(stop_words(end, WordChoice(random)), DETAILED) == {end}


def read_short(text: str) -> set[Cue]:
    tables: list[tuple[str, Table]] = [("past", short.PASSING), ("past", short.PAST), ("by", short.UNTIL)]
    tables += [("by", short.STOP_BY), ("by", {"": short.WALK_TO}), ("by", {"": short.AT}), ("walk", short.WALKS)]
    tables += [("towards", {"": short.TOWARDS}), ("stairs", short.STAIRS), ("to stairs", short.TO_STAIRS)]
    cues = cues_in(text, [*tables, ("floor", {"": short.FLOOR}), ("rug", rugged(short.RUG))])
    walks = {cue.subject for cue in cues if cue.kind == "walk"}
    found = {cue for cue in cues if cue.kind != "walk"}
    for walk in walks & {"1", "2"}:
        found.add(Cue("through", walk))
    for walk in walks & {"room", "corridor"}:
        found.add(Cue("along", walk))
    for walk in (walk for walk in walks if walk.startswith(("out ", "into ")) or " to " in walk):
        out, _, into = walk.partition(" to ") if " to " in walk else (walk[4:], "", "")
        out, into = ("", walk[5:]) if walk.startswith("into ") else (out, into)
        found |= {Cue("through", "1"), *([Cue("out of", out)] if out else []), *([Cue("into", into)] if into else [])}
    return found


@pytest.mark.parametrize("ends", [True, False])
def test_every_cue_can_be_read_back_from_the_short_words(ends: bool) -> None:
    random = Random(4)
    for _ in range(200):
        cues = some_cues(random, ("", "left", "right"))
        if {Cue("out of", "corridor"), Cue("into", "corridor")} <= cues:
            cues.remove(Cue("into", "corridor"))  # a doorway between two corridors is said to lead out of one
        if not any(cue.kind in ("through", "rug", "floor") for cue in cues):
            cues.add(random.choice([Cue("along", "corridor"), Cue("along", "room"), Cue("towards", "blue desk")]))
        legs = [Leg(0.0, None, "level", frozenset(cues)), Leg(math.pi / 2, None, "level")]
        text = short_instruction(legs[:1] if ends else legs, "words", random)
        by = {cue for cue in cues if cue.kind == "by"}
        found = read_short(text)
        loose = {replace(cue, side="") for cue in by if cue.side == "ahead"} if ends else set()
        assert found - by in (cues - by, (cues - by) | loose) and (by <= found or loose <= found), text


def test_no_short_phrase_has_two_meanings() -> None:
    tables = [TURNS, short.WALKS, {str(meters): words for meters, words in short.ROUGHLY.items()}]
    tables += [short.PASSING, short.UNTIL, short.STOP_BY, short.TO_STAIRS, short.STAIRS, short.RUG]
    meanings: dict[str, set[tuple[int, str]]] = {}
    for i, table in enumerate(tables):
        for key, phrases in spread(table).items():
            for phrase in phrases:
                meanings.setdefault(phrase, set()).add((i, key))
    assert not {phrase: found for phrase, found in meanings.items() if len(found) > 1}
    assert len(NAMES) == len({(name, look) for name, look in NAMES.items()})
    for shape, pattern in THINGS.items():
        for name in alternatives(pattern):
            assert NAMES[name.format("red") if "{}" in name else name].endswith(shape)


def test_an_object_behind_a_doorway_is_not_in_front_of_one_who_has_not_gone_through(tmp_path: Path) -> None:
    """The opening is too wide to be called a doorway, but the lintel above it still parts the rooms."""
    blocks, graph = flat_house(door=1.58)
    blocks.append(Block((5.75, 0.5, 0), (6.35, 1.1, 1.0), BLUE))
    root = export_blocks(tmp_path, blocks, graph)
    seen = surroundings_of(graph, list(layers_of(list(views_from_viewpoints(root, graph)), graph)))
    (behind,) = [i for i, thing in enumerate(seen.things) if thing.middle[0] > 5.2]
    assert behind in {i for i, _, _ in seen.visible["g"]}
    assert behind not in {i for i, _, _ in seen.visible["c"]}
    assert not [
        cue
        for cue in cues_along("bc", math.radians(90), seen)
        if cue.subject.startswith("blue") and cue.side == "ahead"
    ]


def test_one_name_stands_for_one_object_of_an_instruction() -> None:
    looks: list[tuple[str, Shape]] = [("red", "sofa"), ("blue", "chair"), ("red", "sofa")]
    things = tuple(FloorObject(*look, np.zeros((1, 2)), np.zeros((1, 3)), 0.8, (2.0, 0.8)) for look in looks)
    steps = [("a", "b"), ("b", "c")]
    seen = Surroundings(
        things,
        visible={"a": (), "b": ((0, 0.0, 2.0),), "c": ((2, 0.0, 1.0),)},
        passed={("a", "b"): ((0, "left", 1.0), (1, "right", 1.0)), ("b", "c"): ((1, "right", 0.5), (2, "left", 1.0))},
        meters=dict.fromkeys(steps, 2.0),
        doors=dict.fromkeys(steps, ()),
        floors=dict.fromkeys(steps, ()),
    )
    # Two red sofas along one leg have no name of their own; the blue chair is one.
    assert {(cue.subject, cue.object_index) for cue in cues_along("abc", 0.0, seen) if cue.kind == "past"} == {
        ("blue chair", 1)
    }
    first, second = cues_along("ab", 0.0, seen), cues_along("bc", 0.0, seen)
    assert Cue("past", "red sofa", "left") in first
    legs = with_one_name_each([Leg(0.0, 2.0, "level", first), Leg(0.5, 2.0, "level", second)])
    assert {cue.object_index for leg in legs for cue in leg.cues if cue.subject == "red sofa"} == {0}
