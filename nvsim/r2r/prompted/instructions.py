"""Instructions for paths, written by a vision-language model from views along the paths."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from nvsim.endpoint.asking import MissingAnswer, UnusableAnswer, ask_until_clear, json_object, run_in_parallel
from nvsim.endpoint.budget import RequestEstimate, estimate_requests
from nvsim.endpoint.client import Client
from nvsim.endpoint.prompt import FOLDER, Prompt
from nvsim.endpoint.request import Detail, Message, Part, Request
from nvsim.events import Listener, Progress, Warning, ignore_event
from nvsim.graph.types import NavGraph
from nvsim.r2r.prompted.views import ViewRenderer, bearing, level
from nvsim.r2r.tasks.task import Task

STAGE = "instructions"
PROMPT = FOLDER / "instructions.txt"
_NEEDS = {
    "system": ((), ("count",)),
    "user": (("route",), ("count",)),
    "again": ((), ("wrong", "count")),
}
_LONGEST = 2000  # characters of an instruction


def read_prompt(path: Path | None) -> Prompt:
    """Reads a prompt file, or the built-in prompt if `path` is None. Raises InputError if it is invalid."""
    return Prompt.read(path or PROMPT, _NEEDS)


@dataclass(frozen=True)
class GeneratedInstructions:
    """The instructions of a model.

    found     path_id -> the requested number of instructions
    lacking   path_id -> reason for missing instructions
    """

    found: Mapping[int, tuple[str, ...]]
    lacking: Mapping[int, MissingAnswer]


class InstructionWriter:
    """Requests `count` instructions of each path, with one question for each path.

    graphs   scan id -> graph
    """

    def __init__(
        self,
        renderer: ViewRenderer,
        graphs: Mapping[str, NavGraph],
        prompt: Prompt,
        count: int,
        tokens: int,
        detail: Detail = "auto",
    ) -> None:
        self._renderer, self._graphs, self._prompt, self._count = renderer, graphs, prompt, count
        self._tokens, self._detail = tokens, detail

    def request(self, task: Task) -> Request:
        """Returns the question for a path. Raises InputError if a view cannot be rendered."""
        values: dict[str, str | Sequence[Part]] = {"count": str(self._count), "route": self._describe_route(task)}
        system = Message("system", self._prompt.fill("system", values))
        return Request((system, Message("user", self._prompt.fill("user", values))), self._tokens, self._detail)

    def estimate(self, client: Client, tasks: Sequence[Task]) -> RequestEstimate:
        """Returns the size of all requests for these paths."""
        requests = (self.request(task) for task in tasks)
        return estimate_requests((request, client.has_stored_answer(request)) for request in requests)

    def write(
        self, client: Client, tasks: Sequence[Task], at_once: int, listen: Listener = ignore_event
    ) -> GeneratedInstructions:
        """Requests the instructions of all tasks. Raises InputError in the cases that `Client.ask` lists."""
        found: dict[int, tuple[str, ...]] = {}
        lacking: dict[int, MissingAnswer] = {}
        listen(Progress(STAGE, 0, len(tasks)))
        for task, said in run_in_parallel(lambda task: self._request_instructions(client, task), tasks, at_once):
            if isinstance(said, MissingAnswer):
                lacking[task.path_id] = said
                listen(Warning(f"path_id {task.path_id} has no instructions from the model: {said.why}.", STAGE))
            else:
                found[task.path_id] = said
            listen(Progress(STAGE, len(found) + len(lacking), len(tasks)))
        return GeneratedInstructions(found, lacking)

    def _request_instructions(self, client: Client, task: Task) -> tuple[str, ...] | MissingAnswer:
        def retry_message(wrong: str) -> str:
            return self._prompt.text("again", {"wrong": wrong, "count": str(self._count)})

        said = ask_until_clear(client, self.request(task), self._understood, retry_message)
        return said if isinstance(said, MissingAnswer) else said.value

    def _understood(self, text: str) -> tuple[str, ...]:
        given = json_object(text).get("instructions")
        if not isinstance(given, list) or not all(isinstance(one, str) for one in given):
            raise UnusableAnswer('"instructions" must be a list of texts')
        texts = [" ".join(_without_surrogates(one).split()) for one in given]
        if len(texts) < self._count:
            raise UnusableAnswer(f"there were {len(texts)} instructions and not {self._count}")
        texts = texts[: self._count]
        if not all(len(one.split()) >= 3 and len(one) <= _LONGEST for one in texts):
            raise UnusableAnswer(f"each instruction must have three words or more and at most {_LONGEST} letters")
        if len({one.casefold() for one in texts}) < len(texts):
            raise UnusableAnswer("two instructions were the same")
        return tuple(texts)

    def _describe_route(self, task: Task) -> list[Part]:
        """Returns words and views in turn: the first view, each step in its direction, and four views at the goal."""
        graph, facing = self._graphs[task.scan], task.heading
        parts: list[Part] = ["At the start you look this way:", self._renderer.view(task.scan, task.path[0], facing)]
        for i, (here, there) in enumerate(zip(task.path, task.path[1:]), 1):
            way = bearing(graph, here, there)
            parts.append(f"Step {i}: {way.describe(facing)}. Looking that way:")
            facing = facing if way.heading is None else way.heading
            parts.append(self._renderer.view(task.scan, here, facing, level(way.elevation)))
        goal = task.path[-1]
        parts += ["This is where to stop. Looking on:", self._renderer.view(task.scan, goal, facing)]
        for words, turn in (("To the right:", 90), ("Back:", 180), ("To the left:", 270)):
            parts += [words, self._renderer.view(task.scan, goal, facing + math.radians(turn))]
        return parts


def _without_surrogates(text: str) -> str:
    """Removes unpaired surrogates, which cannot be written to a text file."""
    return text.encode("utf-8", "ignore").decode()
