#!/usr/bin/env bash
# Installs NVSim into .venv and runs the whole job on the built-in building. Options go to `nvsim demo`.
set -eu
root="$(cd "$(dirname "$0")/.." && pwd)"
"$root/packaging/install.sh" "$root/.venv" -e "$root"
exec "$root/.venv/bin/nvsim" demo "$@"
