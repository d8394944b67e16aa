"""What stands around is found where it stands, in its colour, and nothing else; and instructions say it."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from random import Random

import numpy as np
import pytest
from boxed_scan import BLUE, BROWN, GREY, RED, WALL, export_blocks, flat_house

from nvsim.graph.types import NavGraph
from nvsim.graph.ways import Ways
from nvsim.r2r.instructions.cues import Cue, cues_along
from nvsim.r2r.instructions.generating import follow, instruct
from nvsim.r2r.instructions.ground import Ground, Leg
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
    THINGS,
    THROUGH,
    TO_STAIRS,
    cue_words,
    stop_words,
)
from nvsim.r2r.surroundings.colour_names import COLOURS, NAMELESS, lab_of, names_of
from nvsim.r2r.surroundings.layers import layers_of
from nvsim.r2r.surroundings.seen import look_around
from nvsim.r2r.surroundings.survey import Surroundings, surroundings_of
from nvsim.r2r.tasks.shortest import Bounds
from nvsim.r2r.tasks.splitting import SPLITS, Amounts, sample_tasks

Seen = tuple[NavGraph, Surroundings]


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    blocks, graph = flat_house()
    root = export_blocks(tmp_path_factory.mktemp("scans"), blocks, graph)
    return graph, surroundings_of(graph, list(layers_of(list(look_around(root, graph)), graph)))


@pytest.mark.parametrize(
    "rgb, name",
    [(BLUE, "blue"), (RED, "red"), (BROWN, "brown"), (GREY, "grey"), (WALL, "white"), ((60, 110, 50), "green")],
)
def test_colours_have_the_names_that_people_give_them(rgb: tuple[int, int, int], name: str) -> None:
    assert COLOURS[int(names_of(lab_of(np.array(rgb, float))))] == name


@pytest.mark.parametrize("rgb", [(150, 75, 55), (180, 182, 190), (122, 122, 104), (70, 70, 74)])
def test_a_colour_between_two_names_has_none(rgb: tuple[int, int, int]) -> None:
    assert int(names_of(lab_of(np.array(rgb, float)))) == NAMELESS


def test_things_are_found_in_their_colour_and_shape_and_nothing_else(house: Seen) -> None:
    things = {thing.look: thing for thing in house[1].things}
    assert set(things) == {("blue", "sofa"), ("red", "tall")} and len(house[1].things) == 2
    sofa, cabinet = things["blue", "sofa"], things["red", "tall"]
    assert sofa.middle == pytest.approx((2.2, 4.4), abs=0.15) and sofa.top == pytest.approx(0.82, abs=0.06)
    assert cabinet.middle == pytest.approx((4.6, 3.35), abs=0.25) and cabinet.top == pytest.approx(1.8, abs=0.06)


def test_doorways_rooms_and_corridors_are_where_they_are(house: Seen) -> None:
    graph, seen = house
    assert {pair for pair, metres in seen.doors.items() if metres} == {("c", "f"), ("f", "c")}
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


def test_one_who_leaves_the_room_goes_from_brown_to_grey_through_the_door(house: Seen) -> None:
    cues = cues_along("bcfg", math.radians(90), house[1])
    assert {Cue("through", "1"), Cue("into", "corridor"), Cue("floor", "brown to grey")} <= cues
    assert Cue("along", "corridor") in cues_along("gh", math.radians(90), house[1])
    assert not [cue for cue in cues_along("ab", math.radians(90), house[1]) if cue.kind in ("floor", "through")]


def test_sight_tells_apart_what_turns_and_metres_do_not(house: Seen) -> None:
    graph, seen = house
    ways = Ways.of(graph)
    plain, seeing = Ground(ways), Ground(ways, seen)
    rows = [seeing.row[id] for id in "bcfg"]
    somehow = Leg(0.0, None, "level")
    assert follow(plain, rows[0], math.radians(90), [somehow]) is None  # it may end anywhere
    said = [Leg(0.0, None, "level", frozenset([Cue("through", "1"), Cue("into", "corridor")]))]
    found = follow(seeing, rows[0], math.radians(90), said)
    assert found is None or found[:3] == rows[:3]
    ends = [Leg(0.0, 5.5, "level", frozenset([Cue("through", "1")]))]
    assert follow(seeing, rows[0], math.radians(90), ends) == rows
    nowhere = [Leg(0.0, 5.5, "level", frozenset([Cue("past", "green sofa", "left")]))]
    assert follow(seeing, rows[0], math.radians(90), nowhere) == rows  # the best there is


def test_instructions_name_what_is_seen_and_are_followed_again(house: Seen) -> None:
    graph, seen = house
    dataset = sample_tasks([graph], (), Bounds(fewest_edges=2, least_metres=3), Amounts(30, 2, 0, unseen_share=0.01))
    told = instruct(dataset, [graph], 3, 0, {graph.scan: seen})
    assert told.paths > 15 and len(told.found) >= 0.9 * told.paths
    texts = [text for name in SPLITS for task in told.dataset.splits[name] for text in task.instructions]
    assert sum("door" in text for text in texts) > 5 and any("sofa" in text or "couch" in text for text in texts)
    again = instruct(dataset, [graph], 3, 0, {graph.scan: seen})
    assert [task.instructions for task in again.dataset.splits["train"]] == [
        task.instructions for task in told.dataset.splits["train"]
    ]
    for task in (task for name in SPLITS for task in told.dataset.splits[name]):
        if any("door" in text for text in task.instructions):
            assert {"c", "f"} <= set(task.path)


def read(text: str) -> set[Cue]:
    """The cues that one understands who knows the phrases."""
    names = {phrase.format(colour): f"{colour} {shape}"
             for shape, phrases in THINGS.items() for phrase in phrases for colour in COLOURS}  # fmt: skip
    found = set()
    for kind, table in (("past", PAST), ("by", BY), ("by", STOP_BY)):
        for side, phrases in table.items():
            for phrase in phrases:
                found |= {Cue(kind, look, side) for name, look in names.items() if phrase.format(name) in text}
    for kind, table in (("through", THROUGH), ("out of", OUT_OF), ("into", INTO)):
        for what, phrases in table.items():
            if any(re.search(re.escape(phrase) + r"\b", text) for phrase in phrases):
                found.add(Cue(kind, what))
    if any(phrase in text for phrase in ALONG):
        found.add(Cue("along", "corridor"))
    like = {"wood": "wooden", "tiles": "tiled"}
    for phrase in FLOOR:
        words = re.sub(r"\\{\d\\}", "([a-z]+)", re.escape(phrase))
        found |= {Cue("floor", " to ".join(like.get(w, w) for w in match)) for match in re.findall(words, text)}
    for how, phrases in RUG.items():
        for phrase in phrases:
            found |= {Cue("rug", f"{how} {rug}") for rug in re.findall(phrase.format("([a-z]+ rug)"), text)}
    for kind, table in (("stairs", STAIRS), ("to stairs", TO_STAIRS)):
        for what, phrases in table.items():
            if any(re.search(rf"\b{phrase}(?! of)\b", text) for phrase in phrases):
                found.add(Cue(kind, what))
    return found


def test_every_cue_can_be_read_back_from_the_words() -> None:
    random = Random(3)

    def choose(phrases: Sequence[str], random: Random) -> str:
        return random.choice(phrases)

    def look() -> str:
        return f"{random.choice(COLOURS)} {random.choice(list(THINGS))}"

    for _ in range(120):
        cues = {Cue("through", "1"), Cue("into", random.choice(list(INTO))), Cue("out of", random.choice(list(OUT_OF)))}
        cues = {cue for cue in cues if random.random() < 0.7}
        cues |= {Cue("through", "1")} if cues else set()
        cues |= {Cue("past", look(), random.choice(list(PAST)))} if random.random() < 0.5 else set()
        cues |= {Cue("by", look(), random.choice(list(BY)))} if random.random() < 0.5 else set()
        cues |= {Cue("floor", random.choice(["brown to grey", "wooden to tiled"]))} if random.random() < 0.3 else set()
        cues |= {Cue("rug", f"{random.choice(list(RUG))} green rug")} if random.random() < 0.3 else set()
        cues |= {Cue("stairs", random.choice(list(STAIRS)))} if random.random() < 0.3 else set()
        cues |= {Cue("to stairs", random.choice(list(TO_STAIRS)))} if random.random() < 0.3 else set()
        text = cue_words(sorted(cues), choose, random)
        assert read(text) == cues, text
        end = Cue("by", look(), random.choice(list(STOP_BY)))
        assert read(stop_words(end, choose, random)) == {end}
