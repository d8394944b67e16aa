"""Evidence of more than alpha and normals: stored where it was measured, and old evidence reads as it did."""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nvsim.errors import InputError
from nvsim.graph.store import (
    decode_evidence,
    decode_graph,
    encode_evidence,
    encode_graph,
    same_evidence,
    same_graph,
)
from nvsim.graph.types import Evidence, NavGraph, SecondOpinion, Viewpoint
from nvsim.project.project import Project

SHAPE = (5, 7)
ID = "a" * 32


def plane(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, SHAPE, np.uint8)


PLAIN = Evidence(ID, 3, 0.1, 2.5, plane(0), plane(1), plane(2) > 99, 0.05, 0.1, 0.9, 1, (1 / 3, -2.0), "b" * 32, "open")
some = st.booleans()
OPTIONAL = ("reach", "mass", "network_up")


@st.composite
def evidences(draw: st.DrawFn) -> Evidence:
    own = {name: plane(i) for i, name in enumerate(OPTIONAL, 3) if draw(some)}
    extra = {name: plane(i) for i, name in enumerate(OPTIONAL, 6) if draw(some)}
    second = SecondOpinion(4, plane(9), plane(10), **extra) if draw(some) else None
    return replace(PLAIN, second=second, views=draw(st.sampled_from(["pitched", "panorama"])), **own)


@given(evidences())
def test_what_was_measured_comes_back_and_nothing_else(found: Evidence) -> None:
    blob = encode_evidence(found)
    back = decode_evidence(blob)
    assert same_evidence(back, found) and encode_evidence(replace(back)) == blob
    told = [found, *([found.second] if found.second else [])]
    later = found.views == "panorama" or any(one.network_up is not None for one in told)
    plain = found.reach is found.mass is found.second is None
    assert blob[0] == (3 if later else 1 if plain else 2), "programs from before refuse what they cannot hold"
    graph = NavGraph("scan", {ID: Viewpoint(ID, (0, 0, 1))}, {}, {found.key: found})
    assert same_graph(decode_graph(encode_graph(graph)), graph)


def test_every_plane_counts_when_evidence_is_compared() -> None:
    whole = replace(PLAIN, reach=plane(3), mass=plane(4), second=SecondOpinion(4, plane(5), plane(6), plane(7)))
    assert whole.second is not None
    others = [replace(whole, reach=None), replace(whole, mass=plane(9)), replace(whole, second=None)]
    others += [replace(whole, views="panorama"), replace(whole, network_up=plane(9))]
    others += [replace(whole, second=replace(whole.second, **change))
               for change in ({"submap": 5}, {"up": plane(9)}, {"reach": None})]  # fmt: skip
    assert same_evidence(whole, replace(whole)) and not any(same_evidence(whole, other) for other in others)


def old_blob() -> bytes:
    """As version 1 wrote it."""
    header = {"viewpoint": ID, "direction": 3, "heading": 0.1, "length": 2.5, "near": 0.05, "depth": 0.1, "width": 0.9,
              "submap": 1, "target": [1 / 3, -2.0], "joins": "b" * 32, "decision": "open", "stale": False,
              "shape": list(SHAPE)}  # fmt: skip
    text = json.dumps(header, separators=(",", ":")).encode()
    cells = PLAIN.alpha.tobytes() + PLAIN.up.tobytes() + np.packbits(PLAIN.support).tobytes()
    return struct.pack("<BI", 1, len(text)) + text + zlib.compress(cells, 6)


def test_old_evidence_reads_as_it_did_and_plain_evidence_is_written_so() -> None:
    assert same_evidence(decode_evidence(old_blob()), PLAIN) and encode_evidence(PLAIN) == old_blob()


@pytest.mark.parametrize(
    "change",
    [
        {"planes": ["mass", "reach"]},
        {"planes": ["reach", "reach"]},
        {"planes": "reach"},
        {"planes": ["alpha"]},
        {"second": [1]},
        {"second": ["x", []]},
        {"second": [True, []]},
        {"reach": "text"},
        {"planes": ["network_up", "mass"]},
        {"views": "fisheye"},
        {"views": "pitched"},
        {"views": 1},
    ],
)
def test_headers_that_are_none_of_ours_are_refused(change: dict[str, object]) -> None:
    size = struct.unpack_from("<BI", old_blob())[1]
    header = json.loads(old_blob()[5 : 5 + size]) | change
    text = json.dumps(header).encode()
    many = zlib.compress(bytes(1000))
    for cells in (old_blob()[5 + size :], many, zlib.compress(bytes(4 * 35 + 5)), zlib.compress(bytes(3 * 35 + 5))):
        with pytest.raises(InputError, match="damaged"):
            decode_evidence(struct.pack("<BI", 2, len(text)) + text + cells)


def test_a_project_keeps_what_was_measured(tmp_path: Path) -> None:
    whole = replace(PLAIN, joins="", reach=plane(3), second=SecondOpinion(4, plane(5), plane(6), plane(7)))
    graph = NavGraph("scan", {ID: Viewpoint(ID, (0, 0, 1))}, {}, {whole.key: whole})
    with Project.create_or_open(tmp_path / "p.nvsim") as project:
        project.set_graph(graph)
    with Project.open(tmp_path / "p.nvsim") as project:
        found = project.graph()
    assert found is not None and same_evidence(found.evidence[whole.key], whole)
