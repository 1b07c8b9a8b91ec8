#!/usr/bin/env python3
"""Mutation study: is every line of a folder not only run by its tests, but judged by them?

usage: study.py BUILD [--only FOLDER] [--page FILE]     BUILD: a folder for what is compiled, and for results
       study.py --self-test

All mutants of a folder are compiled into one test program and chosen by the environment variable MUTANT. A mutant is killed
when the tests fail, crash or do not end. What only the compiler evaluates (constants, tables), and what survives in a function
that it evaluates somewhere, is then compiled by itself, so that static assertions and constant expressions have their say; not to
compile is death as well. The compiler itself says which functions these are: a mutant in any other is no constant expression. What survives that must be listed in equivalent.txt with a reason why no test can tell it from the original; an entry
there that fits no surviving mutant is an error.

A verdict is kept in BUILD, and holds while the tests that gave it, and all that they include, stay as they are: a study can be
interrupted, and a new test in a file of its own costs what it judges.

--page: writes docs/mutants.md, of every folder what its last whole run has given."""

import argparse
import functools
import hashlib
import json
import os
import pathlib
import re
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor

import mutants

ROOT = pathlib.Path(__file__).resolve().parents[2]
HERE = pathlib.Path(__file__).resolve().parent
FOLDERS = {
    "firmware/safety": ("safety", "supervisor", "supervisor_edges"),
    "firmware/drive": ("drive_numbers", "cia402_table", "drive_corners", "odrive_codec", "odrive_axis", "odrive_faults", "odrive_frames", "odrive_read_back",
                       "canopen_codec", "cia402_axis", "cia402_corners", "cia402_counts", "cia402_frames", "cia402_halves", "cia402_setup", "mit_codec", "mit_axis",
                       "moteus_codec", "moteus_axis", "id_filters", "drive_edges", "moteus_edges", "odrive_edges"),
    "firmware/link": ("link_codec", "link", "link_motion", "link_capture", "link_told", "link_store", "parameter_slots", "link_edges", "link_home", "slot_edges"),
    "firmware/cycle": ("cycle", "cycle_corners", "cycle_fault", "cycle_frames", "cycle_torque", "cycle_hostile", "cycle_io", "cia402_cycle", "cycle_link",
                       "part_corners", "plausibility", "setpoint_generator", "path_rate", "fusion", "cycle_edges", "homing", "homing_alone",
                       "cycle_start", "setpoint_edges", "part_edges", "cycle_drives", "cycle_samples", "controller_edges", "controller_start"),
    "firmware/control": ("reaching", "reference", "control_corners", "super_twisting", "coupled_step", "allocation", "box_allocation", "law", "law_bits"),
}
UNITS = {"firmware/cycle": "firmware/cycle/instances_part_*.cpp"}  # what tests need beside headers
ARCHIVE = "firmware/cycle/instances.hpp"  # keeps its templates out of the tests, where mutants are to be judged
SLOW = "*Random*"  # tests by the hundred thousand frames come last
FLAGS = ["-std=c++20", "-isystem", "/usr/include/eigen3", "-DEIGEN_DONT_VECTORIZE", "-DEIGEN_NO_DEBUG", "-ffp-contract=off",
         "-Wno-c++11-narrowing", "-Wno-invalid-constexpr", "-ferror-limit=0", "-w"]
NO_MUTANT = 77
TIMED_OUT = -1000


