"""`nvsim VERB ...`: finds the command, runs it, and turns every failure into one sentence and an exit code.

0 done, 2 the user's mistake, 1 ours, 130 stopped. Nothing heavy is imported before the command is known.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence

from nvsim.cli.terminal import say, screened
from nvsim.project.work import STAGES, WORK

# verb -> (module under nvsim.cli.commands, what it does)
COMMANDS: dict[str, tuple[str, str]] = {
    "demo": ("demo", WORK["demo"].does),
    "run": ("run", f"the whole job on your capture: {', '.join(STAGES)}"),
    "check": ("check", "what is wrong with a capture, before any work starts"),
    "import": ("import_capture", WORK["import"].does),
    "submaps": ("submaps", WORK["submaps"].does),
    "depth": ("depth", WORK["depth"].does),
    "floors": ("floors", WORK["floors"].does),
    "train": ("train", WORK["train"].does),
    "map": ("map", WORK["map"].does),
    "restore": ("restore", WORK["restore"].does),
    "panorama": ("panorama", "draw an equirectangular image or a skybox at any place"),
    "graph select": ("graph_select", "list the viewpoints and edges for which an expression holds"),
    "graph edit": ("graph_edit", "edit the graph of a project or an R2R connectivity file by name"),
    "graph replay": ("graph_replay", "do the edits of a script again"),
    "graph log": ("graph_log", "list the edits that were made, or write them as a script"),
    "graph check": ("graph_check", "what agents or a user would stumble over in a graph, yours or any R2R file"),
    "graph propose": ("graph_propose", "edges and viewpoints that a graph lacks, with reasons, as a list or a script"),
    "graph review": ("graph_review", "the edges to look at, the least certain first"),
    "graph compare": ("graph_compare", "how one graph differs from another, and a merge of the two"),
    "graph evidence": ("graph_evidence", "measure viewpoints that were added or moved, and propose edges there"),
    "occupancy build": (
        "occupancy_build",
        "build an occupancy map from scans, depth images, or what else a capture has",
    ),
    "occupancy compare": ("occupancy_compare", "how an occupancy map differs from a true one, cell by cell"),
    "video": ("video", WORK["video"].does),
    "export r2r": ("export_r2r", WORK["export r2r"].does),
    "export scan": ("export_scan", WORK["export scan"].does),
    "r2r python": ("r2r_python", "run a program that finds NVSim's simulator where it imports MatterSim"),
    "r2r train": ("r2r_train", WORK["r2r train"].does),
    "r2r agent": ("r2r_agent", "run an agent through tasks, and write its trajectories"),
    "r2r path": ("r2r_path", "print the folder that PYTHONPATH needs for the same"),
    "export graph": (
        "export_graph",
        "write a graph as GraphML, GeoJSON, SVG, PNG or R2R, from a project or an R2R file",
    ),
    "export splats": ("export_splats", WORK["export splats"].does),
    "export candidates": (
        "export_candidates",
        "write the candidates of exported scans for agents that use no simulator",
    ),
    "export features": ("export_features", WORK["export features"].does),
    "export tasks": ("export_tasks", WORK["export tasks"].does),
    "export reviewed": ("export_reviewed", "write the tasks that were accepted in a review, as they were rewritten"),
    "export dataset": ("export_dataset", WORK["export dataset"].does),
    "evaluate views": ("evaluate_views", WORK["evaluate views"].does),
    "evaluate ablation": ("evaluate_ablation", WORK["evaluate ablation"].does),
    "evaluate floor": ("evaluate_floor", WORK["evaluate floor"].does),
    "evaluate normals": ("evaluate_normals", "how far a network's normals are from the true ones"),
    "evaluate depth": ("evaluate_depth", WORK["evaluate depth"].does),
    "evaluate graph": ("evaluate_graph", WORK["evaluate graph"].does),
    "evaluate calibration": ("evaluate_calibration", WORK["evaluate calibration"].does),
    "evaluate validity-table": ("evaluate_validity_table", WORK["evaluate validity-table"].does),
    "evaluate scan": (
        "evaluate_scan",
        "check an exported scan: files, directions, reach, seams, views from its strips",
    ),
    "evaluate r2r": ("evaluate_r2r", "score the trajectories of agents on tasks, and print the paper's table of them"),
    "evaluate judge": (
        "evaluate_judge",
        "let models that see, and figures, prefer one image of a pair: the paper's table of judges",
    ),
    "bench render": ("bench_render", "milliseconds of a view of many Gaussians, forward and backward"),
    "bench opengl": ("bench_opengl", "milliseconds of an OpenGL frame and its parts, beside the kernels"),
    "bench startup": ("bench_startup", "seconds until the help and until the window"),
    "bench app": ("bench_app", "how the window holds up: gaps, pace, sharpness, memory, a large graph"),
    "bench train": ("bench_train", "milliseconds of a training step and its parts"),
    "bench depth": ("bench_depth", "milliseconds of the depth of a frame of the built-in building"),
    "bench perception": ("bench_perception", "milliseconds of the networks of floor and normals for an image"),
    "bench panorama": ("bench_panorama", "milliseconds of panoramas, whole and of the corridors only"),
    "bench graph": ("bench_graph", "milliseconds of an edit of a large graph, seconds to open and save a file"),
    "bench simulator": ("bench_simulator", "states and images a second of the simulator that agents see"),
    "bench map": ("bench_map", "viewpoints per second of the map builder"),
    "models": ("models", "list the networks that are installed, and what others would improve"),
    "models add": ("models_add", "install a network from its ONNX files"),
    "models train": ("models_train", "train a network of floor and normals as the bundled one was"),
    "models check": ("models_check", "hold installed networks against their descriptions"),
    "app": ("app", "open the window on a project"),
}

_GROUPS = {verb.split()[0] for verb in COMMANDS if " " in verb}


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; returns its exit code."""
    with screened():
        try:
            return _run(list(sys.argv[1:] if argv is None else argv))
        except BrokenPipeError:
            # The reader of our output went away, as `head` does; nobody is left to tell.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0


def _run(arguments: list[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        say(*_help().split("\n"))
        return 0
    if arguments[0] in ("-V", "--version"):
        from nvsim import __version__

        say(f"nvsim {__version__}")
        return 0
    verb, rest = arguments[0], arguments[1:]
    if verb in _GROUPS and (verb not in COMMANDS or (rest and f"{verb} {rest[0]}" in COMMANDS)):
        if not rest or rest[0] in ("-h", "--help"):
            say(*_help(verb).split("\n"))
            return 0 if rest else 2
        verb, rest = f"{verb} {rest[0]}", rest[1:]
    if verb not in COMMANDS:
        say(f"nvsim: there is no command `{verb}`; `nvsim --help` lists them.", error=True)
        return 2
    # The thread pools of torch and numba spin against each other on few cores; passive waiting leaves them to work.
    # It has to be said before either is loaded.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    from nvsim.cli.guard import guarded

    command = importlib.import_module(f"nvsim.cli.commands.{COMMANDS[verb][0]}")
    return guarded(verb, command, rest)


def _help(group: str = "") -> str:
    rows = [(v, text) for v, (_, text) in COMMANDS.items() if not group or v.split()[0] == group]
    width = max(len(v) for v, _ in rows)
    lines = [f"  {v:<{width}}  {text}" for v, text in rows]
    head = "NVSim: from images of a building with poses to a navigation simulator.\n\nusage: nvsim COMMAND [options]"
    tail = "`nvsim COMMAND --help` explains its options. A project is a folder, NAME.nvsim."
    return "\n".join([head, "", *lines, "", tail])


if __name__ == "__main__":
    sys.exit(main())
