#!/usr/bin/env bash
# Sets up everything the project needs: system packages (where this user may install them), a virtual environment,
# and the pinned Python packages. Called by the Makefile; running it again repairs an interrupted set-up.
#
# usage: tools/setup.sh VENV_FOLDER
set -euo pipefail
cd "$(dirname "$0")/.."
venv=${1:?usage: tools/setup.sh VENV_FOLDER}
python=${PYTHON:-python3}

missing_system_packages() {
    local package
    grep -v '^#' apt-packages.txt | sed 's/#.*//' | while read -r package; do
        [ -n "$package" ] || continue
        # A Python from elsewhere (pyenv, conda) brings its own venv module.
        if [ "$package" = python3-venv ] && "$python" -c 'import venv, ensurepip' 2>/dev/null; then continue; fi
        dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || echo "$package"
    done
}

install_system_packages() {
    if ! command -v dpkg-query >/dev/null; then
        echo "setup: not a Debian or Ubuntu system; install what apt-packages.txt names by hand" >&2
        return
    fi
    local missing
    missing=$(missing_system_packages | tr '\n' ' ')
    [ -n "$missing" ] || return 0
    local as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        if ! sudo -n true 2>/dev/null; then
            echo "setup: these system packages are missing and this user may not install them: $missing" >&2
            echo "setup: run  sudo apt-get install --no-install-recommends $missing and try again" >&2
            exit 1
        fi
        as_root=(sudo)
    fi
    echo "setup: installing system packages: $missing"
    # shellcheck disable=SC2086  # one word a package
    "${as_root[@]}" apt-get update -qq
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >/dev/null
}

install_python_packages() {
    "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
        echo "setup: Python 3.11 or newer is needed; $("$python" --version) was found. Set PYTHON=..." >&2
        exit 1
    }
    [ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
    echo "setup: installing Python packages into $venv"
    # Twice quiet: errors only.
    "$venv/bin/python" -m pip install --quiet --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
}

install_system_packages
install_python_packages
