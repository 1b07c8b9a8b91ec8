#!/usr/bin/env python3
"""Every C++ file is as clang-format writes it (.clang-format; the version is that of the Debian package).

format.py CLANG_FORMAT [--self-test]
"""

import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

from sources import ROOT, cpp_files


def differing(clang_format, root, files):
    """The files, of those given relative to root, that the formatter would change."""
    run = subprocess.run([clang_format, "--dry-run", "--ferror-limit=1", *files], cwd=root, capture_output=True, text=True,
                         check=True)
    return sorted(set(re.findall(r"^(.*?):\d+:\d+: warning: code should be clang-formatted", run.stderr, re.M)))


def self_test(clang_format):
    """In a copy, a file with two spaces before each = must be found, and only that file."""
    with tempfile.TemporaryDirectory() as scratch:
        copy = pathlib.Path(scratch)
        shutil.copy(ROOT / ".clang-format", copy)
        text = (ROOT / "hal/can.hpp").read_text(encoding="utf-8")
        (copy / "kept.hpp").write_text(text, encoding="utf-8")
        (copy / "changed.hpp").write_text(text.replace(" = ", "  = "), encoding="utf-8")
        found = differing(clang_format, copy, ["changed.hpp", "kept.hpp"])
    if found != ["changed.hpp"]:
        print(f"format.py: should find changed.hpp, found {found}")
    return found != ["changed.hpp"]


def main():
    clang_format, *options = sys.argv[1:] or [""]
    if not clang_format or options not in ([], ["--self-test"]):
        print("usage: format.py CLANG_FORMAT [--self-test]", file=sys.stderr)
        return 2
    if options:
        return int(self_test(clang_format))
    files = cpp_files(ROOT)
    found = differing(clang_format, ROOT, files)
    for name in found:
        print(f"{name}: clang-format -i {name}")
    print(f"{len(found)} of {len(files)} files differ from the formatter")
    return int(bool(found) or not files)


if __name__ == "__main__":
    sys.exit(main())
