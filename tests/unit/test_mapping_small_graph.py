"""The sentence about a capture that gives too little of a graph."""

from __future__ import annotations

import numpy as np
import pytest

from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import DECISIONS
from nvsim.mapping.explanation.poor_graph import explain_no_viewpoint, explain_small_graph

LINE = np.stack([np.arange(10.0), np.zeros(10)], axis=1)


def report(viewpoints: int, edges: int, **decisions: int) -> dict[str, object]:
    return {"viewpoints": viewpoints, "edges": edges, "decisions": decisions}


def test_a_graph_along_the_whole_trajectory_is_fine() -> None:
    assert explain_small_graph(report(8, 12, open=24, alpha=70), LINE[:2], 10) == ""


def test_it_says_how_little_where_why_and_what_to_do() -> None:
    sentence = explain_small_graph(report(1, 0, open=2, unknown=9, alpha=4), LINE[2:], 10)
    assert sentence.startswith("The capture gives only 1 viewpoint and 0 edges, and 8 of 10 positions")
    assert "9 of 15 directions fail because no image and no LiDAR scan shows floor" in sentence
    assert "photograph the floor there" in sentence and sentence.count(".\n") == 0 and sentence.endswith(".")


def test_much_of_the_trajectory_without_a_viewpoint_is_too_little_and_its_midst_is_named() -> None:
    sentence = explain_small_graph(report(9, 14, open=20, alpha=50), np.concatenate([LINE[4:9], LINE[:1] - 30]), 12)
    assert "around x 5.0" in sentence or "around x 6.0" in sentence or "around x 7.0" in sentence
    assert DECISIONS["alpha"].remedy in sentence


def test_free_corridors_that_settling_left_out_are_no_refusals() -> None:
    sentence = explain_small_graph(report(2, 1, open=2, served=9, spare=8, alpha=4), LINE[2:], 10)
    assert "4 of 23 directions fail because an obstacle is" in sentence


def test_nothing_refused_and_nothing_found_is_a_sentence_too() -> None:
    assert explain_small_graph(report(1, 0), LINE[:0], 1).endswith("photograph more of it.")


@pytest.mark.parametrize("word", sorted(DECISIONS))
def test_every_decision_has_a_remedy_that_ends_a_sentence(word: str) -> None:
    assert DECISIONS[word].remedy and not DECISIONS[word].remedy.endswith(".")


def test_where_nobody_can_stand_it_says_what_is_in_the_way() -> None:
    sentence = explain_no_viewpoint([(0.31, 1.0), (0.22, 0.9), (0.05, 0.2)], MappingConfig())
    assert (
        "3 positions" in sentence
        and "2 have an obstacle on the floor (mean alpha at least 0.22, free below 0.2)" in sentence
    )
    assert "too little known floor" in explain_no_viewpoint([(0.31, 1.0), (0.05, 0.2), (0.1, 0.1)], MappingConfig())
    assert explain_no_viewpoint([], MappingConfig()).endswith(".")
