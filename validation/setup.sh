#!/usr/bin/env bash
# Installs what the validation scripts need: a Python virtual environment at
# target/validation/venv with the packages of requirements.txt (Mitsuba 3 is the peer
# renderer), and a libLLVM for Mitsuba's vectorised variants. Run it as often as you like:
# where nothing changed it returns at once.
set -euo pipefail

validation=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
home=$(dirname "$validation")/target/validation
venv=$home/venv
stamp=$venv/requirements.sha256
python=${PYTHON:-python3}

fail() {
    echo "validation/setup.sh: $*" >&2
    exit 1
}

install_libllvm() {
    local manual="install LLVM 17 or newer by hand and set DRJIT_LIBLLVM_PATH to its libLLVM"
    command -v apt-get >/dev/null || fail "no usable libLLVM, and this is not a Debian system; $manual"
    local as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        command -v sudo >/dev/null || fail "no usable libLLVM, and neither root nor sudo to install it; $manual"
        as_root=(sudo)
    fi
    echo "installing the Debian package libllvm19" >&2
    local log=$home/apt.log
    {
        "${as_root[@]}" apt-get update &&
            "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
                apt-get install -y --no-install-recommends libllvm19
    } >"$log" 2>&1 || fail "apt-get could not install libllvm19 (see $log); $manual"
}

install_packages() {
    "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
        fail "Python 3.11 or newer is needed; set PYTHON to one"
    echo "creating $venv" >&2
    "$python" -m venv --clear "$venv" ||
        fail "could not create a virtual environment; on Debian install python3-venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check --only-binary :all: \
        --requirement "$validation/requirements.txt" ||
        fail "pip could not install requirements.txt (no wheel for this platform, or no package index)"
}

command -v "$python" >/dev/null || fail "no $python found; install Python 3.11 or newer"
mkdir -p "$home"
exec 9>"$home/setup.lock"
flock 9 # two checks may start at once

if ! "$python" "$validation/libllvm.py" >/dev/null 2>&1; then
    install_libllvm
    "$python" "$validation/libllvm.py" >/dev/null || fail "libllvm19 is installed, but where?"
fi

wanted=$(sha256sum <"$validation/requirements.txt")
if [ "$(cat "$stamp" 2>/dev/null)" != "$wanted" ]; then
    install_packages
    echo "$wanted" >"$stamp" # last, so that an interrupted installation is repeated
fi
