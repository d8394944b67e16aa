"""Which stages have a result, and which of the results are stale."""

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
    """Equal as long as no stage of the project began, ended or was restored.

    done      the stages that ended well
    outdated  those among them that ended before the capture was what it is now
    former    those whose result in use belongs to a former cut into submaps
    kept      those of which an earlier result can be restored
    rows      what the database says of every part of a stage
    """

    done: frozenset[StageName] = frozenset()
    outdated: frozenset[StageName] = frozenset()
    former: frozenset[StageName] = frozenset()
    kept: frozenset[StageName] = frozenset()
    rows: tuple[tuple[object, ...], ...] = ()


def stage_states(project: Project) -> StageStates:
    """The states of the stages of the project now. Raises InputError where its database is damaged."""
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
    """The first stage that was done for another capture, or another cut, than there is now, and a sentence that says
    so; None where there is none."""
    for stage in STAGES:
        if stage in outdated:
            return stage, STAGE[stage].outdated
        if stage in former:
            return stage, STAGE[stage].former
    return None


def _named(found: set[object]) -> frozenset[StageName]:
    """Those of a damaged or newer project that are stages."""
    return cast(frozenset[StageName], frozenset(found) & frozenset(STAGES))
