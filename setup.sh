#!/bin/sh
# Makes .venv with sdfprim in it, ready to run: ./setup.sh [dev]
#
# Installs what Debian or Ubuntu lack (Python's venv, a Vulkan driver, OpenGL's libraries) when it may, which is as root
# or where sudo asks for no password; else it names the one command to run.
set -eu
cd "$(dirname "$0")"
extras=${1:-repair}
python=.venv/bin/python

say() { printf '%s\n' "$*" >&2; }

# Installs Debian packages, or stops and says which command does.
need() {
    reason=$1
    shift
    if ! command -v apt-get >/dev/null 2>&1; then
        say "$reason. Install the equivalent of these Debian packages, then run this again: $*"
        exit 1
    fi
    if [ "$(id -u)" -eq 0 ]; then
        as_root=""
    elif command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; then
        as_root="sudo -n"
    else
        say "$reason. Run this, then try again:"
        say "    sudo apt-get update && sudo apt-get install -y $*"
        exit 1
    fi
    say "$reason: installing $*"
    $as_root apt-get update -qq >/dev/null
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

is_new_enough() {
    command -v "$1" >/dev/null 2>&1 && "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null
}

find_python() {
    for name in ${PYTHON:-} python3.12 python3.13 python3.11 python3 python3.14; do
        if is_new_enough "$name"; then
            printf '%s' "$name"
            return
        fi
    done
}

make_venv() {
    [ -x $python ] && $python -m pip --version >/dev/null 2>&1 && is_new_enough $python && return
    base=$(find_python)
    if [ -z "$base" ]; then
        need "no Python 3.11 or newer was found" python3 python3-venv
        base=$(find_python)
    fi
    if [ -z "$base" ]; then
        say "this system's Python is older than 3.11: install a newer one and name it, PYTHON=python3.12 make demo"
        exit 1
    fi
    if ! "$base" -c 'import ensurepip, venv' 2>/dev/null; then
        version=$("$base" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
        need "Python's venv is missing" "python$version-venv"
    fi
    "$base" -m venv --clear .venv
}

# An editable install is stale when pyproject.toml is newer than the stamp that the last one left.
install_package() {
    stamp=.venv/installed-$extras
    [ -e "$stamp" ] && [ ! pyproject.toml -nt "$stamp" ] && return
    say "installing sdfprim[$extras] into .venv"
    $python -m pip install --quiet --disable-pip-version-check -e ".[$extras]" >&2
    touch "$stamp"
}

check_gpu() {
    has_adapter() { $python -c 'from runtime.device import open_device; open_device()' >/dev/null 2>&1; }
    has_adapter && return
    need "no GPU adapter was found; a software one will do" mesa-vulkan-drivers
    has_adapter || $python -c 'from runtime.device import open_device; open_device()' >&2
}

# Only bodies with holes need MeshLab, so a machine that may not install its libraries goes on without.
check_meshlab() {
    loads() { $python -c 'from fit.clean import load_meshlab; load_meshlab()' >/dev/null 2>&1; }
    loads && return
    (need "pymeshlab misses OpenGL's libraries" libgl1 libopengl0) || true
    loads || say "going on without pymeshlab: bodies with holes are fitted as open sheets"
}

# The references of light come with `dev`, or with the extra `reference`.
check_mitsuba() {
    $python -c 'import importlib.util as u, sys; sys.exit(u.find_spec("mitsuba") is None)' || return 0
    loads() { $python -c 'import drjit' >/dev/null 2>&1; }
    loads && return
    (need "mitsuba misses a library" libatomic1) || true
    loads || say "going on without mitsuba: there are no references to compare with"
}

make_venv
install_package
check_gpu
check_meshlab
check_mitsuba
