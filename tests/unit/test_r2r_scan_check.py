"""The self-check of a scan finds what is wrong, and nothing where all is well."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from scan_samples import IDS, scan_project

from nvsim.errors import InputError
from nvsim.evaluation.scan import edges_out_of_reach, evaluate_scan
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.project.project import Project
from nvsim.r2r.observations.export import export_scan
from nvsim.r2r.observations.layout import ScanPlaces, ScanSettings


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    return scan_project(tmp_path_factory.mktemp("project"))


@pytest.fixture(scope="module")
def whole(project, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("whole") / "scans"
    with Project.open(project) as opened:
        export_scan(opened, out, settings=ScanSettings(size=256, plans=False))
    return out


@pytest.fixture
def scan(whole, tmp_path) -> ScanPlaces:
    shutil.copytree(whole, tmp_path / "scans")
    return ScanPlaces(tmp_path / "scans", "hall")


def sign_again(places: ScanPlaces, path: Path) -> None:
    """Updates the manifest to the current file, as if the export had written it."""
    import hashlib

    manifest, data = json.loads(places.manifest.read_text()), path.read_bytes()
    name = path.relative_to(places.root).as_posix()
    for part in manifest["parts"].values():
        if name in part["files"]:
            part["files"][name] = {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    places.manifest.write_text(json.dumps(manifest))


def test_a_scan_as_it_was_exported_is_well(whole, project):
    done = subprocess.run([sys.executable, "-m", "nvsim", "evaluate", "scan", whole, "--json"], capture_output=True, check=False)  # fmt: skip # noqa: E501
    found = json.loads(done.stdout)
    assert done.returncode == 0 and found["problems"] == [] and found["viewpoints"] == 4 and found["edges"] == 4
    assert found["direction_deg"] < 0.5 and found["edges_out_of_reach"] == 0
    assert found["step_over_borders"] < 1.1 * found["step_beside"]


def test_a_strip_whose_faces_are_in_another_order_is_far_from_direct_views(scan, project):
    for id in IDS[:4]:
        path = scan.skyboxes.strip(id)
        strip = cv2.imread(str(path))
        cv2.imwrite(str(path), np.roll(strip, 256, axis=1))
        sign_again(scan, path)
    with Project.open(project) as opened:
        found = evaluate_scan(scan.root, project=opened, views=6)
    assert found["psnr_live_median"] < 25 and any("live renders" in problem for problem in found["problems"])
    assert any("seams" in problem for problem in found["problems"])


def test_a_changed_and_a_missing_file_are_named(scan):
    scan.skyboxes.depth(IDS[1]).unlink()
    data = bytearray(scan.skyboxes.strip(IDS[0]).read_bytes())
    data[len(data) // 2] ^= 1
    scan.skyboxes.strip(IDS[0]).write_bytes(data)
    problems = evaluate_scan(scan.root)["problems"]
    assert any(scan.skyboxes.depth(IDS[1]).name in p for p in problems)
    assert any(scan.skyboxes.strip(IDS[0]).name in p and "does not match the manifest" in p for p in problems)


def test_depth_of_8_bits_is_found(scan):
    path = scan.skyboxes.depth(IDS[2])
    cv2.imwrite(str(path), (cv2.imread(str(path), cv2.IMREAD_UNCHANGED) // 256).astype(np.uint8))
    sign_again(scan, path)
    assert any("16 bits" in problem for problem in evaluate_scan(scan.root)["problems"])


def test_a_scan_that_the_list_does_not_name_is_found(scan):
    scan.scans.write_text("other\n")
    assert any("does not list hall" in problem for problem in evaluate_scan(scan.root)["problems"])


def test_an_unfinished_export_and_other_folders_are_refused(scan, tmp_path):
    scan.journal.write_text("")
    with pytest.raises(InputError, match="not finished"):
        evaluate_scan(scan.root)
    with pytest.raises(InputError, match="contains no scan"):
        evaluate_scan(tmp_path)
    scan.manifest.write_text('{"format": 1, "parts": {"x": 3}, "settings": {}}')
    scan.journal.unlink()
    with pytest.raises(InputError, match="damaged"):
        evaluate_scan(scan.root)


def test_only_edges_straight_up_are_out_of_reach():
    places = {"a": (0.0, 0.0, 1.5), "b": (0.0, 0.0, 4.5), "c": (0.4, -2.0, 3.0)}
    graph = NavGraph(
        "stair",
        {id: Viewpoint(id, place) for id, place in places.items()},
        {("a", "b"): edge("a", "b"), ("a", "c"): edge("a", "c"), ("b", "c"): edge("b", "c")},
    )
    assert edges_out_of_reach(graph) == [("a", "b"), ("b", "a")]