class Bench:
    """Tests of one folder, compiled against changed headers."""

    def __init__(self, root, folder, tests, build, cxx="clang++"):
        self.root, self.folder, self.cxx = root, folder, cxx
        self.tests = [f"tests/unit/{t}_test.cpp" for t in tests]
        self.build = build / folder
        self.build.mkdir(parents=True, exist_ok=True)
        self.units = sorted(str(f.relative_to(root)) for f in root.glob(UNITS[folder])) if folder in UNITS else []
        self.numeric = "control" in folder or "cycle" in folder
        self.level = "-O1" if self.numeric else "-O0"  # its tests take minutes without optimisation, the others ms
        self.precompile()
        self.patience = {}  # by pattern, s
        self.deadly = {}    # by file: the test that killed last is tried first

    def precompile(self):
        head = self.build / f"gtest{self.level}.hpp"
        text = (f"// {self.cxx} {' '.join(FLAGS)}\n#include <gtest/gtest.h>\n#include <cmath>\n#include <random>\n#include <set>\n#include <vector>\n" +
                ("#include <Eigen/Dense>\n" if self.numeric else ""))
        if not head.with_suffix(".pch").exists() or head.read_text() != text:
            head.write_text(text)
            subprocess.run([self.cxx, *FLAGS, self.level, "-x", "c++-header", head, "-o", head.with_suffix(".pch")], check=True)

    def compile(self, overlay, test, out):
        return subprocess.run([self.cxx, *FLAGS, self.level, "-include-pch", self.build / f"gtest{self.level}.pch", f"-I{overlay}", f"-I{HERE}", f"-I{self.root}",
                               *(["-c", "-o", out] if out else ["-fsyntax-only"]), self.root / test],
                              capture_output=True, text=True, check=False)

    def link(self, objects, out):
        subprocess.run([self.cxx, *objects, "-o", out, "-lgtest", "-lgtest_main", "-lpthread"], check=True)

    def filters(self, test):
        """gtest's patterns for what is in a file: first all that is fast, then the rest."""
        text = (self.root / test).read_text()
        names = sorted(set(re.findall(r"^(?:TYPED_)?TEST(?:_F|_P)?\((\w+),", text, re.M)))
        out = [":".join(f"{n}.*:{n}/*" for n in names) + f"-{SLOW}"]
        if re.search(r"^(?:TYPED_)?TEST(?:_F|_P)?\(\w+, *\w*Random", text, re.M):
            out.append(":".join(f"{n}.{SLOW}:{n}/{SLOW}" for n in names))
        return out

    def judges(self, file):
        """Tests that include it, those of its name first."""
        stem = pathlib.Path(file).stem
        mine = [t for t in self.tests if file in self.includes(t)]
        return sorted(mine, key=lambda t: (stem not in t, stem.split("_")[0] not in t))

    def once(self, program, tests, number=None, patience=600.0):
        """Exit status, or TIMED_OUT."""
        environment = {"PATH": os.environ["PATH"], **({} if number is None else {"MUTANT": str(number)})}
        limit = lambda: resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))  # noqa: E731
        try:
            return subprocess.run([program, "--gtest_brief=1", "--gtest_fail_fast", f"--gtest_filter={tests}"],
                                  env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                  timeout=patience, preexec_fn=limit, check=False).returncode
        except subprocess.TimeoutExpired:
            return TIMED_OUT

    def run(self, program, m):
        """Status, and the test file that gave it, the fastest first; 0 if all pass."""
        rounds = [(i, self.patience[f], t, f) for t in self.judges(m.file) for i, f in enumerate(self.filters(t))]
        for _, _, test, tests in sorted(rounds):
            status = self.once(program, tests, m.number, self.patience[tests])
            if status != 0:
                return status, test
        return 0, ""

    def open_templates(self, overlay):
        """Every test has the templates of the archive compiled anew."""
        if not (self.root / ARCHIVE).exists():  # the self-test
            return
        target = overlay / ARCHIVE
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(re.sub(r"^(ESMC_CONTROLLER\(extern template|extern template)[^;]*;", "", (self.root / ARCHIVE).read_text(), flags=re.M))

    def write(self, overlay, all_):
        wanted = {m.file for m in all_} | {ARCHIVE}
        self.open_templates(overlay)
        for old in overlay.rglob("*.hpp"):  # of a study of more files: its numbers are others
            if str(old.relative_to(overlay)) not in wanted:
                old.unlink()
        for file in sorted(wanted - {ARCHIVE}):
            target = overlay / file
            target.parent.mkdir(parents=True, exist_ok=True)
            text = mutants.together((self.root / file).read_text(), [m for m in all_ if m.file == file])
            if not target.exists() or target.read_text() != text:
                target.write_text(text)

    @staticmethod
    def relent(all_, messages):
        """Whether something can be done about it: functions that the compiler evaluates, or mutants without their form."""
        folded = {(all_[int(n)].file, all_[int(n)].function) for n in re.findall(r"in call to 'is\((\d+)\)'", messages)}
        hit = [m for m in all_ if not m.folded and (m.file, m.function) in folded]
        for m in hit:
            m.folded = True
        if hit:
            return True
        for kind in ("error", "note"):
            bad = {(f, int(n)) for f, n in re.findall(rf"together/(\S+):(\d+):\d+: {kind}", messages)}
            hit = [m for m in all_ if m.form and (m.file, m.line) in bad]
            if hit:
                break
        for m in hit:
            m.form = ""
        return bool(hit)

    def together(self, all_):
        """One program with all mutants; those that it cannot have lose their form."""
        overlay = self.build / "together"
        self.write(overlay, all_)
        for test in self.tests:  # what one test needs, the others can bear
            for _ in range(100):
                done = self.compile(overlay, test, None)
                if done.returncode == 0:
                    break
                if not self.relent(all_, done.stderr):
                    sys.exit(f"{self.folder}: tests do not compile:\n{done.stderr[:3000]}")
                self.write(overlay, all_)
        sources = [*self.tests, *self.units]
        objects = [self.build / (pathlib.Path(source).stem + ".o") for source in sources]
        for test, out in zip(sources, objects):
            if self.compile(overlay, test, out).returncode != 0:
                sys.exit(f"{self.folder}: {test} does not compile")
        program = self.build / "together.out"
        self.link(objects, program)
        for test in self.tests:
            for tests in self.filters(test):
                start = time.monotonic()
                if self.once(program, tests) != 0:
                    sys.exit(f"{self.folder}: {test} fails without a mutant")
                self.patience[tests] = 5.0 + 10.0 * (time.monotonic() - start)
        return program

    @functools.cache  # noqa: B019
    def includes(self, test):
        """Files of the project that a test is made of."""
        seen, waiting = set(), [test, *self.units]
        while waiting:
            for name in re.findall(r'^#include "([^"]+)"', (self.root / waiting.pop()).read_text(), re.M):
                if name not in seen and (self.root / name).exists():
                    seen.add(name)
                    waiting.append(name)
        return seen

    @functools.cache  # noqa: B019
    def fingerprint(self, tests):
        """Of everything that a verdict of these test files comes from, but for comments on lines of their own."""
        files = sorted({*tests, *(n for t in tests for n in self.includes(t))})
        parts = [self.cxx, *FLAGS, self.level,
                 *((HERE / n).read_text() for n in ("mutants.py", "mutant.hpp"))]
        for name in files:
            parts += [name, re.sub(r"^ *//.*\n", "", (self.root / name).read_text(), flags=re.M)]
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()

    def alone(self, m):
        """How a mutant dies when it is compiled by itself, and by which test file; "" if it does not."""
        overlay = self.build / "alone"
        target = overlay / m.file
        target.parent.mkdir(parents=True, exist_ok=True)
        for old in target.parent.glob("*"):
            old.unlink()
        self.open_templates(overlay)
        target.write_text(mutants.alone((self.root / m.file).read_text(), m))
        judges = sorted(self.judges(m.file), key=lambda t: t != self.deadly.get(m.file))
        objects = {test: self.build / f"alone_{pathlib.Path(test).stem}.o" for test in judges}
        units = [self.build / (pathlib.Path(unit).stem + ".o") for unit in self.units]
        for test, out in objects.items():
            how = "" if self.compile(overlay, test, out).returncode == 0 else "not compiled"
            how = how or self.linked([out, *units], test)
            if how:
                self.deadly[m.file] = test
                return how, test
        # Most are dead by now. In the units they were chosen at run time, or not at all.
        anew = [self.build / f"alone_{unit.name}" for unit in units]
        for unit, out in zip(self.units, anew):
            if self.compile(overlay, unit, out).returncode != 0:
                return "not compiled", judges[0]
        for test, out in objects.items() if units else ():
            how = self.linked([out, *anew], test)
            if how:
                return how, test
        return "", ""

    def linked(self, objects, test):
        """How the program of these objects dies in the cases of a test; "" if it does not."""
        self.link(objects, self.build / "alone.out")
        status = self.once(self.build / "alone.out", "*", patience=3 * sum(self.patience[f] for f in self.filters(test)))
        return {0: "", TIMED_OUT: "did not end"}.get(status, "failed")


