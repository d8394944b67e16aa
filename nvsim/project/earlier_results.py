"""Describes, restores and deletes the previous result of each stage."""

from __future__ import annotations

import time
from dataclasses import dataclass

from nvsim.errors import InputError
from nvsim.events import Listener, Log
from nvsim.files.atomic import write_bytes
from nvsim.files.opening import read_bytes
from nvsim.graph.store import decode_graph, encode_graph
from nvsim.project.project import Project
from nvsim.project.state import cuts, graph_table, results
from nvsim.project.state.cuts import load_cut
from nvsim.project.state.results import NOWHERE, StageResult, bytes_of
from nvsim.project.work import STAGES


@dataclass(frozen=True)
class KeptResult:
    """A result that can be restored: its stage, its description, and its size on disk in bytes."""

    stage: str
    words: str
    bytes: int


def megabytes(bytes: int) -> str:
    """A size in words: "12 MB"."""
    return f"{bytes / 1e6:,.0f} MB" if bytes >= 1e6 else f"{bytes / 1e3:,.0f} kB"


def kept_results(project: Project) -> tuple[KeptResult, ...]:
    """The results that can be restored, at most one per stage, in the order of the stages."""
    now, root = project.stage_results(), project.root
    return tuple(
        KeptResult(stage, describe(result, stage), bytes_of(root, result, now.in_use(stage, root)))
        for stage in STAGES
        if (result := now.get("previous", stage)) is not None
    )


def restore(project: Project, stage: str) -> str:
    """Restores the previous result of a stage and keeps the present one in its place, so that a second call restores
    the present one. Returns a description of the restored result. All changes are one transaction.

    Raises InputError if there is no previous result, or its files are missing or damaged.
    """
    before, root = need_kept(project, stage), project.root
    missing = sorted(
        place
        for name, place in before.files.items()
        if (name == "graph" or place != NOWHERE) and not (root / place).exists()
    )
    if missing:
        raise InputError(f"{root / missing[0]} is missing, so the last result of {stage} cannot be restored.")
    if stage in ("import", "submaps"):
        project.fix_cut()
    now = project.stage_results().in_use(stage, root)
    if now is not None and stage == "map":
        now = StageResult(now.parts, graph_in_file(project))
    cut, graph = before.files.get("cut/submaps"), before.files.get("graph")
    submaps = None if cut is None else project.with_frames_of_capture(load_cut(root / cut))
    restored = None if graph is None else decode_graph(read_bytes(root / graph))
    found = project.stage_results().with_result_in_use(stage, before).with_result("previous", stage, now)
    with project.transaction() as c:
        results.write(c, found)
        if submaps is not None:
            cuts.write_rows(c, submaps)
        if restored is not None:
            graph_table.write(c, restored)
    results.remove_unreferenced_files(found, root)
    if submaps is not None:
        from nvsim.submaps.picture import draw_submaps

        draw_submaps(project.need_capture().positions, submaps, project.layout.pictures / "submaps.png")
    return describe(before, stage)


def discard(project: Project, stage: str) -> int:
    """Deletes the previous result of a stage; the result in use stays. Returns the freed bytes. Raises InputError if
    there is no previous result."""
    before, found = need_kept(project, stage), project.stage_results()
    freed = bytes_of(project.root, before, found.in_use(stage, project.root))
    project.set_stage_results(found := found.with_result("previous", stage, None))
    results.remove_unreferenced_files(found, project.root)
    return freed


def need_kept(project: Project, stage: str) -> StageResult:
    """The previous result of a stage. Raises InputError if there is none."""
    found = project.stage_results().get("previous", stage)
    if found is None:
        raise InputError(f"{project.root} keeps no earlier result of {stage}; run the stage again to have one.")
    return found


def graph_in_file(project: Project) -> dict[str, str]:
    """Writes the graph in use, with its edits, to a separate file, before another one replaces it in the database.
    Returns {"graph": place} for the kept result, or {} if there is no graph. Raises InputError if the disk reports an
    error."""
    graph = project.graph()
    if graph is None:
        return {}
    place = f"kept/graph.{project.new_number()}"
    write_bytes(project.root / place, encode_graph(graph))
    return {"graph": place}


def replaced_result_sentence(project: Project, stage: str, only: tuple[int, ...] = ()) -> str:
    """One sentence about the result that the stage replaces when it runs, and how long it stays in use. `only` limits
    it to these submaps. "" if there is no result."""
    now = project.stage_results()
    found = now.in_use(stage, project.root)
    if found is None:
        return ""
    former = stage == "train" and stage in now.stages_of_previous_cut
    if stage == "train" and only and not former and found.parts:
        found = StageResult({number: part for number, part in found.parts.items() if number in only})
        if not found.parts:
            return ""
    if stage in ("import", "submaps", "map"):
        end = "the old one stays until the new one is finished"
    else:
        end = "the old ones stay until the new ones are finished"
    if former:
        end = "the old ones stay until the new ones of all submaps are finished"
    instead = "replaces the earlier result, which `nvsim restore` can restore until then"
    then = instead if stage in now.restorable_stages else "can be restored afterward"
    return f"{stage} replaces {describe(found, stage, former)}; {end}, and {then}."


def report_replaced_result(project: Project, stage: str, listen: Listener, only: tuple[int, ...] = ()) -> None:
    """Sends the sentence of `replaced_result_sentence` to `listen`."""
    sentence = replaced_result_sentence(project, stage, only)
    if sentence:
        listen(Log(sentence, stage))


def describe(result: StageResult, stage: str, former: bool = False) -> str:
    """A result in words, for example "the models of 3 submaps (2000 steps, finished 2026-11-22 05:31)"."""
    what, figures = _describe_result(result, stage)
    ended = max((part.finished for part in result.parts.values()), default=0.0)
    when = [time.strftime("finished %Y-%m-%d %H:%M", time.localtime(ended))] if ended else []
    about = ", ".join([*figures, *when])
    return f"{what}{' of the previous cut' if former else ''}{f' ({about})' if about else ''}"


def _describe_result(result: StageResult, stage: str) -> tuple[str, list[str]]:
    parts = result.parts
    summary = parts[min(parts)].summary if parts else {}
    if stage == "train":
        models = len(parts) or sum(name.startswith("models/") for name in result.files)
        steps = sorted({int(p.summary["steps"]) for p in parts.values() if "steps" in p.summary})
        figures = [f"{' and '.join(map(str, steps))} steps"] if steps else []
        return f"the {'model' if models == 1 else 'models'} of {_count(models, 'submap')}", figures
    if stage == "depth":
        skipped = summary.get("skipped")
        what = (
            "the decision that no depth is estimated"
            if skipped
            else f"the depth of {_count(summary.get('frames', 0), 'frame')}"
        )
        return what, []
    if stage == "floors" and "storeys" in summary:  # of a splat file
        return f"the floor heights and the known floor of {_count(summary['storeys'], 'storey')}", []
    if stage == "floors":
        return f"the floor masks of {_count(summary.get('frames', 0), 'frame')}", []
    if stage == "submaps":
        return f"the cut into {_count(summary.get('submaps', 0), 'submap')}", []
    if stage == "import" and "gaussians" in summary:
        return f"the splat of {_count(summary['gaussians'], 'Gaussian')}", []
    if stage == "import":
        return f"the capture of {_count(summary.get('frames', 0), 'frame')}", []
    size = [_count(summary.get("viewpoints", 0), "viewpoint"), _count(summary.get("edges", 0), "edge")]
    return "the navigation graph and its edits", size


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"
