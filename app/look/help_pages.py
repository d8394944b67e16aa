"""The help pages of resources/help and the page resources/docs/window.md: titles, sections, and search. Does not use
Qt."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import resources
from nvsim.capture import formats

FOLDER = Path(resources.__file__).parent / "help"
DOCS = FOLDER.parent / "docs"  # contains images, too
_ORDER = ("start", "window", "keys", "view", "inspector", "thresholds", "frames")  # others follow by title


@dataclass(frozen=True)
class Section:
    """A heading of a page and the Markdown under it."""

    page: str
    title: str
    text: str


@dataclass(frozen=True)
class Page:
    """A help page. name: the file name without suffix. title: the first heading."""

    name: str
    title: str
    text: str
    sections: tuple[Section, ...]


@cache
def pages() -> tuple[Page, ...]:
    """All pages in reading order."""
    found = [_page(path) for path in (*FOLDER.glob("*.md"), DOCS / "window.md")]
    known = {name: i for i, name in enumerate(_ORDER)}
    return tuple(sorted(found, key=lambda p: (known.get(p.name, len(known)), p.title)))


def find(words: str) -> list[Section]:
    """Sections that contain all words, first those with one of the words in the heading."""
    wanted = words.casefold().split()
    if not wanted:
        return []
    hits = []
    for page in pages():
        for section in page.sections:
            text = f"{section.title} {section.text}".casefold()
            if all(word in text for word in wanted):
                hits.append((not any(word in section.title.casefold() for word in wanted), section))
    return [section for _, section in sorted(hits, key=lambda hit: hit[0])]


def _page(path: Path) -> Page:
    text = path.read_text(encoding="utf-8").replace("{formats of captures}", formats.names())
    sections: list[Section] = []
    title, lines = "", list[str]()
    for line in [*text.splitlines(), "# "]:
        if line.startswith("#"):
            if title or any(part.strip() for part in lines):
                sections.append(Section(path.stem, title, "\n".join(lines)))
            title, lines = line.lstrip("# ").strip(), []
        else:
            lines.append(line)
    return Page(path.stem, sections[0].title if sections else path.stem, text, tuple(sections))
