"""The release: one version everywhere, complete metadata, licenses of all files, and absolute links for an index."""

from __future__ import annotations

import importlib.util
import re
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import nvsim

ROOT = Path(__file__).parents[2]
ADDRESS = "https://example.org/nvsim/blob/v1"


@pytest.fixture(scope="module")
def release() -> ModuleType:
    spec = importlib.util.spec_from_file_location("release", ROOT / "packaging" / "release.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_the_newest_section_of_the_changelog_is_the_version_of_the_package(project: dict[str, Any]) -> None:
    sections = re.findall(r"^## \[([\d.]+)\] - \d{4}-\d\d-\d\d$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert sections[0] == project["version"] == nvsim.__version__
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"version: {nvsim.__version__}" in citation


def test_the_readme_of_a_release_has_absolute_links_only(release: ModuleType) -> None:
    readme = (ROOT / "README.md").read_text()
    links = re.findall(r"\]\(([^)]+)\)", release.absolute(readme, ADDRESS))
    assert len(links) == len(re.findall(r"\]\(", readme)) > 20
    assert all(link.startswith("https://") for link in links)
    for link in links:
        if link.startswith(ADDRESS):
            assert (ROOT / link.removeprefix(ADDRESS + "/").partition("#")[0].partition("?")[0]).exists()


def test_the_metadata_of_a_release_name_its_addresses(release: ModuleType, project: dict[str, Any]) -> None:
    text = (
        (ROOT / "pyproject.toml").read_text().replace("[project.scripts]", release.urls(ADDRESS) + "[project.scripts]")
    )
    urls = tomllib.loads(text)["project"]["urls"]
    assert {"Source", "Documentation", "Changelog"} == urls.keys()
    assert all(url.startswith(ADDRESS) for url in urls.values())
    assert project["authors"] and project["description"] and project["keywords"]
    assert any("3.13" in line for line in project["classifiers"])


def test_every_bundled_file_has_a_license(project: dict[str, Any]) -> None:
    page = (ROOT / "resources/licenses/README.md").read_text()
    rows = re.findall(r"^\| `resources/([^`]+)`.*\| ([\w.-]+) \|$", page, re.MULTILINE)
    resources = ROOT / "resources"
    folders = [path for path in (*resources.iterdir(), *(resources / "nvsim_resources").iterdir()) if path.is_dir()]
    bundled = {str(path.relative_to(resources)) for path in folders if not path.is_symlink()}
    named = {"/".join(place.split("/")[: 1 + place.startswith("nvsim_resources/")]) for place, _ in rows}
    assert named == {place for place in bundled if place != "nvsim_resources" and not place.endswith("__pycache__")}
    assert {name for _, name in rows} == set(project["license"].split(" AND ")) == {"MIT", "Apache-2.0"}
    assert len((ROOT / "resources/licenses/Apache-2.0.txt").read_text().splitlines()) > 170
