"""A navigation agent without training that asks a vision-language model.

Each question has the known part of the graph in words, views of the seen places, and the model's plan, which is carried
from step to step. The idea is that of MapGPT (Chen et al. 2024, arXiv 2401.07314); prompts and code are new.

The episodes of a tasks file run in parallel. Each finished episode is a file, FOLDER/INSTR_ID.json, and is not run
again. The file has the trajectory, the reason for the end, the model's thought at each step, and a hash of the inputs.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from nvsim.endpoint.asking import MissingAnswer, ask_until_clear, run_in_parallel
from nvsim.endpoint.budget import RequestEstimate, estimate_requests
from nvsim.endpoint.client import Client
from nvsim.endpoint.prompt import Prompt
from nvsim.endpoint.request import Request
from nvsim.errors import InputError
from nvsim.events import Listener, Progress, Warning, ignore_event
from nvsim.files import atomic
from nvsim.files.opening import is_regular, read_json
from nvsim.graph.types import NavGraph
from nvsim.r2r.metrics.submission import Pose, read_poses
from nvsim.r2r.prompted.mapgpt_episode import AgentChoice, AgentOption, Episode
from nvsim.r2r.prompted.options import EpisodeLimits, ImageOptions
from nvsim.r2r.prompted.views import ViewRenderer
from nvsim.r2r.tasks.task import Task

STAGE = "mapgpt"
_FORMAT = 1
_REHEARSED = 3  # episodes from which the estimate is made
_LARGEST = 1 << 26  # largest size of an episode file in bytes


@dataclass(frozen=True)
class EpisodeRecord:
    """A finished episode.

    trajectory   poses from the start
    ended        "stop", "steps" after the last step, or "unanswered" if no answer was usable
    why          the reason for "unanswered", else ""
    steps        action, thought and plan of each step
    """

    depends: str
    trajectory: list[Pose]
    ended: str
    why: str
    steps: list[dict[str, str]]
    tokens_in: int
    tokens_out: int


@dataclass(frozen=True, eq=False)
class MapGpt:
    """The common inputs of all episodes; graphs: scan id -> graph."""

    renderer: ViewRenderer
    looking: ImageOptions
    graphs: Mapping[str, NavGraph]
    prompt: Prompt
    rules: EpisodeLimits

    def episode(self, client: Client, instr_id: str, task: Task) -> Episode:
        text = task.instructions[task.instr_ids.index(instr_id)]
        options = client.options
        graph = self.graphs[task.scan]
        return Episode(graph, self.renderer, self.prompt, self.rules, task, text, options.answer_tokens, options.detail)


def episodes_of(tasks: Sequence[Task], where: Path) -> list[tuple[str, Task]]:
    """Returns every instruction id with its task. Raises InputError if a path has no instructions."""
    for task in tasks:
        if not task.instructions:
            raise InputError(
                f"{where}: path_id {task.path_id} has no instruction, which this agent needs; "
                "export tasks with --instructions 3."
            )
    return [(id, task) for task in tasks for id in task.instr_ids]


def estimate_episodes(
    agent: MapGpt, client: Client, episodes: Sequence[tuple[str, Task]], folder: Path
) -> RequestEstimate:
    """Estimates the size of all requests of the unfinished episodes.

    It assumes that the agent goes straight to the goal, and extrapolates from three episodes.
    """
    left = [e for e in episodes if _read_finished(folder, e[0], _input_hash(agent, client, *e)) is None]
    few = left[:: max(1, len(left) // _REHEARSED)][:_REHEARSED]
    if not few:
        return RequestEstimate(kept=len(episodes))
    found = estimate_requests(
        (request, False) for e in few for request in _straight(agent.episode(client, *e), e[1], agent.rules)
    )
    scale = len(left) / len(few)
    names = ("requests", "images", "sent", "tokens_in", "tokens_out")
    of_all = {name: round(scale * getattr(found, name)) for name in names}
    return replace(found, **of_all, kept=len(episodes) - len(left))


def run_mapgpt(
    agent: MapGpt,
    client: Client,
    episodes: Sequence[tuple[str, Task]],
    folder: Path,
    listen: Listener = ignore_event,
) -> dict[str, EpisodeRecord]:
    """Runs all episodes and returns the records by instr_id.

    An episode ends if the model stops, after the last step, or if the model gives no usable answer. In the last case
    the agent stays at its place.

    Raises InputError in the cases that `Client.ask` lists; finished episodes stay in `folder`.
    """
    found: dict[str, EpisodeRecord] = {}
    todo = []
    for id, task in episodes:
        depends = _input_hash(agent, client, id, task)
        record = _read_finished(folder, id, depends)
        if record is None:
            todo.append((id, task, depends))
        else:
            found[id] = record
    listen(Progress(STAGE, len(found), len(episodes)))
    for (id, _, _), record in run_in_parallel(
        lambda e: _run_episode(agent, client, folder, *e), todo, client.options.parallel
    ):
        found[id] = record
        if record.ended == "unanswered":
            listen(Warning(f"{id} ends at step {len(record.steps) + 1}: {record.why}.", STAGE))
        listen(Progress(STAGE, len(found), len(episodes)))
    return {id: found[id] for id, _ in episodes}


def _run_episode(agent: MapGpt, client: Client, folder: Path, id: str, task: Task, depends: str) -> EpisodeRecord:
    episode = agent.episode(client, id, task)
    steps: list[dict[str, str]] = []
    ended, why, spent = "steps", "", (0, 0)
    while episode.step < agent.rules.steps:
        said = ask_until_clear(client, episode.request(), episode.parse_choice, episode.retry_message)
        spent = spent[0] + said.spent[0], spent[1] + said.spent[1]
        if isinstance(said, MissingAnswer):
            ended, why = "unanswered", said.why
            break
        choice = said.value
        steps.append({"action": choice.option.words, "thought": choice.thought, "plan": choice.plan})
        episode.execute(choice)
        if choice.option.to is None:
            ended = "stop"
            break
    record = EpisodeRecord(depends, episode.trajectory, ended, why, steps, *spent)
    about = {"format": _FORMAT, "instr_id": id, **asdict(record)}
    atomic.write_text(folder / f"{id}.json", json.dumps(about, indent=1) + "\n")
    return record


def _straight(episode: Episode, task: Task, rules: EpisodeLimits) -> list[Request]:
    """Returns the questions of an agent that follows its path and stops."""
    requests = []
    for to in (*task.path[1:], None):
        if episode.step == rules.steps:
            break
        requests.append(episode.request())
        episode.execute(AgentChoice(AgentOption("", "go on", to), "", "Go on to where the instruction ends."))
    return requests


def _input_hash(agent: MapGpt, client: Client, id: str, task: Task) -> str:
    """Returns a hash of all inputs of an episode except the images."""
    graph = agent.graphs[task.scan]
    around = [(v.id, v.position, v.included) for v in graph.viewpoints.values()]
    instruction = task.instructions[task.instr_ids.index(id)]
    words = (
        (client.endpoint.url, client.endpoint.model, client.options.answer_tokens, client.options.detail),
        (agent.prompt.sha256, asdict(agent.rules), asdict(agent.looking)),
        (task.scan, task.path[0], task.heading, instruction),
        (around, sorted(graph.edges)),
    )
    return hashlib.sha256(repr(words).encode(errors="replace")).hexdigest()


def _read_finished(folder: Path, id: str, depends: str) -> EpisodeRecord | None:
    """Returns the record of a finished episode, or None if there is none with these inputs."""
    path = folder / f"{id}.json"
    if not is_regular(path):
        return None
    try:
        found = read_json(path, "a finished episode", "remove it", _LARGEST)
        if not isinstance(found, dict) or found.get("format") != _FORMAT or found.get("depends") != depends:
            return None
        poses = read_poses(found.get("trajectory"), str(path))
    except InputError:
        return None
    into, out, steps = found.get("tokens_in"), found.get("tokens_out"), found.get("steps")
    if not isinstance(into, int) or not isinstance(out, int) or not isinstance(steps, list):
        return None
    return EpisodeRecord(depends, poses, str(found.get("ended")), str(found.get("why")), steps, into, out)
