"""Builds the package: copies the simulator's files from `nvsim` and renames their imports to `MatterSim`."""

from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

LIBRARY = Path(__file__).resolve().parents[2] / "nvsim"
FILES = [
    "errors",
    "files/images",
    "files/opening",
    "files/placeholders",
    "files/reading",
    "geometry/camera",
    "geometry/directions",
    "graph/skybox_files",
    "r2r/simulator/conventions",
    "r2r/simulator/cross_bilateral",
    "r2r/simulator/images",
    "r2r/simulator/plain_drawing",
    "r2r/simulator/scan",
    "r2r/simulator/settings",
    "r2r/simulator/simulator",
    "r2r/simulator/state",
]
"""The copied files. They are valid in Python 3.8 and import numpy, OpenCV, and each other."""


def copy_files(target: Path) -> None:
    """Writes the copies below `target`, the folder of the package."""
    for name in FILES:
        text = (LIBRARY / f"{name}.py").read_text(encoding="utf-8").replace("from nvsim.", "from MatterSim.")
        # numpy before 1.21 has no NDArray. Annotations are not evaluated, and List takes the same arguments.
        text = text.replace("from numpy.typing import NDArray", "from typing import List as NDArray")
        path = target / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


class BuildWithCopies(build_py):
    """Adds the copied files to the package."""

    def run(self) -> None:
        super().run()
        copy_files(Path(self.build_lib) / "MatterSim")


if __name__ == "__main__":
    setup(cmdclass={"build_py": BuildWithCopies})
