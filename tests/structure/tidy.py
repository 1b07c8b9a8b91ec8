#!/usr/bin/env python3
"""clang-tidy, with .clang-tidy and firmware/.clang-tidy, over what the product compiles.

tidy.py CLANG_TIDY BUILD... [--sample COUNT] [--jobs COUNT]   BUILD: a configured folder with compile_commands.json
tidy.py CLANG_TIDY --self-test

Without --sample every file; with it, COUNT files drawn by the commit's hash. The first BUILD is one of the host; of further ones,
of boards, only files of boards/ are taken, and one that is not there is left out. The language flags of gcc do as well as those
of clang; precompiled headers are left out, as each file has to include what it uses.
"""

import concurrent.futures
import json
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile

from sources import PRODUCT, ROOT

sys.path.insert(0, str(ROOT / "tests/support"))
import sample  # noqa: E402

FINDING = re.compile(r"^(\S+?):(\d+):(\d+): (?:warning|error): (.*) \[([\w.,-]+)\]$", re.M)


def without_precompiled_headers(arguments):
    """The arguments without what CMake adds for a precompiled header of gcc or clang, and what only gcc takes."""
    kept, skip = [], 0
    for at, word in enumerate(arguments):
        following = arguments[at:at + 4]
        if skip:
            skip -= 1
        elif word == "-Xclang" and len(following) == 4 and "cmake_pch" in following[3]:
            skip = 3
        elif word == "-include" and len(following) > 1 and "cmake_pch" in following[1]:
            skip = 1
        elif not word.startswith("--param=") and word not in ("-Winvalid-pch", "-Wno-maybe-uninitialized", "-fpch-instantiate-templates", "-fcallgraph-info=su"):
            kept.append(word)
    return kept


def cross_flags(compiler, arguments):
    """What clang has to be told to read code of an Arm board: the target, and where its compiler has the libraries."""
    machine = [a for a in arguments if a.startswith("-m")]
    shown = subprocess.run([compiler, "-E", "-x", "c++", "-", "-v", *machine], input="", capture_output=True, text=True, check=True)
    folders = re.findall(r"^ (/\S+)$", shown.stderr, re.M)
    own = [f for f in folders if not re.search(r"/gcc/[^/]+/[\d.]+/include(-fixed)?$", f)]  # clang has headers of its own for these
    return ["--target=arm-none-eabi", "-nostdlibinc", *(word for f in own for word in ("-isystem", f))]


def arguments_of(command):
    arguments = shlex.split(command)
    while "ccache" in pathlib.Path(arguments[0]).name:
        arguments = arguments[1:]
    arguments = without_precompiled_headers(arguments)
    if pathlib.Path(arguments[0]).name.startswith("arm-none-eabi"):
        return ["clang++", *arguments[1:], *cross_flags(arguments[0], arguments)]
    return arguments


def sources_of(file, build):
    """The source files of the project that a translation unit stands for: itself, or those that a unity unit includes."""
    if not file.is_relative_to(build):
        return [file] if file.is_relative_to(ROOT) else []
    if not file.name.startswith("unity_"):
        return []  # generated
    return [pathlib.Path(name) for name in re.findall(r'^#include "(/.*)"$', file.read_text(encoding="utf-8"), re.M)]


def commands_of(builds):
    """The compile commands of the product by (source file, board), generated sources left out."""
    commands = {}
    for build in builds:
        database = build / "compile_commands.json"
        if build != builds[0] and not database.exists():
            print(f"{build}: not configured, left out")
            continue
        for entry in json.loads(database.read_text(encoding="utf-8")):
            for file in sources_of(pathlib.Path(entry["file"]), build):
                place, board = file.relative_to(ROOT), "" if build == builds[0] else build.name
                if place.parts[0] not in (("boards",) if board else PRODUCT) or (place.as_posix(), board) in commands:
                    continue
                arguments = [str(file) if a == entry["file"] else a for a in arguments_of(entry["command"])]
                commands[place.as_posix(), board] = {"directory": entry["directory"], "file": str(file), "arguments": arguments}
    return commands


def findings_in(clang_tidy, command):
    """Findings in one translation unit: (file, line, column, check, text)."""
    with tempfile.TemporaryDirectory() as database:
        pathlib.Path(database, "compile_commands.json").write_text(json.dumps([command]), encoding="utf-8")
        run = subprocess.run([clang_tidy, "-p", database, "--quiet", command["file"]], capture_output=True, text=True, check=False)
    found = {(m[1], int(m[2]), int(m[3]), m[5].removesuffix(",-warnings-as-errors"), m[4]) for m in FINDING.finditer(run.stdout)}
    if run.returncode != 0 and not found:
        found.add((command["file"], 1, 1, "clang-tidy", f"failed: {(run.stdout + run.stderr)[-2000:]}"))
    return found


