"""NVSim finds a folder for compiled kernels if the package and the user's cache are read-only. `python -m nvsim` runs
no code from the current folder."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from nvsim import kernel_folder
from nvsim.kernel_folder import VARIABLE, choose, temporary_cache

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for temporary files as /tmp is, and nothing else that can be written."""
    place = tmp_path / "tmp"
    place.mkdir()
    place.chmod(0o1777)
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(kernel_folder, "can_write", lambda folder: False)
    return place


def test_a_folder_of_this_user_alone_takes_the_place_of_the_cache(temporary: Path) -> None:
    choose()
    try:
        folder = Path(os.environ[VARIABLE])
        assert folder.parent == temporary and folder.stat().st_mode & 0o777 == 0o700
        assert temporary_cache() == folder  # the next process finds what this one compiled
    finally:
        del os.environ[VARIABLE]


def test_a_choice_of_the_user_stays(temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "/somewhere")
    choose()
    assert os.environ[VARIABLE] == "/somewhere" and not list(temporary.iterdir())


def test_where_the_package_can_be_written_nothing_is_chosen(temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for writable in ("__pycache__", "numba"):
        monkeypatch.setattr(kernel_folder, "can_write", lambda folder, name=writable: folder.name == name)
        choose()
        assert VARIABLE not in os.environ


@pytest.mark.parametrize("trap", ["open to others", "a link", "a file", "of another user"])
def test_a_folder_that_another_user_could_fill_is_not_used(
    temporary: Path, trap: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = temporary / f"nvsim-kernels-{os.geteuid()}"
    if trap == "open to others":
        taken.mkdir()
        taken.chmod(0o770)
    elif trap == "a link":
        (temporary / "mine").mkdir(mode=0o700)
        taken.symlink_to(temporary / "mine")
    elif trap == "a file":
        taken.touch()
    else:
        taken.mkdir(mode=0o700)
        found = os.lstat(taken)
        monkeypatch.setattr(os, "lstat", lambda path: os.stat_result((*found[:4], found.st_uid + 1, *found[5:])))
    folder = temporary_cache()
    if trap == "a file":
        assert folder is None or folder.parent != temporary
    else:
        assert folder is not None and folder != taken and folder.stat().st_mode & 0o777 == 0o700


def test_a_place_where_others_may_rename_is_not_trusted(temporary: Path) -> None:
    temporary.chmod(0o777)  # without the sticky bit
    first, second = temporary_cache(), temporary_cache()
    assert first is not None and second is not None and first != second


def _without_power() -> None:
    """As root, permissions count from the next program on (CAP_DAC_OVERRIDE and CAP_DAC_READ_SEARCH are dropped)."""
    drop = getattr(ctypes.CDLL(None), "prctl", None)
    for capability in (1, 2) if drop is not None else ():
        drop(24, capability, 0, 0, 0)


def test_a_read_only_package_and_home_can_be_used(tmp_path: Path) -> None:
    package, home = tmp_path / "site", tmp_path / "home"
    ignored = shutil.ignore_patterns("__pycache__")
    for source in (REPOSITORY / "nvsim", REPOSITORY / "resources" / "nvsim_resources"):
        shutil.copytree(source, package / source.name, ignore=ignored)
    home.mkdir()
    subprocess.run(["chmod", "-R", "a-w", str(package), str(home)], check=True)
    code = (
        "import os, nvsim, sys; from nvsim.render import projection; from nvsim.r2r.simulator import scan;"
        "print(os.environ['NUMBA_CACHE_DIR']); assert nvsim.__file__.startswith(sys.argv[1])"
    )
    environment = {
        **{k: v for k, v in os.environ.items() if not k.startswith(("XDG_", "NUMBA_"))},
        "HOME": str(home),
        "PYTHONPATH": str(package),
        "TMPDIR": str(tmp_path),
    }
    try:
        done = subprocess.run(
            [sys.executable, "-c", code, str(package)],
            env=environment,
            cwd=tmp_path,
            preexec_fn=_without_power,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert Path(done.stdout.strip()).parent == tmp_path
    finally:
        subprocess.run(["chmod", "-R", "u+w", str(package), str(home)], check=True)


@pytest.mark.parametrize("name", ["nvsim_app", "nvsim_resources", "numpy", "tyro", "json"])
def test_python_m_nvsim_imports_nothing_from_the_current_folder(tmp_path: Path, name: str) -> None:
    (tmp_path / f"{name}.py").write_text("print('dropped in')\n")
    (tmp_path / "models").mkdir()
    environment = {**os.environ, "NVSIM_MODELS": str(tmp_path / "models")}
    done = subprocess.run(
        [sys.executable, "-m", "nvsim", "models"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "dropped in" not in done.stdout and "Models are in" in done.stdout
