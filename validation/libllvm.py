"""Finds a libLLVM that Mitsuba's LLVM variants can use.

Dr.Jit 1.5 refuses LLVM 14 and aborts at its first kernel with 15 and 16, and its own
look-up takes whatever `libLLVM.so` points to, so the library is chosen here by version.

As a program, prints the path, or explains on standard error and exits with 1.
"""

import glob
import os
import re
import sys

OLDEST_USABLE = 17
PREFERRED = 19  # what setup.sh installs, hence what the published figures were made with

PATTERNS = (
    "/usr/lib/*/libLLVM*.so*",
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib/libLLVM*.so*",
    "/usr/lib64/libLLVM*.so*",
    "/usr/lib64/llvm*/lib*/libLLVM*.so*",
    "/usr/local/lib/libLLVM*.so*",
)

# libLLVM-19.so.1, libLLVM.so.19.1, or an unversioned file in a folder llvm-19 / llvm19.
VERSION = re.compile(r"libLLVM-(\d+)|libLLVM\.so\.(\d+)|llvm-?(\d+)/")


def version_of(path):
    """Major LLVM version named by the path with its links resolved, or None."""
    real = os.path.realpath(path)
    found = VERSION.search(os.path.basename(real)) or VERSION.search(real)
    return int(next(filter(None, found.groups()))) if found else None


def find():
    """Path of a usable libLLVM, or None. DRJIT_LIBLLVM_PATH wins where it is set."""
    chosen = os.environ.get("DRJIT_LIBLLVM_PATH")
    if chosen:
        return chosen
    usable = {}
    for pattern in PATTERNS:
        for path in sorted(glob.glob(pattern)):
            version = version_of(path)
            if version is not None and version >= OLDEST_USABLE and os.path.isfile(path):
                usable.setdefault(version, os.path.realpath(path))
    return usable.get(PREFERRED) or usable.get(max(usable, default=None))


if __name__ == "__main__":
    library = find()
    if library is None:
        sys.exit(f"no libLLVM of version {OLDEST_USABLE} or newer found")
    print(library)
