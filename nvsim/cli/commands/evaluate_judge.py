"""The command that lets models and metrics judge images."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from nvsim.cli.arguments import Inline
from nvsim.cli.terminal import as_json, print_lines
from nvsim.endpoint.budget import Prices
from nvsim.endpoint.options import AskingOptions, Endpoint
from nvsim.endpoint.request import StoredAnswers
from nvsim.errors import InputError
from nvsim.files.atomic import refuse_unwritable_folder

if TYPE_CHECKING:
    from nvsim.evaluation.judging.compared_images import ContestantImages
    from nvsim.evaluation.scores import Distance
    from nvsim.events import Listener


@dataclass(frozen=True)
class EvaluateJudge:
    """Compare images of equal views by two or more models, pair by pair: with vision-language models at endpoints, in
    both orders, and with two image metrics. Prints and writes the paper's table of judges.

    You can compare presets of one project (--project; missing models are trained as in the ablation), projects of one
    capture (--projects), or folders of rendered images with equal names (--folders). Nothing is sent unless --judges
    names a model.
    """

    project: Path | None = None
    """A project whose presets are compared."""
    presets: tuple[str, ...] = ("splatfacto-i", "splatfacto-w", "3dgs")
    """Presets to compare. Those that were not trained with these steps, image size and cap are trained."""
    projects: tuple[Path, ...] = ()
    """Instead of --project: two or more projects of one capture."""
    folders: tuple[Path, ...] = ()
    """Instead of --project: two or more folders of images with equal names. Images below novel/ are novel views."""
    reference: Path | None = None
    """With --folders: a folder of photographs with equal names, for LPIPS."""
    judges: tuple[str, ...] = ()
    """MODEL@URL of each judge, such as gpt-5@https://api.openai.com/v1 or
    gemini-2.5-flash@https://generativelanguage.googleapis.com/v1beta/openai."""
    key_variables: tuple[str, ...] = ()
    """Environment variables with the keys, one for each judge. Default: OPENAI_API_KEY or GEMINI_API_KEY for the
    endpoints of these two companies, else NVSIM_ENDPOINT_KEY."""
    prices_in: tuple[float, ...] = ()
    """Price of a million input tokens, one for each judge."""
    prices_out: tuple[float, ...] = ()
    """Price of a million output tokens, one for each judge."""
    asking: Inline[AskingOptions] = field(default_factory=AskingOptions)
    prompt: Path | None = None
    """File with the prompt for the judges. Default: nvsim_resources/prompts/judge.txt."""
    seen: int = 5
    """Number of views per submap that its models were trained on."""
    novel: int = 20
    """Number of views per submap at poses without an image."""
    submaps: tuple[int, ...] = ()
    """Only these submaps. Default: all."""
    image_width: int = 640
    """Longest side of the images, pixels."""
    seed: int = 0
    """Random seed of the training and of the novel views."""
    steps: int | None = None
    """Steps of every model of --presets. Default: as in the preset nvsim."""
    image_size: int | None = None
    """Longest side of their training images, pixels. Default: as in the preset nvsim."""
    gaussian_cap: int | None = None
    """Largest number of Gaussians of each. Default: as in the preset nvsim."""
    truth: Path | None = None
    """Folder with novel views (holdout_frames.txt, novel/). Default: the project's own ground truth."""
    lpips: Path | None = None
    """An ONNX export of LPIPS. Default: lpips.onnx in the models folder ($NVSIM_MODELS)."""
    lpips_range: Literal["auto", "-1..1", "0..1"] = "auto"
    """Range of that network's input values. auto: as its metadata input_range says, else -1..1."""
    out: Path | None = None
    """Folder for images, answers and tables. Default: judge/ in the project."""
    json: bool = False
    """Print the results as JSON."""

    def run(self) -> int:
        from nvsim.cli.consent import exit_code
        from nvsim.cli.console import event_listener
        from nvsim.evaluation.judging.compared_images import STAGE
        from nvsim.evaluation.judging.report import text_of, write_report
        from nvsim.evaluation.judging.verdicts import table_rows
        from nvsim.evaluation.scores import open_lpips
        from nvsim.events import Done

        _check(self)
        endpoints = _endpoints(self)
        distance, why = open_lpips(self.lpips, self.lpips_range)
        with ExitStack() as stack:
            if self.project is not None:
                from nvsim.cli.session import project_job

                project, listen = stack.enter_context(project_job(self.project, "evaluate judge", self.json))
                out = self.out or project.layout.root / "judge"
                shown = _by_presets(self, project, out, listen)
            else:
                listen = stack.enter_context(event_listener(self.json))
                assert self.out is not None
                out = self.out
                shown = _by_projects(self, out, listen) if self.projects else _by_folders(self)
            judged = _collect_verdicts(self, endpoints, shown, out, distance, why, listen)
            files = write_report(judged, shown, out)
            results: dict[str, Any] = {"rows": table_rows(judged, shown), "files": [str(f) for f in files]}
            if self.project is not None:
                project.set_result("judge", results)
            listen(Done(STAGE, f"{len(judged)} judges on {len(shown)} views; {out}", results))
        if not self.json:
            print(text_of(judged, shown), end="", flush=True)
        elif self.project is None:
            print_lines(as_json(results))
        asked = [one for one in judged if one.judge in endpoints and one.verdicts]
        return exit_code([one.judge for one in asked if all(verdict.won is None for verdict in one.verdicts)])


