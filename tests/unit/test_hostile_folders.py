"""Output folders from other people: the targets of their links never change."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.r2r.features.kept_rows import kept_rows
from nvsim.r2r.recurrent.training import FILE, Curves

PRECIOUS = b"precious"
KEYS = ["s_v0", "s_v1", "s_v2"]


@pytest.fixture
def victim(tmp_path: Path) -> Path:
    path = tmp_path / "elsewhere" / "victim"
    path.parent.mkdir()
    path.write_bytes(PRECIOUS)
    return path


def write_lmdb(target: Path, made: set[str] | None = None) -> list[bool]:
    """Writes an LMDB of three arrays; returns which of them were there from before."""
    pytest.importorskip("lmdb", reason="the extra `navgpt2` is not installed")
    pytest.importorskip("msgpack", reason="the extra `navgpt2` is not installed")
    from nvsim.r2r.features import feature_files

    with kept_rows(target, "m") as rows:
        there = [rows.contains(key, b"k") for key in KEYS]
        for key in KEYS if made is None else made:
            rows.append(key, b"k", feature_files.packed_array(np.zeros((3, 4), np.float32)))
        feature_files.write_lmdb(target, rows, {key: key.encode() for key in KEYS}, 1 << 20)
    return there


def keys_of(target: Path) -> list[str]:
    import lmdb

    with lmdb.open(str(target), readonly=True, lock=False) as environment, environment.begin() as transaction:
        return [bytes(key).decode() for key, _ in transaction.cursor()]


@pytest.mark.parametrize("name", ["lock.mdb", "data.mdb", "rows", "lock", "made-by", "anything"])
@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_a_link_in_the_folder_of_kept_rows_is_removed_and_not_followed(tmp_path, victim, name, link) -> None:
    parts = tmp_path / "d" / ".out.lmdb.parts"
    parts.mkdir(parents=True)
    link(victim, parts / name)
    assert write_lmdb(tmp_path / "d" / "out.lmdb") == [False] * 3
    assert victim.read_bytes() == PRECIOUS
    assert keys_of(tmp_path / "d" / "out.lmdb") == KEYS
    assert [p.name for p in (tmp_path / "d").iterdir()] == ["out.lmdb"]


def test_a_folder_of_kept_rows_that_is_a_link_is_removed_and_not_followed(tmp_path, victim) -> None:
    for name in ("rows", "data.mdb", "made-by", "lock"):
        victim.with_name(name).write_bytes(PRECIOUS)
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / ".x.hdf5.parts").symlink_to(victim.parent)
    with kept_rows(tmp_path / "d" / "x.hdf5", "a") as kept:
        kept.append("k", b"m", b"row")
    assert all(path.read_bytes() == PRECIOUS for path in victim.parent.iterdir())
    assert not list((tmp_path / "d").iterdir())


def test_an_lmdb_is_not_written_into_a_folder_that_is_linked(tmp_path, victim) -> None:
    victim.with_name("data.mdb").write_bytes(PRECIOUS)
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "out.lmdb").symlink_to(victim.parent)
    with pytest.raises(InputError, match="is a link to a folder.*remove the link"):
        write_lmdb(tmp_path / "d" / "out.lmdb")
    assert victim.with_name("data.mdb").read_bytes() == PRECIOUS


@pytest.mark.parametrize("kept", [3, 16_384, 20_000])
def test_kept_rows_that_a_power_loss_cut_are_made_again(tmp_path, kept) -> None:
    target = tmp_path / "out.lmdb"
    with pytest.raises(KeyError):
        write_lmdb(target, {KEYS[0]})
    parts = tmp_path / ".out.lmdb.parts"
    whole = (parts / "rows").read_bytes()
    (parts / "rows").write_bytes(whole[:-1] + bytes(kept))
    (parts / "data.mdb").write_bytes(struct.pack("<Q", 3) * (kept // 8))  # of a version that opened it
    assert write_lmdb(target) == [False] * 3
    assert keys_of(target) == KEYS


def test_whole_kept_rows_are_taken_over(tmp_path) -> None:
    target = tmp_path / "out.lmdb"
    with pytest.raises(KeyError):
        write_lmdb(target, {KEYS[0]})
    assert write_lmdb(target, set(KEYS[1:])) == [True, False, False]
    assert keys_of(target) == KEYS


def test_a_file_takes_the_place_of_a_link_and_what_it_leads_to_stays(tmp_path, victim) -> None:
    path = tmp_path / "figures.json"
    path.symlink_to(victim)
    atomic.write_text(path, "new")
    assert path.read_text() == "new" and not path.is_symlink() and victim.read_bytes() == PRECIOUS


def test_a_library_writes_in_a_folder_that_only_the_user_can_open(tmp_path) -> None:
    path = tmp_path / "film.mp4"
    with atomic.replacement_file(path) as temporary:
        assert temporary.name == path.name and temporary.parent.parent == tmp_path
        assert temporary.parent.stat().st_mode & 0o777 == 0o700 and not list(temporary.parent.iterdir())
        temporary.write_bytes(b"film")
        temporary.with_name("film.mp4-journal").write_bytes(b"what the library leaves")
    assert path.read_bytes() == b"film" and [p.name for p in tmp_path.iterdir()] == ["film.mp4"]


def test_files_have_the_permissions_that_the_user_asks_for(tmp_path) -> None:
    code = (
        "import os, sys, pathlib; from nvsim.files import atomic; os.umask(0o077)\n"
        "atomic.write_text(pathlib.Path(sys.argv[1]), 'x')"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "x")], check=True)
    assert (tmp_path / "x").stat().st_mode & 0o777 == 0o600


def test_curves_are_not_written_through_a_link(tmp_path, victim) -> None:
    curves = Curves(tmp_path, 0, lambda event: None)
    (tmp_path / FILE).unlink()
    (tmp_path / FILE).symlink_to(victim)
    with pytest.raises(InputError, match="symbolic link"):
        curves.add("loss", 1.0, 1)
    assert victim.read_bytes() == PRECIOUS
