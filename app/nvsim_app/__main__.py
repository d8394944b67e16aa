"""`python -m nvsim_app` opens the window. The top has no heavy imports: the render process imports this file again."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def main(arguments: list[str] | None = None) -> int:
    """Parses the arguments and runs the window; returns the exit code."""
    parser = argparse.ArgumentParser(prog="nvsim app", description="Open the window, with or without a project.")
    parser.add_argument("path", nargs="?", type=Path, help="the project folder")
    parser.add_argument("--project", type=Path, help="the project folder")
    parser.add_argument("--theme", choices=("dark", "light"), help="overrides the stored theme")
    parser.add_argument("--seconds", type=float, help="close the window after this time in seconds")
    parser.add_argument("--screenshot", type=Path, help="save the fully drawn window as a PNG file and close")
    parser.add_argument(
        "--bench",
        nargs="?",
        type=int,
        const=0,
        metavar="CYCLES",
        help="measure the window's performance, print JSON, and close",
    )
    parser.add_argument(
        "--bench-edits", type=int, metavar="N", help="time the painting of N edits of a large graph and print JSON"
    )
    parser.add_argument("--viewpoints", type=int, default=10_000, help="size of the graph for --bench-edits")
    parser.add_argument("--memory", type=float, metavar="GIB", help="for trained models; stored, 0 resets it")
    parser.add_argument("--renderer", choices=("automatic", "cpu", "opengl"), help="renderer of color views; stored")
    given = parser.parse_args(arguments)
    from nvsim.cli.terminal import guard_streams

    guard_streams()
    from nvsim_app.start.main import run, run_edits

    if given.bench_edits is not None:
        return run_edits(given.bench_edits, given.viewpoints)

    return run(
        given.project or given.path,
        screenshot=given.screenshot,
        seconds=given.seconds,
        theme=given.theme,
        bench=given.bench,
        memory=given.memory,
        renderer=given.renderer,
    )


if __name__ == "__main__":
    sys.exit(main())
