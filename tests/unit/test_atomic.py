"""A file is whole or absent, and a refusal is one sentence."""

import subprocess
import sys

import pytest

from nvsim.errors import InputError
from nvsim.files import atomic


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "figures.json"
    atomic.write_text(path, "old")
    with pytest.raises(RuntimeError), atomic.replacement_file(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["figures.json"]


def test_a_killed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "figures.json"
    atomic.write_text(path, "old")
    code = (
        "import os, signal, pathlib; from nvsim.files import atomic\n"
        f"with atomic.replacement_file(pathlib.Path({str(path)!r})) as t:\n"
        "    t.write_text('half'); os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == -9
    assert path.read_text() == "old"


def test_a_path_through_a_file_is_refused_with_a_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="not a folder"):
        atomic.write_text(tmp_path / "file" / "inside", "text")


def test_a_full_disk_is_refused_with_a_sentence():
    with pytest.raises(InputError, match="disk is full"):
        raise atomic.as_input_error("/x", OSError(28, "No space left on device"))


def test_an_output_that_cannot_be_written_is_refused_before_any_work(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "inside" / "deep"):
        with pytest.raises(InputError, match="not a folder"):
            atomic.refuse_unwritable_folder(folder)
        with pytest.raises(InputError, match="not a folder"):
            atomic.refuse_unwritable_file(folder / "figures.json")
    with pytest.raises(InputError, match="it is a folder; name a file"):
        atomic.refuse_unwritable_file(tmp_path)
    atomic.refuse_unwritable_folder(tmp_path / "new" / "deep")
    atomic.refuse_unwritable_file(tmp_path / "file")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_folder_of_another_user_is_refused_before_any_work(tmp_path, monkeypatch):
    monkeypatch.setattr(atomic.os, "access", lambda path, mode: False)
    with pytest.raises(InputError, match="permission is denied"):
        atomic.refuse_unwritable_folder(tmp_path / "new")
