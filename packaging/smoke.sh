#!/usr/bin/env bash
# Builds the wheel from a copy of the sources, installs it with pip alone in a plain virtual environment, and runs it from
# a folder outside the checkout: the window, and the demo on the small building with a short training. The variable
# PYTHON names another interpreter than python3.
set -eu
root="$(cd "$(dirname "$0")/.." && pwd)"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
mkdir "$work/sources"
cp -R "$root"/{nvsim,app,resources,pyproject.toml,README.md,LICENSE} "$work/sources"
"${PYTHON:-python3}" -m venv "$work/venv"
bin="$work/venv/bin"
"$bin/python" -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir "$work" "$work/sources"
"$bin/python" -m pip install --quiet --disable-pip-version-check --no-compile -c "$root/packaging/constraints.txt" \
    "$work"/nvsim-*.whl
rm -r "$work/sources"
cd "$work"
"$bin/python" - <<'PYTHON'
import importlib.metadata, nvsim, nvsim_app, nvsim_resources
for package in (nvsim, nvsim_app, nvsim_resources):
    assert "site-packages" in package.__file__, package.__file__
files = [str(path) for path in importlib.metadata.files("nvsim")]
assert all(path.startswith(("nvsim", "../../../bin/nvsim")) for path in files), files
assert "nvsim_resources/models/moge-2.toml" in files and "nvsim_resources/docs/window.md" in files, files
assert all("docs/window" in path for path in files if "docs/" in path), files  # the help shows only this page
PYTHON
"$bin/nvsim" --version
"$bin/nvsim" --help >/dev/null
NVSIM_MODELS="$work/none" "$bin/nvsim" models | grep -q moge-2
QT_QPA_PLATFORM=offscreen "$bin/nvsim" bench startup --runs 1
"$bin/nvsim" demo --small --no-window --project small.nvsim --train.steps 10
"$bin/nvsim" export r2r --project small.nvsim --out connectivity
test -s connectivity/scans.txt
"$bin/nvsim" export scan --project small.nvsim --out scans --size 64
test -s scans/small/manifest.json
echo "The wheel works outside the checkout."
