"""Programs that import MatterSim get our simulator where they are run by `nvsim r2r python`, and not unasked."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from nvsim.cli.guard import CommandStopped, run_guarded
from nvsim.cli.main import main
from nvsim.r2r.simulator.shim import shim_folder

PROGRAM = "import sys, MatterSim; print(MatterSim.Simulator.__module__, sys.argv[1:])"


def nvsim(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "nvsim", *words]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=120, check=False, env=os.environ | environment
    )


def test_a_program_finds_our_simulator_and_keeps_its_arguments_and_its_exit_code() -> None:
    done = nvsim("r2r", "python", "--", sys.executable, "-c", PROGRAM, "--json", "--lr", "3")
    assert done.stdout.split(" ", 1) == ["nvsim.r2r.simulator.simulator", "['--json', '--lr', '3']\n"], done.stderr
    assert nvsim("r2r", "python", "--", sys.executable, "-c", "raise SystemExit(7)").returncode == 7


def test_a_stop_reaches_the_program_and_adds_no_words() -> None:
    program = "import time; print(1, flush=True); time.sleep(60)"
    command = [sys.executable, "-m", "nvsim", "r2r", "python", "--", sys.executable, "-c", program]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None and running.stdout.readline() == "1\n"
        running.send_signal(signal.SIGTERM)
        words = running.communicate(timeout=60)
    assert (running.returncode, words) == (-signal.SIGTERM, ("", ""))


def test_a_stop_before_the_program_runs_does_not_offer_to_continue(capsys: pytest.CaptureFixture[str]) -> None:
    @dataclass(frozen=True)
    class Starting:
        """Start."""

        def run(self) -> int:
            raise CommandStopped

    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        said = {}
        for verb in ("r2r python", "map"):
            assert run_guarded(verb, Starting, []) == 130
            said[verb] = capsys.readouterr().err
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    assert said["r2r python"] == "nvsim r2r python: stopped\n" and "again to continue" in said["map"]


def test_a_program_imports_from_the_current_folder_if_the_path_has_an_empty_entry(tmp_path: Path) -> None:
    (tmp_path / "vln").mkdir()
    (tmp_path / "vln" / "env.py").write_text("NAME = 'found'\n")
    script = tmp_path / "vln" / "main.py"
    script.write_text("from vln.env import NAME; import MatterSim; print(NAME)\n")
    path = os.pathsep.join([str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")]), ""])
    command = [sys.executable, "-m", "nvsim", "r2r", "python", "--", sys.executable, str(script)]
    environment = os.environ | {"PYTHONPATH": path}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, check=True)
    assert done.stdout == "found\n"


def test_the_folder_is_all_that_the_path_needs() -> None:
    folder = nvsim("r2r", "path").stdout.strip()
    assert json.loads(nvsim("r2r", "path", "--json").stdout) == {"path": folder}
    path = os.pathsep.join([folder, *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": path},
        check=True,
    )
    assert done.stdout.startswith("nvsim.r2r.simulator")


def test_old_readers_of_features_find_the_function_that_python_removed() -> None:
    program = "import MatterSim, base64; print(base64.decodestring(b'QQ=='))"
    done = nvsim("r2r", "python", "--", sys.executable, "-c", program)
    assert done.stdout == "b'A'\n", done.stderr


def test_a_python_without_the_packages_of_the_simulator_is_named(tmp_path: Path) -> None:
    """A checkout of NVSim in PYTHONPATH makes the package nvsim visible, but not what it needs."""
    bare, root = tmp_path / "python-bare", str(Path(__file__).parents[2])
    bare.write_text(f'#!/bin/sh\nexec "{sys.executable}" -S "$@"\n')
    bare.chmod(0o755)
    path = os.pathsep.join(
        p for p in (root, *os.environ.get("PYTHONPATH", "").split(os.pathsep)) if "site-pack" not in p
    )
    done = nvsim("r2r", "python", "--", str(bare), "-c", "import MatterSim", PYTHONPATH=path)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert f"{bare} lacks numpy and cv2" in done.stderr and "install NVSim" in done.stderr
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(shim_folder()), path])}
    command = [str(bare), "-c", "import MatterSim"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 1 and "lacks the package numpy" in last and "install NVSim" in last


def test_an_installed_simulator_is_not_shadowed_unasked(tmp_path: Path) -> None:
    (tmp_path / "MatterSim.py").write_text("class Simulator: pass\n")
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    program = ("--", sys.executable, "-c", PROGRAM)
    done = nvsim("r2r", "python", *program, PYTHONPATH=path)
    assert done.returncode == 2 and "already has a MatterSim" in done.stderr and "--replace" in done.stderr
    done = nvsim("r2r", "python", "--replace", *program, PYTHONPATH=path)
    assert done.stdout.startswith("nvsim.r2r.simulator"), done.stderr


def test_options_of_a_program_without_two_hyphens_are_answered_with_the_command(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["r2r", "python", "python", "train.py", "--batch", "8"]) == 2
    assert capsys.readouterr().err.rstrip().endswith("`nvsim r2r python -- python train.py --batch 8`.")
    assert main(["r2r", "path", "--batch", "8"]) == 2
    assert "two hyphens" not in capsys.readouterr().err


def test_no_program_and_one_that_is_not_there_are_one_sentence() -> None:
    for words in ((), ("--", "/nowhere/at/all")):
        done = nvsim("r2r", "python", *words)
        assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
