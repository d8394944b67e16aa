#!/usr/bin/env bash
# Builds the wheel, installs it in a clean environment, and runs it from a folder outside the checkout.
# usage: smoke.sh PYTHON   (a Python with the package `build`)
set -eu
root="$(cd "$(dirname "$0")/.." && pwd)"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
"$1" -m build --wheel --outdir "$work" "$root" >"$work/build.log" 2>&1 || { cat "$work/build.log" >&2; exit 1; }
"$root/packaging/install.sh" "$work/venv" "$work"/nvsim-*.whl
cd "$work"
bin="$work/venv/bin"
"$bin/python" - <<'PYTHON'
import importlib.resources, pathlib, nvsim, app, resources
for package in (nvsim, app, resources):
    assert "site-packages" in package.__file__, package.__file__
files = [p.name for p in importlib.resources.files("resources").iterdir()]
assert len(files) > 1, files
PYTHON
"$bin/nvsim" --version
"$bin/nvsim" --help >/dev/null
QT_QPA_PLATFORM=offscreen "$bin/nvsim" bench startup --runs 1
"$bin/nvsim" demo --small --no-window --project "$work/small.nvsim" --train.steps 40
"$bin/nvsim" export r2r --project "$work/small.nvsim" --out "$work/connectivity"
test -s "$work/connectivity/scans.txt"
echo "The wheel works outside the checkout."
