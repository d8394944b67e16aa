"""The four tutorials run as written: the shell blocks in order, and the programs that they show. The project of the
first tutorial meets the truth of its building.

Some commands run differently: the installation does nothing, `nvsim app` closes its window as soon as it is drawn, and
options of the command line shorten the training and the maps of own captures. In the tutorial about the window,
`tutorial_window.py` follows the numbered steps.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from nvsim.project.project import Project
from tests.unit import textured_room as room

ROOT = Path(__file__).parents[2]
TUTORIALS = ROOT / "resources" / "docs" / "tutorials"
BLOCK = re.compile(r"^```(bash|python)\n(.*?)^```", re.MULTILINE | re.DOTALL)
TRAINING = "--train.steps 100 --train.image-size 240"
FUNCTIONS = """
nvsim() {
    case "$1 ${2:-}" in
        demo*) "$PYTHON" -m nvsim "$@" $TRAINING ;;
        run*) "$PYTHON" -m nvsim "$@" $TRAINING --map.max-viewpoints 4 ;;
        map*) "$PYTHON" -m nvsim "$@" --max-viewpoints 13 ;;
        "export scan") "$PYTHON" -m nvsim "$@" --size 64 ;;
        "r2r train") "$PYTHON" -m nvsim "$@" --iterations 20 --evaluate-every 10 ;;
        app*) "$PYTHON" $WINDOW "$2" ;;
        *) "$PYTHON" -m nvsim "$@" ;;
    esac
}
python() { "$PYTHON" "$@"; }
pip() { :; }
"""
"""The commands of the tutorials for the shell, with the options that make them shorter."""

pytestmark = pytest.mark.timeout(1200)


def blocks(name: str) -> Iterator[tuple[str, str, str]]:
    """Yields the language and the text of each block, and the sentence before it."""
    page = (TUTORIALS / f"{name}.md").read_text()
    for block in BLOCK.finditer(page):
        yield block[1], block[2], page[: block.start()].rstrip().rpartition("\n\n")[2]


def run(name: str, folder: Path, window: str = "-m nvsim_app --screenshot window.png") -> str:
    """Runs all blocks of a tutorial in `folder`, and returns what they print. `window` replaces `nvsim app`."""
    (folder / "functions.sh").write_text(FUNCTIONS)
    environment = {
        **os.environ,
        "BASH_ENV": str(folder / "functions.sh"),
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
        "PYTHON": sys.executable,
        "TRAINING": TRAINING,
        "QT_QPA_PLATFORM": "offscreen",
        "XDG_CONFIG_HOME": str(folder / "settings"),
        "WINDOW": window,
    }
    printed = []
    for language, text, before in blocks(name):
        if language == "python":
            (program,) = re.findall(r"`(\w+\.py)`", before)
            (folder / program).write_text(text)
            continue
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", text],
            cwd=folder, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"{name}.md:\n{text}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
        assert "Traceback" not in done.stderr
        printed.append(done.stdout)
    return "".join(printed)


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder after the first tutorial, and the output of its commands."""
    folder = tmp_path_factory.mktemp("tutorials")
    (folder / "packaging").mkdir()
    (folder / "packaging" / "install.sh").write_text("mkdir -p .venv/bin\ntouch .venv/bin/activate\n")
    return folder, run("demo", folder)


def nvsim(*arguments: object) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, "-m", "nvsim", *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done


def evaluated(*arguments: object) -> dict[str, float]:
    """The figures of `nvsim evaluate`."""
    return json.loads(nvsim("evaluate", *arguments, "--json").stdout.splitlines()[-1])


@pytest.fixture
def folder(first: tuple[Path, str], tmp_path: Path) -> Path:
    """A folder with the project of the first tutorial."""
    shutil.copytree(first[0] / "first.nvsim", tmp_path / "first.nvsim")
    return tmp_path


