#!/usr/bin/env bash
# Builds the documentation site into $SITE (by default build/site) and fails on a broken link, a missing image, or an
# option that no command has. Uses the virtual environment $VENV, by default .venv. Options go to mkdocs.
set -eu
root="$(cd "$(dirname "$0")/.." && pwd)"
venv="${VENV:-$root/.venv}"
if ! "$venv/bin/python" -c "import nvsim, material, mkdocstrings_handlers.python" 2>/dev/null; then
    "$root/packaging/install.sh" "$venv" -e "$root[docs]"
fi
cd "$root"
site="$(realpath -m "${SITE:-build/site}")"
NO_MKDOCS_2_WARNING=1 "$venv/bin/python" -m mkdocs build --strict -f packaging/site/mkdocs.yml -d "$site" "$@"
echo "The documentation is in $site/index.html. Its search needs a server: python3 -m http.server --directory $site"
