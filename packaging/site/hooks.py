"""Pages of the site that are not in resources/docs, and the checks of its strict mode.

MkDocs calls the functions by their names. A warning ends the build with an error.
"""

from __future__ import annotations

import logging
import re
import sys
from os.path import normpath
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).resolve().parent))

from command_options import options_page, wrong_options  # noqa: E402
from python_page import python_page  # noqa: E402
from window_page import window_page  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "resources" / "docs"
IMAGE = re.compile(r"!\[([^\]]+)\]\(([^)#]+)\)")
log = logging.getLogger("mkdocs.hooks.nvsim")
HISTORY = ("changelog.md", "decisions/")
"""Pages that quote the options of earlier versions."""
GALLERY = (
    *("window", "window-inspector", "window-frame", "window-agent", "window-training"),
    *("editing-false-edge", "editing-proposed", "editing-compare", "editing-foreign"),
    *("panorama", "floor-masks", "floor-masks-clip", "agent-walk"),
)
"""Names of the pictures and clips in the gallery, without suffix."""


def on_config(config: Any) -> Any:
    """Adds every decision to the navigation, which names their list."""
    records = sorted(f"decisions/{path.name}" for path in (DOCS / "decisions").glob("[0-9]*.md"))
    for section in config.nav:
        for page in section.get("Explanation", ()):
            if isinstance(page, dict) and "Decisions" in page:
                page["Decisions"] = ["decisions/index.md", *records]
    return config


def on_files(files: Files, config: Any) -> Files:
    """Adds the pages that come from other places."""
    pages = {
        "index.md": _from_root("README.md"),
        "contributing.md": _from_root("CONTRIBUTING.md"),
        "changelog.md": _from_root("CHANGELOG.md"),
        "security.md": _from_root("SECURITY.md"),
        **{f"examples/{path.name}": path.read_text() for path in sorted((ROOT / "examples").glob("*.py"))},
        "models/bundled/card.md": (ROOT / "resources/nvsim_resources/models/bundled/card.md").read_text(),
        "licenses.md": (ROOT / "resources/licenses/README.md").read_text(),
        "LICENSE": (ROOT / "LICENSE").read_text(),
        "CITATION.cff": (ROOT / "CITATION.cff").read_text(),
        "decisions/index.md": _decisions(),
        "gallery.md": _gallery(),
        "reference/options.md": options_page(),
        "reference/python.md": python_page(),
        "reference/window.md": window_page(),
    }
    for path, text in pages.items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Checks the quoted options, and adapts the page to the rules of Python-Markdown."""
    source = page.file.src_uri
    if not source.startswith(HISTORY):
        for sentence in wrong_options(markdown):
            log.warning("%s: %s", source, sentence)
    markdown = re.sub(r"\]\(((?:\.\./)*)\.\./nvsim_resources/models/", r"](\1models/", markdown)
    markdown = IMAGE.sub(lambda image: _for_both_themes(image, source), markdown)
    markdown = re.sub(r"\[([^\]]*)\]\((\.\./\.\./)?examples\)", r"\1", markdown)  # a folder is no page
    return _lists(markdown.replace("](../../examples/", "](examples/"))


def _for_both_themes(image: re.Match[str], source: str) -> str:
    """The picture of the dark theme and that of the light theme, if the picture has both; Material shows one."""
    words, dark = image.groups()
    light = Path(dark).with_stem(Path(dark).stem + "-light")
    if not (DOCS / Path(source).parent / light).is_file():
        return image[0]
    return f"![{words}]({dark}#only-dark)![{words}]({light}#only-light)"


def _from_root(name: str) -> str:
    """A page of the top folder, with links that fit its place on the site."""
    text = (ROOT / name).read_text().replace("](resources/docs/decisions)", "](decisions/index.md)")
    text = text.replace("](resources/docs/", "](").replace("](resources/licenses/README.md", "](licenses.md")
    text = text.replace("](resources/", "](../")
    for other in ("CONTRIBUTING", "CHANGELOG", "SECURITY"):
        text = text.replace(f"]({other}.md", f"]({other.lower()}.md")
    return text.replace("](README.md", "](index.md")


def _decisions() -> str:
    rows = []
    for path in sorted((DOCS / "decisions").glob("[0-9]*.md")):
        title = path.read_text().splitlines()[0].lstrip("# ")
        rows.append(f"- [{title}]({path.name})")
    return "\n".join(
        ["# Decisions", "", "Each record gives a decision, its reason, and the rejected alternatives.", "", *rows]
    )


def _gallery() -> str:
    lines = ["# Gallery", "", "Each picture links to the page that explains it.", ""]
    for path in sorted([*DOCS.glob("*.md"), *DOCS.glob("how-to/*.md")]):
        text, page = path.read_text(), path.relative_to(DOCS)
        pictures = [(words, image) for words, image in IMAGE.findall(text) if Path(image).stem in GALLERY]
        if pictures:
            lines += [f"## {text.splitlines()[0].lstrip('# ')}", ""]
        for words, image in pictures:
            lines += [f"[![{words}]({normpath(page.parent / image)})]({page.as_posix()})", "", f"*{words}*", ""]
    return "\n".join(lines)


def _lists(markdown: str) -> str:
    """Writes lists as Python-Markdown reads them: four spaces before the content of an item, where GitHub accepts two
    and three, and an empty line between a paragraph and the list after it."""
    lines: list[str] = []
    fenced = text = False
    for line in markdown.split("\n"):
        if line.lstrip().startswith("```"):
            fenced = not fenced
        if not fenced:
            line = re.sub(r"^ {2,3}(?=\S)", "    ", line)
            item = re.match(r" *([-*]|1\.) ", line) is not None
            if item and text:
                lines.append("")
            if not lines or not lines[-1]:
                text = bool(line) and not item
        lines.append(line)
    return "\n".join(lines)