class Memory:
    """Verdicts of earlier runs. They hold as long as what they came from is the same, to the character."""

    def __init__(self, bench):
        self.bench, self.file = bench, bench.build / "verdicts.json"
        self.all = json.loads(self.file.read_text()) if self.file.exists() else {}

    def get(self, m):
        verdict, tests, mark = self.all.get("\n".join(m.key), ("", [], ""))
        same = verdict and all(t in self.bench.judges(m.file) for t in tests) and mark == self.bench.fingerprint(tuple(tests))
        complete = verdict != "survives" or tests == self.bench.judges(m.file)
        return verdict if same and complete else ""

    def put(self, m, verdict, tests):
        self.all["\n".join(m.key)] = verdict, tests, self.bench.fingerprint(tuple(tests))
        new = self.file.with_suffix(".new")
        new.write_text(json.dumps(self.all))
        new.replace(self.file)


def judge(bench, all_, told=print):
    """Mutants that survive. Those that do not exist are dropped from `all_`."""
    memory, verdicts = Memory(bench), {}
    for i, m in enumerate(all_):
        m.number = i
        verdicts[i] = memory.get(m)
    new = [m for m in all_ if not verdicts[m.number]]
    told(f"{bench.folder}: {len(all_)} mutants, {len(new)} to be judged")
    program = bench.together(all_) if new else None

    def conclude(m, verdict, tests, lasting=True):
        verdicts[m.number] = verdict
        if lasting:
            memory.put(m, verdict, tests)
        if verdict in ("survives", "did not end"):
            told(f"  {verdict}: {m}")

    def dies(m, status, test):
        how = {NO_MUTANT: "does not exist", TIMED_OUT: "did not end"}.get(status, "failed")
        conclude(m, how, [test], lasting=status != TIMED_OUT)  # a slow machine is no verdict for ever

    suspects = []
    pool = ThreadPoolExecutor(os.cpu_count())
    for i, (m, (status, test)) in enumerate(zip(new, pool.map(lambda m: bench.run(program, m) if m.form else (0, ""), new))):
        if i % 200 == 199:
            told(f"{bench.folder}: {i + 1}")
        if status != 0:
            dies(m, status, test)
        elif m.form and not m.folded:
            conclude(m, "survives", bench.judges(m.file))
        else:
            suspects.append(m)
    told(f"{bench.folder}: {len(suspects)} to be compiled by themselves")
    for i, m in enumerate(suspects):
        if i % 50 == 49:
            told(f"{bench.folder}: {i + 1}")
        how, test = bench.alone(m)
        conclude(m, how or "survives", [test] if how else bench.judges(m.file), lasting=how != "did not end")
    all_[:] = [m for m in all_ if verdicts[m.number] != "does not exist"]
    return [m for m in all_ if verdicts[m.number] == "survives"]