def check(clang_tidy, builds, count, jobs):
    commands = commands_of(builds)
    names = sample.drawn(sorted(commands), count, lambda name: " for ".join(filter(None, name)))
    found = set()
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        for more in pool.map(lambda name: findings_in(clang_tidy, commands[name]), names):
            found |= more
    for file, line, column, name, text in sorted(found):
        print(f"{os.path.relpath(file, ROOT)}:{line}:{column}: {text} [{name}]")
    print(f"{len(found)} findings of clang-tidy in {len(names)} of {len(commands)} translation units")
    return int(bool(found) or not names)


# Folder, code, the check that must refuse it; None: nothing is to be found.
SEEDED = [
    ("host_sim", "double f(int a) { return a / 2; }\n", "bugprone-integer-division"),
    ("host_sim", "int f(int a) {\n  if (a > 1);\n  return a;\n}\n", "bugprone-suspicious-semicolon"),
    ("host_sim", "struct Large {\n  int v[99];\n  Large(const Large&);\n};\nint f(Large a) { return a.v[0]; }\n",
     "performance-unnecessary-value-param"),
    ("host_sim", "struct small_case {};\n", "readability-identifier-naming"),
    ("host_sim", "class A {\n  int a = 0;\n};\n", "readability-identifier-naming"),
    ("hal", "int CamelFunction() { return 1; }\n", "readability-identifier-naming"),
    ("boards", "namespace Camel {}\n", "readability-identifier-naming"),
    ("firmware", "int f(int a) { return a > 0 ? f(a - 1) : 0; }\n", "misc-no-recursion"),
    ("firmware", "int f(int a) {\n  if (a > 0) goto end;\n  a = 3;\nend:\n  return a;\n}\n", "cppcoreguidelines-avoid-goto"),
    ("firmware", "void f(int a, int b, int c, int d, int e, int f, int g, int h, int i) { (void)a; }\n", "readability-function-size"),
    ("firmware", "int* f() { return new int; }\n", "cppcoreguidelines-owning-memory"),
    ("firmware", "#define TWICE(x) (x) * (x)\n", "cppcoreguidelines-macro-usage"),
    ("firmware", "int f(unsigned long a) { return *reinterpret_cast<int*>(a); }\n", "cppcoreguidelines-pro-type-reinterpret-cast"),
    ("firmware", "int count = 0;\n", "cppcoreguidelines-avoid-non-const-global-variables"),
    ("firmware", "int f(bool b) {\n  int a;\n  if (b) a = 1;\n  return b ? a : 0;\n}\n", "cppcoreguidelines-init-variables"),
    ("host_sim", "class A {\n public:\n  int get() const { return a_; }\n\n private:\n  int a_ = 0;\n};\n", None),
    ("firmware", "namespace esmc {\nconstexpr int square(int a) { return a * a; }\n}  // namespace esmc\n", None),
]


def self_test(clang_tidy):
    failed = 0
    with tempfile.TemporaryDirectory() as scratch:
        copy = pathlib.Path(scratch)
        for folder in PRODUCT:
            (copy / folder).mkdir()
        for config in (".clang-tidy", "firmware/.clang-tidy"):
            shutil.copy(ROOT / config, copy / config)
        for number, (folder, code, wanted) in enumerate(SEEDED):
            header, file = copy / folder / f"seeded{number}.hpp", copy / folder / f"seeded{number}.cpp"
            header.write_text("#pragma once\n" + code, encoding="utf-8")
            file.write_text(f'#include "{header}"\n', encoding="utf-8")
            command = {"directory": str(copy), "file": str(file), "arguments": ["clang++", "-std=c++20", "-c", str(file)]}
            found = {name for *_, name, _ in findings_in(clang_tidy, command)}
            if not (any(wanted in name.split(",") for name in found) if wanted else not found):
                failed += 1
                print(f"tidy.py: should find {wanted or 'nothing'}, found {sorted(found)} in {folder}:\n{code}")
    print(f"{len(SEEDED) - failed} of {len(SEEDED)} seeded cases judged rightly")
    return int(bool(failed))


def main():
    arguments = sys.argv[1:]
    if len(arguments) == 2 and arguments[1] == "--self-test":
        return self_test(arguments[0])
    count, jobs = sample.take_option(arguments), os.cpu_count() or 1
    if "--jobs" in arguments:
        at = arguments.index("--jobs")
        jobs = int(arguments[at + 1])
        del arguments[at:at + 2]
    if len(arguments) < 2:
        print(__doc__, file=sys.stderr)
        return 2
    return check(arguments[0], [pathlib.Path(a).resolve() for a in arguments[1:]], count, jobs)


if __name__ == "__main__":
    sys.exit(main())
