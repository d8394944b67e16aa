"""Writes the files of a release: `python packaging/release.py ADDRESS FOLDER` copies the sources into FOLDER and adds
the ADDRESS of the published repository, such as https://example.org/nvsim/blob/v0.2.0. `pip wheel FOLDER` builds it.

A package index shows the README without the repository. Its links and images become absolute, and the metadata gets
the addresses of the documentation, the changelog, and the sources.
"""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ("nvsim", "app", "resources", "pyproject.toml", "README.md", "LICENSE")
LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:)([^)]+)\)")


def absolute(markdown: str, address: str) -> str:
    """`markdown` with absolute links. `address` is that of the top folder of the repository as pages; images need the
    raw file, which forges serve with `?raw=true`."""
    return LINK.sub(lambda m: f"{m[1]}[{m[2]}]({address}/{m[3]}{'?raw=true' if m[1] else ''})", markdown)


def urls(address: str) -> str:
    """The table of addresses for pyproject.toml."""
    pages = {"Source": "", "Documentation": "/README.md", "Changelog": "/CHANGELOG.md"}
    return "\n".join(["[project.urls]", *(f'{name} = "{address}{page}"' for name, page in pages.items()), "", ""])


def write_release(address: str, folder: Path) -> None:
    """Copies the sources to the new `folder`, with absolute links."""
    folder.mkdir(parents=True)
    for name in SOURCES:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, folder / name)
    readme, project = folder / "README.md", folder / "pyproject.toml"
    readme.write_text(absolute(readme.read_text(), address))
    project.write_text(project.read_text().replace("[project.scripts]", urls(address) + "[project.scripts]"))


if __name__ == "__main__":
    write_release(sys.argv[1].rstrip("/"), Path(sys.argv[2]))
