"""The work that there is on a project, one row a command: the command line's help, the order of the stages, what each
needs, the window's menus and reasons, and what a job may be are all read from this table.

It is imported before any command is known, so it imports nothing but the errors; a NamedTuple costs less there than a
dataclass.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

from nvsim.errors import InputError

StageName = Literal["import", "submaps", "depth", "floors", "train", "map"]
"""The steps of the main job, in their order; each makes a result that stays in the project."""
STAGES: tuple[StageName, ...] = get_args(StageName)


class Work(NamedTuple):
    """A command that works on a project.

    verb            `nvsim VERB` runs it
    title           what the window calls it
    does            one sentence about it, without its capital and its full stop
    needs           the stage whose result it begins with; None where it needs none
    heavy           whether it waits until no other heavy job runs on the project
    prints_figures  whether figures are its result, which it prints as JSON when it is asked to
    draws           whether it draws with the models too, beside what it needs
    """

    verb: str
    title: str
    does: str
    needs: StageName | None
    heavy: bool = True
    prints_figures: bool = False
    draws: bool = False


class Stage(NamedTuple):
    """The words about a stage, by the state of its result.

    result    the result, as in "the project has no RESULT yet"
    lacking   why what needs the result cannot begin, without capital and full stop
    outdated  the result was made before the capture was what it is now
    former    the result belongs to a former cut into submaps; "" where that cannot be
    command   what makes it, after `nvsim`
    """

    result: str
    lacking: str
    outdated: str
    former: str
    command: str


WORK: dict[str, Work] = {
    row.verb: row
    for row in (
        Work("import", "Import a capture", "read a capture into a project", None),
        Work("submaps", "Cut into submaps", "cut the trajectory into overlapping submaps", "import"),
        Work(
            "depth", "Estimate depth", "estimate dense depth from the images, where no scan lies beside them", "import"
        ),
        Work("floors", "Find the floor", "find the floor in every frame", "submaps"),
        Work("train", "Train", "fit the floor-aware Gaussian model of each submap", "floors"),
        Work("map", "Build the map", "walk the models and build the navigation graph", "train"),
        Work(
            "evaluate views",
            "Evaluate views",
            "PSNR, SSIM and LPIPS of the frames held out of training",
            "train",
            prints_figures=True,
        ),
        Work(
            "evaluate floor",
            "Evaluate floor masks",
            "IoU of the floor masks against a truth",
            "floors",
            prints_figures=True,
        ),
        Work(
            "evaluate depth",
            "Evaluate depth",
            "how near the depth of the images comes to a true one",
            "depth",
            prints_figures=True,
        ),
        Work(
            "evaluate graph",
            "Evaluate the graph",
            "validity, coverage and structure of the graph against an occupancy map",
            "map",
            heavy=False,
            prints_figures=True,
        ),
        Work(
            "evaluate calibration",
            "Calibrate the thresholds",
            "what every threshold of the map builder buys and costs, against an occupancy map",
            "map",
            heavy=False,
            prints_figures=True,
        ),
        Work(
            "evaluate ablation",
            "Run the ablation",
            "train and print the paper's ablation and the comparison of the presets",
            "floors",
            prints_figures=True,
        ),
        Work(
            "evaluate validity-table",
            "Compare maps of all presets",
            "train the presets, build their maps under each set of criteria and print the paper's table of validities",
            "floors",
            prints_figures=True,
        ),
        Work(
            "export r2r",
            "Export R2R",
            "write R2R connectivity and scans.txt, which agents load unchanged",
            "map",
            heavy=False,
        ),
        Work(
            "export scan",
            "Export scan for agents",
            "write a scan in Matterport's layout: connectivity, skyboxes with depth, views, floor plans",
            "map",
            draws=True,
        ),
        Work(
            "export features",
            "Export features for agents",
            "write features of the views of an exported scan in the files that agents read",
            "map",
        ),
        Work(
            "export tasks",
            "Export tasks",
            "sample the paths of a benchmark from exported scans, with instructions, as R2R_<split>.json",
            "map",
            heavy=False,
        ),
        Work(
            "export dataset",
            "Export a dataset",
            "make a benchmark: a scan for agents, features, tasks with instructions, and the table of the baselines",
            "map",
            draws=True,
        ),
        Work(
            "export splats",
            "Export splats",
            "write trained submaps as PLY, compressed PLY or SPZ, and their floors as glTF",
            "train",
            heavy=False,
        ),
        Work(
            "r2r train",
            "Train an agent",
            "train an agent that reads instructions on exported scans, tasks and features",
            "map",
        ),
        Work("video", "Video", "draw a camera path as video frames", "train", heavy=False),
        Work("demo", "The built-in building", "the whole job on the built-in building, then the window", None),
        Work(
            "restore",
            "Earlier results",
            "go back to the result of a stage before its last run, or let go of what is kept",
            None,
        ),
    )
}
"""Every command that may be a job, by its verb."""

STAGE: dict[StageName, Stage] = {
    "import": Stage("capture", "the project has no capture yet", "", "", "import CAPTURE"),
    "submaps": Stage(
        "submaps",
        "the trajectory is not divided into submaps yet",
        "The capture has grown since it was divided into submaps.",
        "",
        "submaps",
    ),
    "depth": Stage(
        "depth",
        "no depth is estimated from the images yet",
        "The capture has grown since depth was estimated.",
        "",
        "depth",
    ),
    "floors": Stage(
        "floor masks",
        "the floor is not found in the frames yet",
        "The capture has grown since the floor was found.",
        "The floor was found with a former cut into submaps.",
        "floors",
    ),
    "train": Stage(
        "trained submap",
        "no submap is trained to the end yet",
        "The capture has grown since the submaps were trained.",
        "The models in use are of a former cut into submaps.",
        "train",
    ),
    "map": Stage(
        "navigation graph",
        "no navigation graph is built yet",
        "The capture has grown since the map was built.",
        "",
        "map",
    ),
}
PIPELINE: tuple[StageName, ...] = STAGES[1:]
"""What follows an import; the stages that the window runs in their order."""
FROM_A_CUT = tuple(stage for stage in STAGES if STAGE[stage].former)
"""The stages whose result belongs to one cut of the trajectory."""
EVALUATIONS = tuple(verb for verb, row in WORK.items() if row.prints_figures)
EXPORTS = tuple(verb for verb in WORK if verb.startswith("export "))


def sentence(words: str) -> str:
    """`words` with a capital and a full stop."""
    return f"{words[:1].upper()}{words[1:]}."


def lacks(project: object, stage: StageName) -> InputError:
    """The error for a project at the path `project` that lacks the result of `stage`, which is needed."""
    row = STAGE[stage]
    return InputError(f"{project} has no {row.result} yet; run `nvsim {row.command} --project` first.")
