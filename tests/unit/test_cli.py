"""The command line: quick help, one sentence for a mistake, exit codes."""

import json
import subprocess
import sys

import pytest

from nvsim.cli.arguments import parse
from nvsim.cli.main import COMMANDS, main
from nvsim.cli.options import command_of


def run(*argv):
    return subprocess.run([sys.executable, "-m", "nvsim", *argv], capture_output=True, text=True, check=False)


def test_help_imports_nothing_heavy():
    code = "import sys; from nvsim.cli.main import main; main(['--help']); print(sorted(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    for heavy in ("numpy", "torch", "numba", "cv2", "tyro", "rich", "PySide6", "sqlite3", "matplotlib"):
        assert f"'{heavy}'" not in loaded


@pytest.mark.parametrize("verb", sorted(COMMANDS))
def test_every_command_explains_itself(verb, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*verb.split(), "--help"])
    assert stop.value.code == 0
    assert f"nvsim {verb}" in capsys.readouterr().out


@pytest.mark.parametrize(
    "argv", [["nonsense"], ["evaluate", "nonsense"], ["run"], ["train", "--project"], ["map", "--x"]]
)
def test_a_wrong_command_line_is_exit_code_2(argv):
    assert run(*argv).returncode == 2


def test_flags_of_earlier_versions_are_read_as_their_current_names():
    argv = ["--scans", "scans", "--least-metres", "2", "--most-metres=9", "--fewest-edges", "3"]
    bounds = parse(command_of("export tasks"), argv, "export tasks").options.bounds
    assert (bounds.least_meters, bounds.most_meters, bounds.fewest_edges) == (2, 9, 3)
    assert parse(command_of("graph check"), ["house.nvsim", "--neighbours", "2"], "graph check").limits.neighbors == 2


@pytest.mark.parametrize("option", ["--seconds", "--fps"])
def test_underscores_are_no_part_of_a_number(option):
    done = run("video", "--project", "x", option, "1_0")
    assert done.returncode == 2
    assert done.stderr.startswith("nvsim video: 1_0 is not a ")


@pytest.mark.parametrize(
    "argv",
    [
        ["bench", "startup", "--runs", "0"],
        ["bench", "graph", "--edits", "0"],
        ["bench", "graph", "--viewpoints", "1"],
        ["video", "--project", "x", "--seconds", "nan"],
        ["video", "--project", "x", "--seconds", "inf"],
    ],
)
def test_a_number_that_is_out_of_range_is_one_sentence_and_exit_code_2(argv, capsys):
    assert main(argv) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    "verb", ["submaps", "depth", "floors", "train", "map", "panorama", "evaluate views", "export r2r", "app"]
)
def test_a_missing_project_is_one_sentence_and_exit_code_2(verb, tmp_path):
    result = run(*verb.split(), "--project", str(tmp_path / "nowhere.nvsim"))
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert "does not exist" in result.stderr
    assert not (tmp_path / "nowhere.nvsim").exists()


def test_a_failure_is_an_event_too(tmp_path):
    result = run("map", "--project", str(tmp_path / "nowhere.nvsim"), "--json")
    event = json.loads(result.stdout)
    assert event["event"] == "failed"
    assert event["code"] == 2


def test_stages_out_of_order_say_what_to_run_first(tmp_path):
    from nvsim.project.project import Project

    root = tmp_path / "house.nvsim"
    Project.create_or_open(root).close()
    for verb, first in (
        ("submaps", "import"),
        ("depth", "import"),
        ("floors", "submaps"),
        ("train", "submaps"),
        ("map", "train"),
    ):
        result = run(verb, "--project", str(root))
        assert result.returncode == 2
        assert "run `nvsim" in result.stderr, (first, result.stderr)


def test_the_library_never_imports_qt():
    code = (
        "import sys, pkgutil, importlib, nvsim\n"
        "sys.modules['PySide6'] = sys.modules['pyqtgraph'] = None\n"
        "names = [m.name for m in pkgutil.walk_packages(nvsim.__path__, 'nvsim.') if m.name != 'nvsim.__main__']\n"
        "for name in names: importlib.import_module(name)\n"
        "assert 'matplotlib' not in sys.modules, 'figures import it when they are drawn'\n"
        "print(len(names))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert int(result.stdout) > 40


def test_a_refused_import_leaves_no_trace(tmp_path):
    (tmp_path / "capture").mkdir()
    (tmp_path / "capture" / "transforms.json").write_text("{")
    result = run("import", str(tmp_path / "capture"), "--project", str(tmp_path / "house.nvsim"))
    assert result.returncode == 2, result.stderr
    assert not (tmp_path / "house.nvsim").exists()
