#!/usr/bin/env bash
# Makes a virtual environment with NVSim and the set of packages that was tested.
# usage: install.sh VENV REQUIREMENT...   (a requirement as pip takes it: ".", "-e .[test]", a wheel)
set -eu
here="$(cd "$(dirname "$0")" && pwd)"
venv="${1:?usage: install.sh VENV REQUIREMENT...}"
shift
"$here/system-packages.sh"
[ -x "$venv/bin/python" ] || "${PYTHON:-python3}" -m venv "$venv"
# Compiling every module of every package takes longer than unpacking them; Python compiles those that are used.
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile -c "$here/constraints.txt" "$@"
# Else the first window would move in jerks for half a minute. Without it the window does it by itself.
"$venv/bin/python" -P -m nvsim_app.drawing.compilation || echo "The window will compile what it draws with." >&2
