"""The entries of the palette: all commands, and the viewpoints and frames whose names match the typed letters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from nvsim_app.actions import ActionTable
from nvsim_app.look.plain_text import plain
from nvsim_app.state.document import Document

_START, _RUN, _PLAIN, _GAP = 12.0, 14.0, 2.0, 0.15


def match_score(typed: str, text: str) -> tuple[float, tuple[int, ...]] | None:
    """The score of a match (higher is better) and the positions of its letters in `text`; None if a letter is missing.

    Words may be in any order. The letters of a word keep their order. Word starts and runs score most.
    """
    low = text.casefold()
    if len(low) != len(text):
        low = text.lower() if len(text.lower()) == len(text) else text
    total, places = 0.0, []
    for word in typed.casefold().split():
        found = _best(word, low)
        if found is None:
            return None
        total += found[0]
        places += found[1]
    return total - 0.05 * len(text), tuple(sorted(set(places)))


def _best(word: str, text: str) -> tuple[float, list[int]] | None:
    """The best match of the letters of `word`, in order."""
    # score[j]: the best match whose last letter is at position j.
    score: dict[int, tuple[float, list[int]]] = {}
    for i, letter in enumerate(word):
        reached: dict[int, tuple[float, list[int]]] = {}
        for j in range(len(text)):
            if text[j] != letter:
                continue
            own = _START if j == 0 or not text[j - 1].isalnum() else _PLAIN
            if i == 0:
                reached[j] = own, [j]
                continue
            ways = [
                (value + max(own, _RUN if k == j - 1 else 0.0) - _GAP * (j - k - 1), path)
                for k, (value, path) in score.items()
                if k < j
            ]
            if ways:
                value, path = max(ways, key=lambda way: way[0])
                reached[j] = value, [*path, j]
        score = reached
        if not score:
            return None
    return max(score.values(), key=lambda way: way[0])


MOST_PLACES = 6
_LETTERS = 3  # typed letters before viewpoints and frames are searched


@dataclass(frozen=True)
class PaletteEntry:
    """One entry of the palette.

    title     its action
    place     menu of the command, or kind of the entry
    shortcut  as displayed
    reason    why it is unavailable; "" if it is available
    run       performs the action
    marks     positions of the typed letters in the title
    """

    title: str
    place: str
    shortcut: str
    reason: str
    run: Callable[[], object]
    marks: tuple[int, ...] = ()


def commands(table: ActionTable, document: Document) -> list[PaletteEntry]:
    """All commands in the order of the menus."""
    found = []
    for entry in table.entries:
        action = table[entry.id]
        reason = entry.enabled(document) or ""
        title = entry.text.replace("&", "").removesuffix("…")
        if entry.check and not entry.group:
            title += " (on)" if action.isChecked() else " (off)"
        found.append(
            PaletteEntry(title, entry.menu.replace("&", ""), action.shortcut().toString(), reason, action.trigger)
        )
    return found


def matching_entries(entries: list[PaletteEntry], typed: str, recent: list[str]) -> list[PaletteEntry]:
    """The entries that match, best first, unavailable ones last. Without typed text, recent entries are first."""
    if not typed.strip():
        order = {title: i for i, title in enumerate(recent)}
        return sorted(entries, key=lambda e: (bool(e.reason), order.get(_without_state(e.title), len(order))))
    scored = []
    for entry in entries:
        found = match_score(typed, entry.title)
        if found is None:
            wider = match_score(typed, f"{entry.title} {entry.place}")
            found = None if wider is None else (wider[0] - 20, tuple(m for m in wider[1] if m < len(entry.title)))
        if found is not None:
            marked = PaletteEntry(entry.title, entry.place, entry.shortcut, entry.reason, entry.run, found[1])
            scored.append((bool(entry.reason), -found[0], marked))
    scored.sort(key=lambda s: s[:2])
    return [entry for *_, entry in scored]


def places(
    document: Document, typed: str, go_to_viewpoint: Callable[[str], object], go_to_frame: Callable[[int], object]
) -> list[PaletteEntry]:
    """Viewpoints whose id begins with the typed text, and frames whose name contains it."""
    wanted = typed.strip().casefold()
    if len(wanted) < _LETTERS:
        return []
    found: list[PaletteEntry] = []
    for id in document.graph_arrays.ids:
        if id.casefold().startswith(wanted):
            marks = tuple(range(len(wanted)))
            found.append(PaletteEntry(plain(id), "Go to viewpoint", "", "", partial(go_to_viewpoint, id), marks))
            if len(found) == MOST_PLACES:
                break
    capture = document.contents.capture
    frames: list[PaletteEntry] = []
    for i, frame in enumerate(capture.frames if capture is not None else ()):
        at = frame.name.casefold().find(wanted)
        if at >= 0:
            marks = tuple(range(at, at + len(wanted)))
            frames.append(PaletteEntry(plain(frame.name), "Go to frame", "", "", partial(go_to_frame, i), marks))
            if len(frames) == MOST_PLACES:
                break
    return [*found, *frames]


def _without_state(title: str) -> str:
    return title.removesuffix(" (on)").removesuffix(" (off)")
