"""After an update, no cached kernel computes with an old function or constant of another file."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import nvsim

FILES = {
    "__init__.py": "",
    "kernels.py": "from numba import njit\n",
    "constants.py": "ADDED = 1.0\n",
    "helper.py": "from toy.constants import ADDED\nfrom toy.kernels import njit\n\n"
    "@njit\ndef more(x):\n    return 2 * x + ADDED\n",
    "draw.py": "from toy.helper import more\nfrom toy.kernels import njit\n\n"
    "@njit(cache=True)\ndef draw(x):\n    return more(x)\n",
    "words.py": "TEXT = 'no kernel needs it'\n",
}
CALL = """
import sys
from pathlib import Path
from nvsim.kernels import remove_outdated
remove_outdated(Path("toy").resolve())
from toy.draw import draw
print(draw(3.0), sum(draw.stats.cache_hits.values()))
"""


@pytest.mark.parametrize("place", ["beside the sources", "named by the user"])
def test_a_kernel_is_compiled_again_if_what_it_contains_changes(tmp_path: Path, place: str) -> None:
    package = tmp_path / "toy"
    package.mkdir()
    for name, text in FILES.items():
        (package / name).write_text(text)
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{Path(nvsim.__file__).parents[1]}"}
    environment.pop("NUMBA_CACHE_DIR", None)
    if place == "named by the user":
        environment["NUMBA_CACHE_DIR"] = str(tmp_path / "cache")

    def call() -> list[str]:
        command = [sys.executable, "-c", CALL]
        run = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        return run.stdout.split()

    assert call() == ["7.0", "0"]
    assert call() == ["7.0", "1"]
    (package / "helper.py").write_text(FILES["helper.py"].replace("2 * x", "3 * x"))
    assert call() == ["10.0", "0"]
    (package / "constants.py").write_text("ADDED = 5.0\n")
    assert call() == ["14.0", "0"]
    (package / "words.py").write_text("TEXT = 'another'\n")
    (package / ".#words.py").symlink_to("user@machine.1234")  # the lock file of an editor
    assert call() == ["14.0", "1"]
    records = [path for path in tmp_path.rglob("kernels.sha256") if path.is_file()]
    assert records
    for path in records:
        path.write_bytes(bytes(range(128, 256)))
    assert call() == ["14.0", "0"]


def test_every_kernel_takes_part() -> None:
    package = Path(nvsim.__file__).parent
    wrong = [
        path.name
        for path in package.rglob("*.py")
        if path.name != "kernels.py" and "import njit" in path.read_text().replace("nvsim.kernels import njit", "")
    ]
    assert not wrong, "import njit from nvsim.kernels"