def _check(a: EvaluateJudge) -> None:
    ways = [name for name in ("project", "projects", "folders") if getattr(a, name)]
    if len(ways) != 1:
        raise InputError("Name what to compare with exactly one of --project (with --presets), --projects, --folders.")
    if ways[0] != "project" and a.out is None:
        raise InputError(f"Images and tables need a folder; give --out DIR with --{ways[0]}.")
    count = {"project": len(set(a.presets)), "projects": len(a.projects), "folders": len(a.folders)}[ways[0]]
    if count < 2:
        raise InputError(
            f"A comparison needs two or more; name another of --{'presets' if ways[0] == 'project' else ways[0]}."
        )
    if a.reference is not None and not a.folders:
        raise InputError("--reference works only with --folders; projects have their own photographs.")
    if min(a.seen, a.novel) < 0 or a.seen + a.novel == 0 or max(a.seen, a.novel) > 10_000:
        raise InputError(f"--seen {a.seen} and --novel {a.novel} give no views to compare; raise at least one of them.")
    if not 16 <= a.image_width <= 4096:
        raise InputError(f"--image-width {a.image_width} is out of range; give 16 to 4096 pixels.")
    if a.out is not None:
        refuse_unwritable_folder(a.out)


def _endpoints(a: EvaluateJudge) -> dict[str, tuple[Endpoint, Prices]]:
    """Judge -> its endpoint and its prices."""
    from nvsim.endpoint.connection import http_package

    for flag, given in (
        ("--key-variables", a.key_variables),
        ("--prices-in", a.prices_in),
        ("--prices-out", a.prices_out),
    ):
        if given and len(given) != len(a.judges):
            raise InputError(f"{flag} has {len(given)} values for {len(a.judges)} judges; give one for each.")
    if a.judges:
        http_package()
    found = {}
    for i, judge in enumerate(a.judges):
        model, at, url = judge.rpartition("@")
        if not at:
            raise InputError(
                f"--judges {judge!r} is not MODEL@URL; name both, such as gpt-5@https://api.openai.com/v1."
            )
        endpoint = Endpoint.of(url, model, a.key_variables[i] if a.key_variables else "")
        prices = Prices(a.prices_in[i] if a.prices_in else None, a.prices_out[i] if a.prices_out else None)
        name = model if model not in found else f"{model} at {endpoint.url}"
        if name in found:
            raise InputError(f"--judges names {judge} twice; name each judge once.")
        found[name] = endpoint, prices
    return found


