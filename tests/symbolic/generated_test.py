#!/usr/bin/env python3
"""A generated file is what its generator prints: generated_test.py GENERATOR FILE [--update]."""

import difflib
import pathlib
import subprocess
import sys


def main():
    arguments = sys.argv[1:]
    update = "--update" in arguments
    if update:
        arguments.remove("--update")
    if len(arguments) != 2:
        print(f"generated_test.py: usage: {__doc__}", file=sys.stderr)
        return 2
    generator, name = arguments
    new = subprocess.run([generator], capture_output=True, text=True, check=True).stdout
    file = pathlib.Path(name)
    if update:
        file.write_text(new, encoding="utf-8")
        return 0
    old = file.read_text(encoding="utf-8")
    difference = list(difflib.unified_diff(old.splitlines(), new.splitlines(), name, generator, lineterm=""))
    for line in difference or ([] if old == new else ["ends of lines differ"]):
        print(line)
    if old != new:
        print(f"regenerate: tests/symbolic/generated_test.py {generator} {name} --update")
    return int(old != new or not new.strip())


if __name__ == "__main__":
    sys.exit(main())
