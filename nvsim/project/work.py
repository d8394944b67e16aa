"""The table of all work on a project, one row per command. It defines the help of the command line, the order and
inputs of the stages, the menus of the window and the reasons for unavailable commands, and the commands that can be
jobs.

It is imported before any command is known, so it imports only the errors. A NamedTuple is faster to define there than a
dataclass.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

from nvsim.errors import InputError

StageName = Literal["import", "submaps", "depth", "floors", "train", "map"]
"""The steps of the main job in order. The result of each stays in the project."""
STAGES: tuple[StageName, ...] = get_args(StageName)


class ProjectCommand(NamedTuple):
    """A command that works on a project.

    verb            `nvsim VERB` runs it
    title           name of the command in the window
    summary         one clause about it, without capital and period
    needs           the stage whose result it needs; None if it needs none
    heavy           whether it waits until no other heavy job runs on the project
    renders_models  whether it also renders the trained models
    """

    verb: str
    title: str
    summary: str
    needs: StageName | None
    heavy: bool = True
    renders_models: bool = False

    @property
    def prints_figures(self) -> bool:
        """Whether its result is figures, which it can print as JSON."""
        return self.verb.startswith("evaluate ")


class StageTexts(NamedTuple):
    """Texts about a stage, by the state of its result.

    result             the result, as in "the project has no RESULT yet"
    missing            the reason why work that needs the result cannot start, without capital and period
    how_made           how the result was made, as in "the capture has changed since MADE"
    from_previous_cut  the result belongs to a previous cut into submaps; "" if that is impossible
    command            the command that makes the result, without `nvsim`
    """

    result: str
    missing: str
    how_made: str
    from_previous_cut: str
    command: str

    def outdated(self, content: str = "capture") -> str:
        """A sentence about a result that was computed from an earlier `content`: "capture" or "splat". "" if that is
        impossible."""
        return f"The {content} has changed since {self.how_made}." if self.how_made else ""


WORK: dict[str, ProjectCommand] = {
    row.verb: row
    for row in (
        ProjectCommand("import", "Import a capture", "read a capture into a project", None),
        ProjectCommand("submaps", "Cut into submaps", "cut the trajectory into overlapping submaps", "import"),
        ProjectCommand(
            "depth", "Estimate depth", "estimate depth from the images if the capture has no LiDAR scan", "import"
        ),
        ProjectCommand("floors", "Find the floor", "find the floor in every frame", "submaps"),
        ProjectCommand("train", "Train", "fit the floor-aware Gaussian model of each submap", "floors"),
        ProjectCommand("map", "Build the map", "build the navigation graph from the trained models", "train"),
        ProjectCommand(
            "evaluate views", "Evaluate views", "compute PSNR, SSIM and LPIPS of the held-out frames", "train"
        ),
        ProjectCommand(
            "evaluate floor",
            "Evaluate floor masks",
            "compute the IoU of the floor masks against ground truth",
            "floors",
        ),
        ProjectCommand(
            "evaluate depth", "Evaluate depth", "compute the error of the estimated depth against true depth", "depth"
        ),
        ProjectCommand(
            "evaluate graph",
            "Evaluate the graph",
            "compute validity, coverage and structure of the graph against an occupancy map",
            "map",
            heavy=False,
        ),
        ProjectCommand(
            "evaluate calibration",
            "Calibrate the thresholds",
            "show benefit and cost of each threshold of the map builder, against an occupancy map",
            "map",
            heavy=False,
        ),
        ProjectCommand(
            "evaluate ablation",
            "Run the ablation",
            "run the paper's ablation and the comparison of the presets",
            "floors",
        ),
        ProjectCommand(
            "evaluate validity-table",
            "Compare maps of all presets",
            "train the presets, build their maps under each set of criteria, and print the paper's table of validities",
            "floors",
        ),
        ProjectCommand(
            "export r2r",
            "Export R2R",
            "write R2R connectivity and scans.txt, which agents read unchanged",
            "map",
            heavy=False,
        ),
        ProjectCommand(
            "export scan",
            "Export scan for agents",
            "write a scan in Matterport's layout: connectivity, skyboxes with depth, views, floor plans",
            "map",
            renders_models=True,
        ),
        ProjectCommand(
            "export features",
            "Export features for agents",
            "write features of the views of an exported scan in the file formats of agents",
            "map",
        ),
        ProjectCommand(
            "export tasks",
            "Export tasks",
            "sample paths of a benchmark from exported scans, with instructions, as R2R_<split>.json",
            "map",
            heavy=False,
        ),
        ProjectCommand(
            "export dataset",
            "Export a dataset",
            "make a benchmark: a scan for agents, features, tasks with instructions, and a table of baselines",
            "map",
            renders_models=True,
        ),
        ProjectCommand(
            "export splats",
            "Export splats",
            "write trained submaps as PLY, compressed PLY or SPZ, and their floors as glTF",
            "train",
            heavy=False,
        ),
        ProjectCommand(
            "r2r train",
            "Train an agent",
            "train an agent that reads instructions on exported scans, tasks and features",
            "map",
        ),
        ProjectCommand("video", "Video", "render a camera path as video frames", "train", heavy=False),
        ProjectCommand(
            "demo", "The built-in building", "run the whole job on the built-in building, then open the window", None
        ),
        ProjectCommand("restore", "Earlier results", "restore the previous result of a stage, or delete it", None),
    )
}
"""All commands that can be jobs, by verb."""

STAGE: dict[StageName, StageTexts] = {
    "import": StageTexts("capture", "the project has no capture yet", "", "", "import CAPTURE"),
    "submaps": StageTexts(
        "submaps", "the trajectory is not divided into submaps yet", "it was divided into submaps", "", "submaps"
    ),
    "depth": StageTexts("depth", "no depth is estimated yet", "depth was estimated", "", "depth"),
    "floors": StageTexts(
        "floor masks",
        "the floor is not found yet",
        "the floor was found",
        "The floor belongs to a previous cut into submaps.",
        "floors",
    ),
    "train": StageTexts(
        "trained submap",
        "no submap is trained completely yet",
        "the submaps were trained",
        "The models in use belong to a previous cut into submaps.",
        "train",
    ),
    "map": StageTexts("navigation graph", "no navigation graph is built yet", "the map was built", "", "map"),
}
SPLAT_STAGES: tuple[StageName, ...] = ("import", "floors", "map")
"""The stages of a project from splat files. Its submaps and models are part of the import."""
PIPELINE: tuple[StageName, ...] = STAGES[1:]
"""The stages after the import, in the order in which the window runs them."""
FROM_A_CUT = tuple(stage for stage in STAGES if STAGE[stage].from_previous_cut)
"""The stages whose results belong to one cut of the trajectory."""
NEEDS_IMAGES = frozenset(
    ("submaps", "depth", "train", "evaluate views", "evaluate floor", "evaluate depth", "evaluate ablation")
    + ("evaluate validity-table",)
)
"""Commands that a project from splat files cannot run."""
NO_IMAGES = "the project was made from splat files, which have no images"
EVALUATIONS = tuple(verb for verb, row in WORK.items() if row.prints_figures)
EXPORTS = tuple(verb for verb in WORK if verb.startswith("export "))


def sentence(words: str) -> str:
    """`words` with a capital and a period."""
    return f"{words[:1].upper()}{words[1:]}."


def missing_result_error(project: object, stage: StageName) -> InputError:
    """The error for a project at the path `project` that lacks the needed result of `stage`."""
    row = STAGE[stage]
    return InputError(f"{project} has no {row.result} yet; run `nvsim {row.command} --project` first.")