def _by_presets(a: EvaluateJudge, project: Any, out: Path, listen: Listener) -> list[ContestantImages]:
    from nvsim.evaluation.ablation import chosen_submaps
    from nvsim.evaluation.ablation_runs import Budget, preset_rows
    from nvsim.evaluation.judging.compared_images import by_presets
    from nvsim.evaluation.judging.views import ViewCounts, judged_views
    from nvsim.evaluation.truth import truth_of

    submaps = chosen_submaps(project, a.submaps)
    rows = {row.name: row for row in preset_rows(Budget(a.steps, a.image_size, a.gaussian_cap), a.presets)}
    counts = ViewCounts(a.seen, a.novel, a.seed, a.image_width)
    views = judged_views(project, submaps, truth_of(project, a.truth), counts)
    chosen = [rows[name] for name in dict.fromkeys(a.presets)]
    return by_presets(project, chosen, submaps, a.seed, views, out, listen)


def _by_projects(a: EvaluateJudge, out: Path, listen: Listener) -> list[ContestantImages]:
    from nvsim.evaluation.ablation import chosen_submaps
    from nvsim.evaluation.judging.compared_images import by_projects
    from nvsim.evaluation.judging.views import ViewCounts, judged_views
    from nvsim.evaluation.truth import truth_of
    from nvsim.project.project import Project

    with ExitStack() as stack:
        opened = {name: stack.enter_context(Project.open(path)) for name, path in _unique_names(a.projects).items()}
        first = next(iter(opened.values()))
        counts = ViewCounts(a.seen, a.novel, a.seed, a.image_width)
        views = judged_views(first, chosen_submaps(first, a.submaps), truth_of(first, a.truth), counts)
        return by_projects(opened, views, out, listen)


def _by_folders(a: EvaluateJudge) -> list[ContestantImages]:
    from nvsim.evaluation.judging.compared_images import by_folders

    return by_folders(_unique_names(a.folders), a.reference)


def _unique_names(paths: tuple[Path, ...]) -> dict[str, Path]:
    """Short unique name -> path, with the parent's name if two are equal. Raises InputError if a path is repeated."""
    resolved = [path.resolve() for path in paths]
    names = [path.stem if path.suffix == ".nvsim" else path.name for path in resolved]
    full = [name if names.count(name) == 1 else f"{path.parent.name}-{name}" for name, path in zip(names, resolved)]
    if len(set(full)) < len(full):
        raise InputError(
            "Two of the compared folders have the same name; rename one, so that the table can distinguish them."
        )
    return dict(zip(full, paths))


def _collect_verdicts(
    a: EvaluateJudge,
    endpoints: dict[str, tuple[Endpoint, Prices]],
    shown: list[ContestantImages],
    out: Path,
    distance: Distance | None,
    why: str,
    listen: Listener,
) -> list[Any]:
    """The verdicts of all judges, metrics first. Results of the metrics are written before any model is asked, and
    results of each judge before the next one is asked."""
    from nvsim.evaluation.judging.judges import by_lpips, by_sharpness
    from nvsim.evaluation.judging.report import write_report

    judged = [by_lpips(shown, distance, why), by_sharpness(shown)]
    if not endpoints:
        return judged
    from nvsim.cli.consent import ask_for_consent
    from nvsim.endpoint.budget import Budget
    from nvsim.endpoint.client import Client
    from nvsim.evaluation.judging.judges import JudgeRequester, read_prompt

    asker = JudgeRequester(read_prompt(a.prompt), a.image_width)
    write_report(judged, shown, out)
    clients = {}
    for name, (endpoint, prices) in endpoints.items():
        budget = Budget(prices, a.asking.budget_tokens, a.asking.budget_money)
        clients[name] = Client(endpoint, StoredAnswers(out / "answers"), budget, a.asking, listen)
    try:
        asked = [(c.endpoint, asker.estimate(c, shown), c.budget.prices) for c in clients.values()]
        notes = ["NVSim sends pairs of rendered images, each in both orders. Budgets apply to each judge."]
        agreed = ask_for_consent(asked, notes, a.asking.yes)
        for name, client in clients.items():
            client.may_send = agreed
            judged.append(asker.judge(client, name, shown, listen))
            write_report(judged, shown, out)
    finally:
        for client in clients.values():
            client.close()
    return judged
