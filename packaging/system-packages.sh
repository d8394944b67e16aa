#!/usr/bin/env bash
# Installs the Debian packages of system-packages.txt that are missing. Asks first, unless it runs as root or in CI.
# Does nothing where all are present, and only names them on systems without apt.
set -eu
list="$(dirname "$0")/system-packages.txt"
if ! command -v dpkg-query >/dev/null 2>&1; then
    exit 0 # not Debian: Qt says by itself what it lacks
fi
missing=()
while read -r name; do
    case "$name" in '' | '#'*) continue ;; esac
    state=$(dpkg-query -W -f='${db:Status-Status}' "$name" 2>/dev/null || true)
    [ "$state" = installed ] || missing+=("$name")
done <"$list"
[ ${#missing[@]} -gt 0 ] || exit 0

echo "NVSim's window needs these Debian packages, which are missing: ${missing[*]}"
as_root=()
if [ "$(id -u)" -ne 0 ]; then
    as_root=(sudo)
    if [ "${CI:-}" != true ]; then
        if [ ! -t 0 ]; then
            echo "Install them with: sudo apt-get install ${missing[*]}" >&2
            exit 0 # everything but the window works without them
        fi
        read -r -p "Install them now with sudo apt-get? [y/N] " answer
        case "$answer" in y | Y | yes) ;; *)
            echo "Not installed; everything but the window works without them."
            exit 0
            ;;
        esac
    fi
fi
"${as_root[@]}" apt-get update -q
DEBIAN_FRONTEND=noninteractive "${as_root[@]}" apt-get install -y -q --no-install-recommends "${missing[@]}"
