"""One episode of the agent mapgpt: the question of each step, the meaning of the answers, and the moves.

A question has the part of the graph that the agent knows in words: the numbered places it saw, and the edges of the
places it visited.
"""

from __future__ import annotations

import re
import string
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from nvsim.endpoint.asking import UnusableAnswer, json_object
from nvsim.endpoint.prompt import FOLDER, Prompt
from nvsim.endpoint.request import Detail, Message, Part, Request
from nvsim.graph.types import NavGraph
from nvsim.r2r.metrics.submission import Pose
from nvsim.r2r.prompted.options import EpisodeLimits
from nvsim.r2r.prompted.views import ViewRenderer, bearing, level
from nvsim.r2r.tasks.task import Task

PROMPT = FOLDER / "mapgpt.txt"
_PLACES = (
    ("instruction", "trajectory", "actions", "images"),
    ("history", "map", "elsewhere", "plan", "step", "most"),
)
_NEEDS = {"system": ((), ("instruction", "most")), "user": _PLACES, "again": ((), ("wrong",))}
_LONGEST = 2000  # characters of a plan or a thought that are kept


class Places:
    """The known places.

    number     viewpoint id -> number, in the order in which they were first seen; the start is 0
    seen_from  viewpoint id -> viewpoint from which it was last seen; the start is missing until it is seen
    been       visited viewpoint ids in order
    """

    def __init__(self, graph: NavGraph, start: str) -> None:
        self._graph = graph
        self.number = {start: 0}
        self.seen_from: dict[str, str] = {}
        self.been: list[str] = []
        self.move_to(start)

    @property
    def current(self) -> str:
        return self.been[-1]

    def neighbors(self, viewpoint: str) -> list[str]:
        """Returns the neighbors of a viewpoint, in the order of their numbers."""
        return sorted(self._included(viewpoint), key=self.number.__getitem__)

    def move_to(self, viewpoint: str) -> None:
        """Moves to a viewpoint and adds its neighbors to the seen places."""
        self.been.append(viewpoint)
        for neighbor in self._included(viewpoint):
            self.number.setdefault(neighbor, len(self.number))
            self.seen_from[neighbor] = viewpoint

    def trajectory_words(self) -> str:
        return " ".join(str(self.number[id]) for id in self.been)

    def map_words(self) -> str:
        """Returns one line for each visited place."""
        lines = []
        for id in sorted(set(self.been), key=self.number.__getitem__):
            joined = ", ".join(str(self.number[other]) for other in self.neighbors(id))
            lines.append(f"Place {self.number[id]} is joined to {joined or 'nothing'}.")
        return "\n".join(lines)

    def other_seen_places(self) -> list[str]:
        """Returns the places that were seen, but not visited, and are not neighbors of the current place."""
        near = {*self.been, *self.neighbors(self.current)}
        return [id for id in self.number if id not in near]

    def elsewhere_words(self) -> str:
        far = [
            f"Place {self.number[id]}, next to place {self.number[self.seen_from[id]]}."
            for id in self.other_seen_places()
        ]
        return "\n".join(far) or "None."

    def _included(self, viewpoint: str) -> list[str]:
        found = (id for id in self._graph.neighbors(viewpoint) if self._graph.viewpoints[id].included)
        return sorted(found)


def read_prompt(path: Path | None) -> Prompt:
    """Reads a prompt file, or the built-in prompt if `path` is None. Raises InputError if it is invalid."""
    return Prompt.read(path or PROMPT, _NEEDS)


@dataclass(frozen=True)
class AgentOption:
    """An option of the agent: its letter, its description, and the viewpoint it leads to, None for stopping."""

    letter: str
    words: str
    to: str | None


@dataclass(frozen=True)
class AgentChoice:
    option: AgentOption
    thought: str
    plan: str


