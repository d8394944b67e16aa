"""The reference of the window: its commands with their keys, and its preferences, from the tables of the code."""

from __future__ import annotations

from collections.abc import Mapping

from nvsim_app.actions import MENUS
from nvsim_app.panels.preferences import PREFERENCES, Preference
from nvsim_app.wiring import actions


def window_page() -> str:
    """A Markdown page."""
    lines = ["# Commands and preferences of the window", ""]
    lines += ["**Edit > Keys…** changes the keys of commands, and **Edit > Preferences…** the preferences.", ""]
    for menu in MENUS:
        found = sorted((a for a in actions() if a.menu == menu), key=lambda a: a.section)
        lines += [f"## {_plain(menu)}", "", "| command | keys | effect |", "|---|---|---|"]
        lines += [f"| {_plain(a.text)} | {_plain(a.shortcut)} | {_plain(a.tip)} |" for a in found]
        lines.append("")
    lines += ["## Preferences", "", "| preference | default | effect |", "|---|---|---|"]
    lines += [f"| {p.group}: {p.title} | {_default(p)} | {_plain(p.words)} |" for p in PREFERENCES]
    return "\n".join(lines) + "\n"


def _default(preference: Preference) -> str:
    value, choices = preference.default, preference.choices
    if isinstance(choices, Mapping) and choices:
        return choices[str(value)]
    if isinstance(value, bool):
        return "yes" if value else "no"
    if preference.nothing and value == preference.low:
        return preference.nothing
    return f"{value:g}{preference.unit}" if isinstance(value, float) else str(value)


def _plain(text: str) -> str:
    return text.replace("&", "").replace("|", "\\|").replace("\n", " ")