def test_the_first_tutorial_ends_with_a_valid_graph_in_files_of_r2r(first: tuple[Path, str]) -> None:
    folder, printed = first
    stub = "ZMojNkEp431_connectivity.json"
    assert files(folder / "connectivity") == [stub, "first_connectivity.json", "scans.txt"]
    figures = json.loads(next(line for line in printed.splitlines() if line.startswith("{")))
    assert figures["nodes"] >= 4 and figures["edge_validity"] >= 0.9
    assert "nvsim app --project" in printed and "Valid edges" in printed


def test_the_graph_is_valid_and_covers_the_rooms(first: tuple[Path, str], tmp_path: Path) -> None:
    picture = tmp_path / "graph.png"
    got = evaluated("graph", "--project", first[0] / "first.nvsim", "--picture", picture)
    assert got["nodes"] >= 4
    assert got["node_validity"] >= 0.9
    assert got["edge_validity"] >= 0.9
    assert got["coverage"] >= 0.6
    assert picture.stat().st_size > 1000


def test_the_floor_masks_meet_the_truth(first: tuple[Path, str]) -> None:
    assert evaluated("floor", "--project", first[0] / "first.nvsim")["miou"] >= 0.9


def test_held_out_frames_look_right_and_alpha_separates_floor_from_the_rest(
    first: tuple[Path, str], tmp_path: Path
) -> None:
    got = evaluated("views", "--project", first[0] / "first.nvsim", "--pictures", tmp_path / "views")
    assert got["psnr_nonfloor"] > 18
    assert got["psnr_floor"] > 18
    assert got["alpha_floor"] < 0.2
    assert got["alpha_nonfloor"] > 0.8


def test_the_export_loads_as_agents_load_it(first: tuple[Path, str]) -> None:
    out = first[0] / "connectivity"
    scan, stub = (out / "scans.txt").read_text().split()
    assert stub == "ZMojNkEp431"
    entries = json.loads((out / f"{scan}_connectivity.json").read_text())
    with Project.open(first[0] / "first.nvsim") as project:
        assert len(entries) == len(project.need_graph().viewpoints)
    for i, entry in enumerate(entries):
        for j, other in enumerate(entries):
            assert entry["unobstructed"][j] == other["unobstructed"][i]
        assert not entry["unobstructed"][i]


def test_a_second_run_finds_everything_up_to_date(first: tuple[Path, str]) -> None:
    project = first[0] / "first.nvsim"
    said = nvsim("run", project / "capture", "--project", project, *TRAINING.split()).stderr
    for words in ("capture is unchanged", "submaps are up to date", "masks are up to date", "graph is up to date"):
        assert words in said


def test_edits_in_the_window_become_a_script_for_another_project(folder: Path) -> None:
    printed = run("fix-a-graph", folder, str(Path(__file__).with_name("tutorial_window.py")))
    seen = json.loads(next(line for line in printed.splitlines() if line.startswith('{"added"')))
    for name in ("first", "second"):
        with Project.open(folder / f"{name}.nvsim") as project:
            graph = project.need_graph()
        assert sorted(map(list, graph.edges)) == seen["edges"] and seen["added"] in graph.viewpoints
        assert graph.edges[tuple(seen["reviewed"])].reviewed


def test_a_video_and_images_with_poses_become_projects(folder: Path) -> None:
    import cv2

    video = cv2.VideoWriter(str(folder / "walk.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10, (room.WIDTH, room.HEIGHT))
    for pose in room.walk(60):
        video.write(room.render(pose))
    video.release()
    run("own-capture", folder)
    for name in ("walk", "house"):
        with Project.open(folder / f"{name}.nvsim") as project:
            assert project.need_graph().viewpoints
    assert "house" in (folder / "connectivity" / "scans.txt").read_text()
    assert (folder / "scans" / "house" / "manifest.json").is_file()


def test_agents_run_on_the_exported_scan(folder: Path) -> None:
    printed = run("run-an-agent", folder)
    for name in ("shortest", "random", "recurrent"):
        assert json.loads((folder / f"{name}.json").read_text())
    assert "(480, 640, 3)" in printed and "SPL" in printed


def test_every_tutorial_runs() -> None:
    tested = re.findall(r'run\("([\w-]+)", folder', Path(__file__).read_text())
    assert sorted(tested) == sorted(path.stem for path in TUTORIALS.glob("*.md"))