class Episode:
    """The state of an agent in one episode. `request` and `parse_choice` do not change it; `execute` does."""

    def __init__(
        self,
        graph: NavGraph,
        renderer: ViewRenderer,
        prompt: Prompt,
        rules: EpisodeLimits,
        task: Task,
        instruction: str,
        tokens: int,
        detail: Detail = "auto",
    ) -> None:
        self._graph, self._renderer, self._prompt, self._rules = graph, renderer, prompt, rules
        self._task, self._instruction, self._tokens, self._detail = task, instruction, tokens, detail
        self.places = Places(graph, task.path[0])
        self.facing = task.heading
        self.trajectory: list[Pose] = [(task.path[0], round(task.heading, 6), 0.0)]
        self._history: list[str] = []
        self._plan = "None yet."

    @property
    def step(self) -> int:
        """Number of answered questions."""
        return len(self._history)

    def options(self) -> list[AgentOption]:
        """Returns the options of this step, sorted by the size of the turn, with stopping last.

        Stopping is offered from step `stop_after` on, or if there is no edge.
        """
        here = self.places.current
        ways = {id: bearing(self._graph, here, id) for id in self.places.neighbors(here)}
        found: list[AgentOption] = []
        for id in sorted(ways, key=lambda id: (abs(round(ways[id].turn_from(self.facing), 6)), self.places.number[id])):
            number = self.places.number[id]
            known = ", where you were" if id in self.places.been else ""
            found.append(
                AgentOption(_letter(len(found)), f"{ways[id].describe(self.facing)}, to place {number}{known}", id)
            )
        if self.step >= self._rules.stop_after or not found:
            found.append(AgentOption(_letter(len(found)), "stop here, because the instruction ends here", None))
        return found

    def request(self) -> Request:
        """Returns the question of this step. Raises InputError if a view cannot be rendered."""
        places, options = self.places, self.options()
        values: dict[str, str | Sequence[Part]] = {
            "instruction": self._instruction,
            "trajectory": places.trajectory_words(),
            "history": "\n".join(self._history) or "None yet.",
            "map": places.map_words(),
            "elsewhere": places.elsewhere_words(),
            "plan": self._plan,
            "step": str(self.step + 1),
            "most": str(self._rules.steps),
            "actions": "\n".join(f"{option.letter}: {option.words}" for option in options),
            "images": self._images(),
        }
        system = Message("system", self._prompt.fill("system", values))
        return Request((system, Message("user", self._prompt.fill("user", values))), self._tokens, self._detail)

    def retry_message(self, wrong: str) -> str:
        """Returns the message to the model after an unusable answer."""
        return self._prompt.text("again", {"wrong": wrong})

    def parse_choice(self, text: str) -> AgentChoice:
        """Parses the choice from an answer. Raises UnusableAnswer if it has none."""
        said, options = json_object(text), self.options()
        action = said.get("action")
        found = re.match(r"[\s\"'(\[]*([A-Za-z]{1,2})\b", action) if isinstance(action, str) else None
        chosen = next((option for option in options if found and option.letter == found[1].upper()), None)
        if chosen is None:
            raise UnusableAnswer(f'"action" must be one letter of {", ".join(option.letter for option in options)}')
        return AgentChoice(chosen, _shorten(said.get("thought")), _shorten(said.get("plan")))

    def execute(self, choice: AgentChoice) -> None:
        """Executes a choice."""
        to = choice.option.to
        self._history.append(f"Step {self.step + 1}: {choice.option.words}.")
        self._plan = choice.plan or self._plan
        if to is None:
            return
        way = bearing(self._graph, self.places.current, to)
        self.facing = self.facing if way.heading is None else way.heading
        self.places.move_to(to)
        self.trajectory.append((to, round(self.facing, 6), 0.0))

    def _images(self) -> list[Part]:
        places, here = self.places, self.places.current
        near = places.neighbors(here)
        last = {id: i for i, id in enumerate(places.been)}
        others = [id for id in places.seen_from if id not in near and id != here]
        others.sort(key=lambda id: (-last[places.seen_from[id]], places.number[id]))
        shown = [*near, *others][: self._rules.most_images]
        parts: list[Part] = []
        for id in sorted(shown, key=places.number.__getitem__):
            stood = places.seen_from[id]
            way = bearing(self._graph, stood, id)
            heading = self.facing if way.heading is None else way.heading
            parts.append(f"Place {places.number[id]}, seen from place {places.number[stood]}:")
            parts.append(self._renderer.view(self._task.scan, stood, heading, level(way.elevation)))
        return parts or ["None."]


def _letter(index: int) -> str:
    """Returns A to Z, then AA, AB and so on."""
    letters = string.ascii_uppercase
    return letters[index] if index < 26 else letters[index // 26 - 1] + letters[index % 26]


def _shorten(value: object) -> str:
    return " ".join(value.encode("utf-8", "ignore").decode().split())[:_LONGEST] if isinstance(value, str) else ""
