"""Finds the stages whose results were computed from other content than the present one: from another capture, or before
the user removed or restored Gaussians."""

from __future__ import annotations

from nvsim.project import ledger
from nvsim.project.project import Project
from nvsim.project.state.results import CONTENT, StageResults, first_outdated_stage
from nvsim.project.work import STAGE, STAGES, StageName

_OTHER = "other content"


def outdated_stages(project: Project) -> frozenset[StageName]:
    """The stages with a result that was computed from other content than the present one. Raises InputError if files
    are damaged."""
    found, capture, content = project.stage_results(), project.capture(), ledger.content_key(project)
    if capture is not None and not capture.has_images:
        found = _with_content_by_keys(project, found, content)
    return found.outdated(content)


def outdated_sentences(project: Project, until: StageName = STAGES[-1]) -> tuple[str, ...]:
    """Sentences about the outdated results of the stages up to `until`, and the commands that compute them again; empty
    if there are none. Raises InputError if files are damaged."""
    capture = project.capture()
    outdated = outdated_stages(project) & frozenset(STAGES[: STAGES.index(until) + 1])
    content = "capture" if capture is None or capture.has_images else "splat"
    first = first_outdated_stage(outdated, frozenset(), content)
    if first is None:
        return ()
    commands = [f"`nvsim {STAGE[stage].command} --project`" for stage in STAGES if stage in outdated]
    return first[1], f"{' and '.join(commands)} {'computes' if len(commands) == 1 else 'compute'} the results again."


def _with_content_by_keys(project: Project, found: StageResults, content: str) -> StageResults:
    """With the content of the results of splat files from earlier versions, which did not record it. It is the present
    one if the stage would not run again."""
    from nvsim.project.graph import thresholds_of
    from nvsim.project.stages.levels import levels_key
    from nvsim.project.stages.mapped import map_key

    keys = {"floors": levels_key, "map": lambda project: map_key(project, thresholds_of(project))}
    for stage, key_now in keys.items():
        part = found.part(stage)
        if part is not None and CONTENT not in part.summary:
            found = found.with_content(stage, content if part.key == key_now(project) else _OTHER)
    return found