def equivalents(text):
    """{(file, function: source line, change): reason}: paragraphs of three lines."""
    out = {}
    for paragraph in re.split(r"\n\s*\n", "\n".join(n for n in text.splitlines() if not n.startswith("#"))):
        lines = [n.strip() for n in paragraph.strip().splitlines()]
        if not lines:
            continue
        if len(lines) < 3 or ": " not in lines[0]:
            sys.exit(f"equivalent.txt: not three lines: {lines}")
        file, source = lines[0].split(": ", 1)
        out[file, source, lines[1]] = " ".join(lines[2:])
    return out


def study(root, folders, build, known, only="", cxx="clang++", told=print):
    figures, left, used = {}, [], set()
    for folder, tests in folders.items():
        if only and not folder.startswith(only.rsplit("/", 1)[0] if only.endswith(".hpp") else only):
            continue
        all_ = []
        for file in sorted((root / folder).glob("*.hpp")):
            name = str(file.relative_to(root))
            if name.startswith(only) or only in folder:
                all_ += mutants.Reader(root, name, [f for f in FLAGS if f != "-w"], cxx).mutants()
        if not all_:
            continue
        survivors = judge(Bench(root, folder, tests, build, cxx), all_, told)
        for m in all_:
            f = figures.setdefault(m.file, [0, 0, 0])
            f[0] += 1
            f[1] += m not in survivors
        for m in survivors:
            if m.key in known:
                figures[m.file][2] += 1
                used.add(m.key)
            else:
                left.append(m)
    if only in ("", *folders):
        kept = build / "figures.json"
        old = json.loads(kept.read_text()) if kept.exists() else {}
        kept.write_text(json.dumps({f: v for f, v in old.items() if only and not f.startswith(only)} | figures))
    unused = [k for k in known if k not in used and k[0] in figures]
    return figures, left, unused


def page(figures, known):
    rows = [f"| `{f}` | {n} | {k} | {e} | {n - k - e} |" for f, (n, k, e) in sorted(figures.items())]
    total = [sum(v[i] for v in figures.values()) for i in range(3)]
    text = (HERE / "page.md").read_text().replace("TABLE", "\n".join([
        "| file | mutants | killed | equivalent | not judged |", "|---|---|---|---|---|", *rows,
        f"| all | {total[0]} | {total[1]} | {total[2]} | {total[0] - total[1] - total[2]} |"]))
    parts = []
    for file in sorted(figures):
        mine = [(s, c, why) for (f, s, c), why in known.items() if f == file]
        if mine:
            parts.append(f"### {file}\n")
            parts += [f"* `{s}`: `{c}`. {why}" for s, c, why in mine]
            parts.append("")
    return text.replace("LIST", "\n".join(parts).rstrip())


