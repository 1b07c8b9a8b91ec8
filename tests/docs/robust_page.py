#!/usr/bin/python3
"""The study of docs/robust-design.md: promises of robust designs against plants from outside. Python's standard library only.

usage: robust_page.py ESMC --study ROBUST_CONDITION [TRIALS]    runs it (tens of minutes on two cores) and writes its table
       robust_page.py --check                                   the page has a table, and no promise in it was broken

ROBUST_CONDITION is build/host/tests/robust_condition; TRIALS are per law and mechanism. What the page shows of commands is
checked, and written, by docs_test.py."""
import re
import subprocess
import sys
from pathlib import Path

import page

PAGE = Path(__file__).resolve().parents[2] / "docs/robust-design.md"
HEAD = ("| mechanism | law | designs | random trials | climbs | violations | needed / used: least | median | largest |\n"
        "|---|---|---|---|---|---|---|---|---|\n")
EXACT = ("`esmc_projected`", "`smc`")


def broken():
    rows = [[c.strip() for c in line.strip("| \n").split("|")] for line in page.part(PAGE, "study").splitlines()[2:]]
    promised = [r for r in rows if r[1] in EXACT]
    if len(promised) != 4:
        yield "docs/robust-design.md: the table of the study lacks rows"
    if sum(int(r[3]) + int(r[4]) for r in promised) < 80000:
        yield "docs/robust-design.md: the study is too short"
    for r in promised:
        if int(r[5]) != 0 or not float(r[8]) <= 1.0:
            yield f"docs/robust-design.md: the promise was broken: {r}"


def main():
    if sys.argv[1:] == ["--check"]:
        found = list(broken())
        print("\n".join(found) if found else "docs/robust-design.md: kept")
        return 1 if found else 0
    if len(sys.argv) < 4 or sys.argv[2] != "--study":
        print(__doc__, file=sys.stderr)
        return 2
    run = subprocess.run(sys.argv[3:], capture_output=True, text=True, check=True)
    rows = "".join(line + "\n" for line in run.stdout.splitlines() if re.match(r"\| \w", line))
    page.put(PAGE, {"study": HEAD + rows})
    return 0


if __name__ == "__main__":
    sys.exit(main())
