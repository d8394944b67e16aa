"""Commands that write tasks: paths with instructions, and the tasks that a review accepted."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.terminal import as_json, print_lines, table
from nvsim.dataset.task_options import TaskOptions
from nvsim.endpoint.options import AskingOptions, OneEndpoint
from nvsim.endpoint.request import StoredAnswers
from nvsim.errors import InputError, value_text
from nvsim.graph.connectivity import read_connectivity, scan_choices, scan_files
from nvsim.r2r.prompted.options import ImageOptions
from nvsim.r2r.tasks.shortest import PathBounds
from nvsim.r2r.tasks.splitting import PathCounts, replace_instructions

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from nvsim.events import Listener
    from nvsim.graph.types import NavGraph
    from nvsim.r2r.instructions.generating import InstructedDataset
    from nvsim.r2r.tasks.splitting import Dataset


@dataclass(frozen=True)
class TaskArguments(TaskOptions):
    """The options of tasks, without prefixes."""

    amounts: Inline[PathCounts] = field(default_factory=PathCounts)
    bounds: Inline[PathBounds] = field(default_factory=PathBounds)


@dataclass(frozen=True)
class ExportTasks:
    """Sample the paths of a benchmark as R2R does, with instructions, and write them as R2R_train.json,
    R2R_val_seen.json and R2R_val_unseen.json. Paths are shortest paths, spread over the building. val_unseen uses
    regions that the other splits never enter."""

    scans: Path | None = None
    """The folder of an export (which contains connectivity/), or a folder of connectivity files with scans.txt."""
    project: Path | None = None
    """A project whose graph is one scan, with the id that `nvsim export r2r` gives it. With --scans too, the scan that
    `nvsim export scan` made of the project; the project's point cloud then also shows the free space of a robot."""
    out: Path = Path("tasks")
    """The output folder."""
    only: tuple[str, ...] = ()
    """Scans to use. Default: all that scans.txt lists."""
    options: Inline[TaskArguments] = field(default_factory=TaskArguments)
    asked: Inline[OneEndpoint] = field(default_factory=OneEndpoint)
    asking: Inline[AskingOptions] = field(default_factory=AskingOptions)
    looking: Inline[ImageOptions] = field(default_factory=ImageOptions)
    prompt: Path | None = None
    """File with the prompt for the model at --endpoint. Default: nvsim_resources/prompts/instructions.txt."""
    json: bool = False
    """Print the written files as JSON."""

    def run(self) -> int:
        from nvsim.cli.consent import exit_code
        from nvsim.cli.console import event_listener
        from nvsim.dataset.tasks import STAGE, make_tasks
        from nvsim.events import Done, ignore_event

        if self.asked.endpoint is not None:
            _check_endpoint(self)
        graphs, clouds = _graphs(self)
        with event_listener(False) as heard:
            listen = ignore_event if self.json else heard
            retell = partial(_asked_instructions, self, listen) if self.asked.endpoint is not None else None
            made = make_tasks(graphs, self.scans, self.out, self.options, listen, clouds, retell)
            if not self.json:
                listen(Done(STAGE, f"{made.instructed.paths} paths in {self.out}"))
        dataset = made.instructed.dataset
        for warning in warnings_of(dataset):
            print_lines(f"warning: {warning}", error=True)
        rows = rows_of(dataset)
        if self.json:
            unseen = {scan: len(ids) for scan, ids in dataset.unseen.items()}
            files = [str(path) for path in made.written]
            beside = {"episodes": made.episodes} if made.episodes else {}
            print_lines(
                as_json({"written": files, "splits": rows, "unseen": unseen, "instructions": made.about, **beside})
            )
        else:
            table(list(rows[0]), [[_text(value) for value in row.values()] for row in rows])
            if self.options.instructions:
                which = "generated instructions" if "endpoint" in made.about else "instructions"
                print_lines(f"From the {which} alone a follower finds {_count_described(made.instructed)}.")
            if "endpoint" in made.about:
                written = made.about["endpoint"]
                print_lines(
                    f"{written['paths']} of {made.instructed.paths} paths have instructions from {written['model']}."
                )
            if made.episodes:
                print_lines(f"{sum(made.episodes.values())} of {made.instructed.paths} paths have episodes.")
            print_lines(*(f"Wrote {path}" for path in made.written))
        asked = made.about.get("endpoint")
        return exit_code([asked["model"]] if asked and not asked["paths"] else [])


def rows_of(dataset: Dataset) -> list[dict[str, Any]]:
    named = [(name, tasks) for name, tasks in dataset.splits.items()]
    named += [(f"{name}, joined", tasks) for name, tasks in dataset.joined.items()]
    rows = []
    for name, tasks in named:
        edges = [len(task.path) - 1 for task in tasks] or [0]
        meters = [task.distance or 0.0 for task in tasks] or [0.0]
        row = {
            "split": name,
            "paths": len(tasks),
            "scans": len({task.scan for task in tasks}),
            "viewpoints": len({(task.scan, id) for task in tasks for id in task.path}),
            "edges": [min(edges), round(sum(edges) / len(edges), 2), max(edges)],
            "meters": [min(meters), round(sum(meters) / len(meters), 2), max(meters)],
        }
        rows.append(row)
    return rows


def _count_described(instructed: InstructedDataset) -> str:
    how = Counter(instructed.found.values())
    return (
        f"{len(instructed.found)} of {instructed.paths} paths, {how['clock']} of them "
        "because instructions name clock directions "
        f"and {how['degrees']} because they name degrees"
    )


def _text(value: object) -> str:
    return " / ".join(f"{v:g}" for v in value) if isinstance(value, list) else str(value)


