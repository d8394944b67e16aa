#!/usr/bin/env bash
# Installs NVSim with its test tools into a virtual environment ($VENV, by default .venv) and runs every test:
# first without a screen, in $WORKERS processes (by default two), then the window's own in a real window on a virtual
# screen. Arguments go to pytest, and then only what they name is run: packaging/test.sh tests/unit/test_geometry.py
# If $INSTALLED is set, the environment is used as it is.
set -eu
root="$(cd "$(dirname "$0")/.." && pwd)"
venv="${VENV:-$root/.venv}"
[ -n "${INSTALLED:-}" ] || "$root/packaging/install.sh" "$venv" -e "$root[test]"
cd "$root"
export OMP_WAIT_POLICY=PASSIVE
# The threads of OpenBLAS wait actively. In several processes they would take the cores from each other.
export OPENBLAS_NUM_THREADS=1
# Many tests start processes, each of which would compile every module again.
unset PYTHONDONTWRITEBYTECODE
# Compiles the test modules and the kernels of all stages. Otherwise several processes would compile the same ones at the
# start.
QT_QPA_PLATFORM=offscreen "$venv/bin/python" -m pytest --collect-only -m "not gl" "$@" >/dev/null 2>&1 &
"$venv/bin/python" - <<'PYTHON'
import tempfile
from pathlib import Path

from nvsim.building import BuildingConfig, generate
from nvsim.events import ignore_event
from nvsim.mapping.config import MappingConfig
from nvsim.project.config import CaptureConfig
from nvsim.project.project import Project
from nvsim.project.stages import floors, imported, mapped, submaps, trained
from nvsim.submaps.split import SubmapConfig
from nvsim.training.config import TrainingConfig

with tempfile.TemporaryDirectory() as folder, Project.create_or_open(Path(folder) / "rooms.nvsim") as project:
    generate(project.root, BuildingConfig(size="small", width=96, height=72, step=1.0, turn=45.0, people=False))
    imported.run(project, project.layout.built_in_capture, CaptureConfig(), ignore_event)
    submaps.run(project, SubmapConfig(count=1), ignore_event)
    floors.run(project, ignore_event)
    trained.run(project, TrainingConfig(steps=1, image_size=48, gaussian_cap=600), ignore_event)
    mapped.run(project, MappingConfig(max_viewpoints=3, view_size=48), ignore_event)
PYTHON
wait
export QT_QPA_PLATFORM=offscreen
"$venv/bin/python" -m pytest --cache-clear -n "${WORKERS:-2}" --dist loadfile --no-loadscope-reorder -m "not gl" "$@" || {
    code=$?
    # On a busy machine, one of the many tests with processes and windows can miss its time. If only a few fail, they run
    # again without other work. All failures are printed above.
    failed="$(grep -c '"' "$root/.pytest_cache/v/cache/lastfailed" || true)"
    [ "$code" -eq 1 ] && [ "$failed" -le 4 ] || exit "$code"
    echo "Failed beside other tests: $failed. Running these again, one after another." >&2
    "$venv/bin/python" -m pytest --last-failed --last-failed-no-failures none -m "not gl" "$@"
}
[ $# -eq 0 ] || exit 0
if command -v xvfb-run >/dev/null 2>&1; then
    QT_QPA_PLATFORM=xcb xvfb-run -a -s "-screen 0 1600x1000x24" "$venv/bin/python" -m pytest -m gl tests/gl
elif [ "${CI:-}" = true ]; then
    echo "xvfb-run is missing, so the window cannot be tested" >&2
    exit 1
else
    echo "The tests in a real window were left out: xvfb is not installed." >&2
fi
