"""Tells which stages have a result, and which results are outdated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

from nvsim.files.tables import COUNT, NUMBER, TEXT
from nvsim.project import results
from nvsim.project.work import FROM_A_CUT, STAGE, STAGES, StageName

if TYPE_CHECKING:
    from nvsim.project.project import Project

_ROW = {"stage": TEXT, "part": COUNT, "key": TEXT, "state": TEXT, "finished": NUMBER.or_null}


@dataclass(frozen=True)
class StageStates:
    """The states of all stages. Two values are equal if no stage began, ended or was restored in between.

    done      stages that finished
    outdated  stages in `done` that finished before the present capture was imported
    former    stages whose result in use belongs to a previous cut into submaps
    kept      stages with an earlier result that can be restored
    rows      the database rows of all parts of stages
    """

    done: frozenset[StageName] = frozenset()
    outdated: frozenset[StageName] = frozenset()
    former: frozenset[StageName] = frozenset()
    kept: frozenset[StageName] = frozenset()
    rows: tuple[tuple[object, ...], ...] = ()


def stage_states(project: Project) -> StageStates:
    """The present states of the stages. Raises InputError if the database is damaged."""
    c, rows = project.connection, tuple(project.read("stages", _ROW))
    ended = {(stage, part): at for stage, part, _, state, at in rows if state == "done"}
    imported = ended.get(("import", 0))
    done = {stage for stage, _ in ended}
    early = {stage for (stage, _), at in ended.items() if imported and at and at < imported}
    return StageStates(
        _named(done),
        _named(early),
        frozenset(stage for stage in FROM_A_CUT if results.is_former(c, stage)),
        frozenset(stage for stage in STAGES if results.kept(c, stage) is not None),
        rows,
    )


def first_stale(outdated: frozenset[StageName], former: frozenset[StageName]) -> tuple[StageName, str] | None:
    """The first stage with a result of another capture or cut than the present one, and a sentence about it; None if
    there is none."""
    for stage in STAGES:
        if stage in outdated:
            return stage, STAGE[stage].outdated
        if stage in former:
            return stage, STAGE[stage].former
    return None


def _named(found: set[object]) -> frozenset[StageName]:
    """The names that are stages; a damaged or newer project may have others."""
    return cast(frozenset[StageName], frozenset(found) & frozenset(STAGES))