def warnings_of(dataset: Dataset) -> list[str]:
    from nvsim.r2r.observations.stub import SCAN

    found = [f"No path within the bounds is in the scan {id}." for id in dataset.empty if id != SCAN]
    return found + [
        f"{split} has {fewer} paths fewer than requested; no more fit." for split, fewer in dataset.lacking.items()
    ]


def _graphs(arguments: ExportTasks) -> tuple[list[NavGraph], dict[str, NDArray[np.floating]]]:
    """The graphs, and their point clouds by scan. Raises InputError if the options contradict each other."""
    a = arguments
    if a.scans is None and a.project is None:
        raise InputError("Give --scans (a folder of exported scans), or --project, or both.")
    if a.project is None:
        assert a.scans is not None
        return [read_connectivity(path) for path in scan_files(a.scans, a.only).values()], {}
    if a.only and a.scans is None:
        raise InputError("--only selects scans of --scans; a project is one scan.")
    from nvsim.project.project import Project

    with Project.open(a.project) as project:
        if a.scans is None:
            return [replace(project.need_graph(), scan=project.scan_name)], {}
        names = a.only or (project.scan_name,)
        listed = scan_files(a.scans)
        if not a.only and project.scan_name not in listed:
            raise InputError(
                f"{a.scans} does not list the scan {value_text(project.scan_name)} of {a.project}. If the project was "
                f"exported under another id, name it with --only: {scan_choices(listed)}."
            )
        graphs = [read_connectivity(path) for path in scan_files(a.scans, names).values()]
        cloud = project.dense_points() if a.options.strips else None
    return graphs, {} if cloud is None else {graph.scan: cloud for graph in graphs}


def _check_endpoint(a: ExportTasks) -> None:
    """Raises InputError before any work if the model cannot be asked with these options."""
    from nvsim.r2r.prompted.instructions import read_prompt

    if a.options.instructions == 0:
        raise InputError(
            "--endpoint asks for instructions, but --instructions 0 excludes them; drop one of the two options."
        )
    read_prompt(a.prompt)
    a.asked.address()
    a.asked.budget(a.asking)


def _asked_instructions(
    a: ExportTasks, listen: Listener, dataset: Dataset, graphs: Sequence[NavGraph]
) -> tuple[Dataset, dict[str, Any]]:
    """The dataset with instructions of the model, and their description for tasks.json. The description names the
    model, the generated instructions that were replaced, and the paths that keep generated ones and why.

    Raises InputError if there are no images to send, the user does not agree, or the endpoint does not answer."""
    from nvsim.cli.consent import ask_for_consent
    from nvsim.endpoint.client import Client
    from nvsim.r2r.prompted.instructions import InstructionWriter, read_prompt
    from nvsim.r2r.prompted.views import ViewRenderer

    prompt, endpoint, budget = read_prompt(a.prompt), a.asked.address(), a.asked.budget(a.asking)
    place = a.scans or a.project
    assert place is not None
    tasks = [task for split in dataset.splits.values() for task in split]
    by_scan = {graph.scan: graph for graph in graphs}
    renderer = ViewRenderer(place, a.looking)
    kept = StoredAnswers(a.asked.answers or a.out / "answers")
    client = Client(endpoint, kept, budget, a.asking, listen)
    try:
        writer = InstructionWriter(
            renderer, by_scan, prompt, a.options.instructions, a.asking.answer_tokens, a.asking.detail
        )
        note = (
            "NVSim sends views along the paths, turns and distances. If an answer is unusable, it asks again, "
            "at most twice."
        )
        client.may_send = ask_for_consent(
            [(endpoint, writer.estimate(client, tasks), budget.prices)], [note], a.asking.yes
        )
        written = writer.write(client, tasks, a.asking.parallel, listen)
    finally:
        client.close()
        renderer.close()
    about = {
        "url": endpoint.url,
        "model": endpoint.model,
        "prompt": prompt.path.name,
        "prompt_sha256": prompt.sha256,
        "paths": len(written.found),
        "tokens_in": budget.tokens_in,
        "tokens_out": budget.tokens_out,
        "price": budget.cost,
        "asked": budget.asked,
        "answers_used_again": budget.used_again,
        "generated_instead": {str(id): said.why for id, said in written.lacking.items()},
        "generated": {str(t.path_id): list(t.instructions) for t in tasks if t.path_id in written.found},
    }
    return replace_instructions(dataset, written.found), about


@dataclass(frozen=True)
class ExportReviewed:
    """Write the tasks that were accepted in a review, with the rewritten instructions, as R2R_train.json and so on. The
    verdicts come from the window, which stores them in reviewed/tasks_review.json next to the tasks."""

    tasks: Positional[tuple[Path, ...]]
    """The folder of reviewed tasks, or some of its files."""
    out: Path | None = None
    """The output folder. Default: reviewed/ next to the tasks."""
    unread: bool = False
    """Also write tasks without a verdict, so that only rejected ones are skipped."""
    json: bool = False
    """Print the written files as JSON."""

    def run(self) -> int:
        """Runs the command. Raises InputError if no tasks are named."""
        from nvsim.r2r.reviewing import counts_of, export_reviewed, read_folder

        if not self.tasks:
            raise InputError("Name the folder of the reviewed tasks.")
        folder = read_folder(*self.tasks)
        own = folder.review_file.parent
        out = self.out or own
        is_own = out.expanduser().resolve() == own.resolve()
        written = export_reviewed(folder.entries, folder.review, out, self.unread, overwrite=is_own)
        rows = counts_of(folder)
        if self.json:
            print_lines(as_json({"written": [str(path) for path in written], "splits": rows}))
        else:
            table(list(rows[0]), [[str(value) for value in row.values()] for row in rows])
            print_lines(*(f"Wrote {path}" for path in written))
        return 0