def self_test(cxx):
    header = """#pragma once
namespace esmc {
inline constexpr int most = 3;
static_assert(most < 10);
constexpr int twice(int v) { return v + v; }
static_assert(twice(2) == 4);
inline bool allowed(int v) { return v >= 0 && v < most; }
inline int clamped(int v) {
  if (v > most) v = most;  // 1 + 1 here is no mutant
  return v;
}
inline int before(int v) { return v > 0 ? v - 1 : 0; }
}
"""
    test = """#include <gtest/gtest.h>
#include "firmware/seeded/seeded.hpp"
TEST(Seeded, All) {
  EXPECT_TRUE(esmc::allowed(0) && esmc::allowed(1));
  EXPECT_FALSE(esmc::allowed(-1) || esmc::allowed(3));
  EXPECT_EQ(esmc::clamped(9), 3);
  EXPECT_EQ(esmc::clamped(2), 2);
  EXPECT_EQ(esmc::before(2), 1);
  EXPECT_EQ(esmc::before(0), 0);
}
"""
    with tempfile.TemporaryDirectory() as scratch:
        root = pathlib.Path(scratch).resolve()
        for name, text in (("firmware/seeded/seeded.hpp", header), ("tests/unit/seeded_test.cpp", test)):
            (root / name).parent.mkdir(parents=True)
            (root / name).write_text(text)
        known = equivalents("# the bound itself\nfirmware/seeded/seeded.hpp: clamped: if (v > most) v = most;  // 1 + 1 here is no mutant\n"
                            "  v > most => v >= most\n  most is clamped to most\n\n"
                            "firmware/seeded/seeded.hpp: before: inline int before(int v) { return v > 0 ? v - 1 : 0; }\n"
                            "  0 => 1\n  before 1 is 0 either way\n\n"
                            "firmware/seeded/seeded.hpp: gone\n  a => b\n  fits nothing\n")
        build = root / "build"
        build.mkdir()
        figures, left, unused = study(root, {"firmware/seeded": ("seeded",)}, build, known, cxx=cxx, told=lambda _: None)
        n, killed, equivalent = figures["firmware/seeded/seeded.hpp"]
        found = [(m.line, m.change) for m in left]
        wrong = []
        if found != []:
            wrong.append(f"survivors {found}")
        if [k[1] for k in unused] != ["gone"] or equivalent != 2 or killed != n - 2 or n < 12:
            wrong.append(f"unused {unused}, of {n} mutants {killed} killed, {equivalent} equivalent")
        weaker = test.replace(" || esmc::allowed(3)", "").replace("  EXPECT_EQ(esmc::before(0), 0);\n", "")
        (root / "tests/unit/seeded_test.cpp").write_text(weaker)
        _, left, _ = study(root, {"firmware/seeded": ("seeded",)}, build, known, cxx=cxx, told=lambda _: None)
        found = [(m.line, m.change) for m in left]
        for expected in ((7, "v < most => v <= most"), (7, "v >= 0 && v < most => v >= 0"),
                         (12, "0 => 1 (no. 2)")):  # its neighbour is known, it is not
            if expected not in found:
                wrong.append(f"not found: {expected} among {found}")
        for line in wrong:
            print(line)
        return 1 if wrong else 0


def main():
    p = argparse.ArgumentParser()
    p.add_argument("build", nargs="?", type=pathlib.Path)
    p.add_argument("--self-test", action="store_true")
    p.add_argument("--only", default="")
    p.add_argument("--page", type=pathlib.Path)
    p.add_argument("--cxx", default="clang++")
    a = p.parse_args()
    if a.self_test:
        return self_test(a.cxx)
    a.build.mkdir(parents=True, exist_ok=True)
    known = equivalents((HERE / "equivalent.txt").read_text())
    told = lambda line: print(line, flush=True)  # noqa: E731
    figures, left, unused = study(ROOT, FOLDERS, a.build, known, a.only, a.cxx, told)
    for m in left:
        print(f"{m}")
    for k in unused:
        print(f"equivalent.txt: fits no surviving mutant: {k}")
    n, killed, equivalent = (sum(v[i] for v in figures.values()) for i in range(3))
    print(f"{n} mutants, {killed} killed, {equivalent} equivalent, {len(left)} left")
    if a.page:
        a.page.write_text(page(json.loads((a.build / "figures.json").read_text()), known))
    return 1 if left or unused else 0


if __name__ == "__main__":
    sys.exit(main())
