#!/usr/bin/env python3
"""Line and branch coverage of the firmware that decides about torque by the unit tests: 100 %, or the places are listed.

usage: coverage.py TEST... --profdata LLVM-PROFDATA --cov LLVM-COV   TEST: built with clang's source-based coverage
       coverage.py --self-test --profdata ... --cov ... --cxx CLANG++

A condition counts as covered when it was true and false in some instantiation of its template: what is looked at is
source text. Not counted: the way out of a `switch` that names every enumerator (there is none, and -Wswitch makes sure), and what stands behind `= default`.
Places that no test can reach stand in uncovered.txt with the reason; an entry there that fits no such place is an error.
A template that no test instantiates has no coverage at all, so every `{` that opens a function in these folders must lie in
a region that the compiler has seen."""

import argparse
import collections
import concurrent.futures
import functools
import json
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
HERE = pathlib.Path(__file__).resolve().parent
FOLDERS = ("firmware/safety", "firmware/drive", "firmware/link", "firmware/cycle")
SLOW = "CycleLink.Damaged*:SetpointGenerator.SetPointsAt*:Fusion/double*"  # a minute at -O0, and nothing new
CODE, GAP, SWITCH = 0, 3, re.compile(r"\bswitch\s*\(\s*$")


def run(test, raw):
    done = subprocess.run([test, "--gtest_brief=1", f"--gtest_filter=-{SLOW}"], env={"LLVM_PROFILE_FILE": str(raw)}, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"coverage.py: {test} fails:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return raw


def export(tests, tools, folder):
    merged = folder / "tests.profdata"
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        raw = list(pool.map(run, tests, [folder / f"{i}.profraw" for i in range(len(tests))]))
    subprocess.run([tools.profdata, "merge", "-sparse", *raw, "-o", merged], check=True)
    objects = [word for test in tests[1:] for word in ("-object", test)]
    text = subprocess.run([tools.cov, "export", tests[0], *objects, f"-instr-profile={merged}"], capture_output=True, check=True).stdout
    return json.loads(text)["data"][0]["functions"]


@functools.cache
def starts(file):
    """(line, column) of the first character of every line of code."""
    text = without_comments(file.read_text(encoding="utf-8"))
    return [(n, len(line) - len(line.lstrip()) + 1) for n, line in enumerate(text.splitlines(), 1) if line.strip(" {}\t;")]


@functools.cache
def relative(file, root):
    """Path below the root, or None."""
    path = pathlib.Path(file).resolve()
    return str(path.relative_to(root)) if path.is_relative_to(root) else None


def gather(functions, root, folders):
    """Per file: counts of lines and branches, summed over instantiations."""
    lines = collections.defaultdict(lambda: collections.defaultdict(int))
    branches = collections.defaultdict(lambda: collections.defaultdict(lambda: [0, 0]))
    for f in functions:
        names = [relative(n, root) for n in f["filenames"]]
        if not any(n and n.startswith(folders) for n in names):
            continue
        regions = collections.defaultdict(list)
        for first, begin, last, end, count, file, _, kind in f["regions"]:
            if kind in (CODE, GAP) and names[file] and names[file].startswith(folders):
                regions[names[file]].append(((first, begin), (last, end), count, kind))
        for name, list_ in regions.items():
            low, high = min(r[0][0] for r in list_), max(r[1][0] for r in list_)
            for line, column in starts(root / name):
                if not low <= line <= high:
                    continue
                # Of the regions around the first character of the line, the innermost; else the first that begins on it.
                around = [r for r in list_ if r[0] <= (line, column) < r[1]]
                begins = sorted(r for r in list_ if r[0][0] == line)
                if not around and begins:
                    lines[name][line] += begins[0][2]
                elif around:
                    lines[name][line] += max(around, key=lambda r: (r[0], (-r[1][0], -r[1][1]), r[3] == CODE))[2]
        for first, begin, last, end, true, false, file, _, _ in f.get("branches", ()):
            name = names[file]
            if name and name.startswith(folders):
                t = branches[name][(first, begin, last, end)]
                t[0] += true
                t[1] += false
    return lines, branches


def without_comments(text):
    blank = lambda m: re.sub(r"[^\n]", " ", m[0])  # noqa: E731
    return re.sub(r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"', blank, text, flags=re.S)


def functions_of(text):
    """Lines on which the body of a function opens: `) {`, `) const {`, `) : member(1) {`."""
    text = without_comments(text)
    for m in re.finditer(r"\)\s*(const\s*)?(noexcept\s*)?(->[^{;]*)?(:\s*[\w\s(){},.:<>*&]*?)?\{", text):
        head = text[:m.start() + 1].rsplit(";", 1)[-1].rsplit("}", 1)[-1]
        if not re.search(r"\b(if|for|while|switch|requires)\b", head.rsplit("{", 1)[-1]):
            yield text.count("\n", 0, m.end()) + 1


def violations(lines, branches, root, folders):
    files = sorted(f for folder in folders for f in (root / folder).rglob("*.[hc]pp"))
    if not files:
        yield "no file to look at"
    for file in files:
        name = str(file.relative_to(root))
        text = file.read_text(encoding="utf-8")
        source = text.splitlines()
        for line in sorted(n for n, count in lines[name].items() if count == 0):
            yield f"{name}:{line}: never run: {source[line - 1].strip()}"
        for (first, begin, last, end), (true, false) in sorted(branches[name].items()):
            if SWITCH.search(source[first - 1][:begin - 1]) and true == 0:
                continue
            if source[first - 1][:begin].endswith("= default"):
                continue
            what = source[first - 1][begin - 1:end - 1] if first == last else source[first - 1][begin - 1:]
            if true == 0 or false == 0:
                yield f"{name}:{first}:{begin}: never {'true' if true == 0 else 'false'}: {what.strip()}"
        for line in functions_of(text):
            if line not in lines[name]:
                yield f"{name}:{line}: no test instantiates: {source[line - 1].strip()}"


def excused(found, table):
    """The violations that no entry of the table `FILE: PLACE => REASON` names, and the entries that name none."""
    entries = {line.split(" => ")[0]: False for line in table.splitlines() if line and not line.startswith("#")}
    for violation in found:
        file, _, place = re.sub(r":\d+", "", violation).partition(": ")
        entry = f"{file}: {place}"
        if entry in entries:
            entries[entry] = True
        else:
            yield violation
    for entry, used in entries.items():
        if not used:
            yield f"uncovered.txt: {entry}: there is no such place"


SEEDED = """#pragma once
enum class E { a, b };
inline int run(int a, int b) {
  if (a > 0 && b > 0) {
    return 1;
  }
  return a < 0 ? 2 : 3;
}
inline int never(int a) { return a; }
template <class T>
T nowhere(T a) {
  return a;
}
inline int all(E e) {
  switch (e) {
    case E::a: return 1;
    case E::b: return 2;
  }
  return 3;
}
template <class T>
bool either(T a) { return a > T(0); }
"""
FORGOTTEN = """#pragma once
inline int forgotten() {
  return 1;
}
"""
EXPECTED = ["a.hpp:5: never run", "a.hpp:4:16: never true", "a.hpp:7:10: never true", "a.hpp:9: never run",
            "a.hpp:11: no test instantiates", "a.hpp:19: never run", "b.hpp:2: no test instantiates"]


def self_test(tools):
    with tempfile.TemporaryDirectory() as scratch:
        root = pathlib.Path(scratch).resolve()
        (root / "safety").mkdir()
        (root / "safety/a.hpp").write_text(SEEDED)
        (root / "safety/b.hpp").write_text(FORGOTTEN)
        (root / "main.cpp").write_text('#include "safety/a.hpp"\nint main() { run(1, 0); run(0, 0); all(E::a); all(E::b);'
                                       " return either(1.0) && !either(-1) ? 0 : 1; }\n")
        subprocess.run([tools.cxx, "-std=c++20", "-O0", "-fprofile-instr-generate", "-fcoverage-mapping", f"-I{root}",
                        root / "main.cpp", "-o", root / "tests"], check=True)
        counted = gather(export([root / "tests"], tools, root), root, ("safety",))
        found = list(violations(*counted, root, ("safety",)))
        table = "safety/a.hpp: never run: return 1; => a reason\nsafety/a.hpp: never run: gone => a reason\n"
        left = list(excused(found, table))
        if any("a.hpp:5" in f for f in left) or "uncovered.txt: safety/a.hpp: never run: gone: there is no such place" not in left:
            print("uncovered.txt does not excuse what it names, or names what is not there")
            return 1
        missing = [e for e in EXPECTED if not any(e in f for f in found)]
        extra = [f for f in found if not any(e in f for e in EXPECTED)]
        for line in [f"not found: {m}" for m in missing] + [f"found, wrongly: {e}" for e in extra]:
            print(line)
        return 1 if missing or extra else 0


def main():
    p = argparse.ArgumentParser()
    p.add_argument("tests", nargs="*")
    p.add_argument("--self-test", action="store_true")
    p.add_argument("--profdata", required=True)
    p.add_argument("--cov", required=True)
    p.add_argument("--cxx")
    tools = p.parse_args()
    if tools.self_test:
        return self_test(tools)
    with tempfile.TemporaryDirectory() as scratch:
        functions = export([pathlib.Path(test).resolve() for test in tools.tests], tools, pathlib.Path(scratch))
    lines, branches = gather(functions, ROOT, FOLDERS)
    found = list(excused(violations(lines, branches, ROOT, FOLDERS), (HERE / "uncovered.txt").read_text(encoding="utf-8")))
    for f in found:
        print(f)
    print(f"{sum(map(len, lines.values()))} lines, {2 * sum(map(len, branches.values()))} branches of "
          f"{', '.join(FOLDERS)}: {'all' if not found else 'not all'} covered")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
