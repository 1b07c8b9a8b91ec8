#!/usr/bin/python3
"""The patches of docs/extending.md: each applies to a copy of the sources, touches at most four source files, compiles, and does what the
page says. Python's standard library, patch, ninja and the compiler of the build.

usage: patches_test.py BUILD_DIR
       patches_test.py --self-test BUILD_DIR    patches with an error each, which must be refused

Only files that a patch touches are compiled, with the flags of BUILD_DIR/compile_commands.json but without optimisation; the program is
linked with the libraries of BUILD_DIR."""
import json
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FILES_MAX = 4
USERS_OF_THE_LAW = ["host_sim/controller/controller_config.cpp", "firmware/cycle/instances_rr_double.cpp"]
DIFF = re.compile(r"^```diff\n(.*?)^```$", re.M | re.S)


class Refused(Exception):
    pass


def run(command, **more):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=300, **more)
    if done.returncode != 0:
        raise Refused(f"{' '.join(map(str, command))[:200]}\n{done.stdout[-1500:]}{done.stderr[-1500:]}")
    return done.stdout


def touched(patch):
    return sorted(set(re.findall(r"^\+\+\+ b/(\S+)", patch, re.M)))


def copy_of(folder, patch):
    for name in ("firmware", "hal", "host_sim"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("node_modules"))
    files = touched(patch)
    if not 0 < len(files) <= FILES_MAX:
        raise Refused(f"touches {len(files)} source files, at most {FILES_MAX}: {', '.join(files)}")
    run(["patch", "--strip=1", "--fuzz=1", "--batch", "--forward", "--no-backup-if-mismatch", "--directory", folder], input=patch)
    return files


class Build:
    def __init__(self, build):
        self.build = build
        entries = json.loads((build / "compile_commands.json").read_text(encoding="utf-8"))
        self.units = {Path(e["file"]): shlex.split(e["command"]) for e in entries if "/Unity/" in e["file"]}
        self.commands = {str(Path(e["file"]).relative_to(ROOT)): shlex.split(e["command"]) for e in entries
                         if Path(e["file"]).is_relative_to(ROOT / "firmware") or Path(e["file"]).is_relative_to(ROOT / "host_sim")}

    def compile(self, tree, name, out):
        """Compiles `name` of the tree; a new file with the flags of another one of its folder. Without `out` only its syntax is checked."""
        flags = self.commands.get(name) or next(
            (c for other, c in sorted(self.commands.items()) if Path(other).parent == Path(name).parent), None) or self.unity(name)
        if flags is None:
            raise Refused(f"{name}: no file of its folder is compiled")
        kept, skip = [], False
        for flag in flags:
            if skip or flag in ("-include", "-o", "-c"):
                skip = not skip and flag != "-c"
            elif not flag.endswith((".cpp", ".cxx")) and flag != "-Winvalid-pch":
                kept.append(f"-I{tree}" if flag == f"-I{ROOT}" else flag)
        run([f for f in kept if f != "ccache" and not f.endswith("/ccache")] +
            ["-O0", *(["-c", "-o", out] if out else ["-fsyntax-only"]), tree / name], cwd=self.build)

    def unity(self, name):
        """The flags of the unit that includes the file, or a file of its folder, where several are compiled at a time."""
        folder = None
        for unit, flags in sorted(self.units.items()):
            included = re.findall(r'#include "([^"]+)"', unit.read_text(encoding="utf-8"))
            names = [str(Path(i).relative_to(ROOT)) for i in included if Path(i).is_relative_to(ROOT)]
            if name in names:
                return flags
            if folder is None and any(Path(n).parent == Path(name).parent for n in names):
                folder = flags
        return folder

    def link(self, objects, out):
        """The program with `objects` in place of its own of the same source, and beside them."""
        line = run(["ninja", "-C", self.build, "-t", "commands", "esmc"]).strip().splitlines()[-1]
        words = shlex.split(line.removeprefix(": && ").removesuffix(" && :"))
        at = words.index("-o")
        own = [o for o in words[:at] if not any(o.endswith(f".dir/{Path(n).relative_to('host_sim')}.o") for n in objects)]
        # Where several files are compiled at a time, the unit has the old definition as well: the first one counts.
        run([*own, *objects.values(), "-Wl,--allow-multiple-definition", "-o", out, *words[at + 2:]], cwd=self.build)


def try_law(patch, build):
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        for name in [f for f in copy_of(tree, patch) if f.endswith(".cpp")] + USERS_OF_THE_LAW:
            build.compile(tree, name, None)
        check = tree / "firmware/rational_law.cpp"
        shutil.copy(ROOT / "tests/examples/rational_law.cpp", check)
        run(["c++", "-std=c++20", "-isystem", "/usr/include/eigen3", f"-I{tree}", check, "-o", tree / "check"])
        return run([tree / "check"])


def try_command(patch, build):
    with tempfile.TemporaryDirectory() as folder:
        tree, objects = Path(folder), {}
        for name in [f for f in copy_of(tree, patch) if f.endswith(".cpp")]:
            objects[name] = tree / f"{len(objects)}.o"
            build.compile(tree, name, objects[name])
        build.link(objects, tree / "esmc")
        return run([tree / "esmc", "pose", "host_sim/scenes/five_bar_circle.toml"], cwd=ROOT)


def compare(printed, shown):
    if printed.strip() != shown.strip():
        raise Refused(f"esmc pose prints {printed.strip()}, the page shows {shown.strip()}")


def page():
    text = (ROOT / "docs/extending.md").read_text(encoding="utf-8")
    patches = DIFF.findall(text)
    if len(patches) != 2:
        raise Refused(f"docs/extending.md has {len(patches)} patches, not 2")
    shown = next(out for command, out in re.findall(r"^\$ (.*)\n(.*)$", text, re.M) if command.startswith("build/patched/esmc pose"))
    return patches, shown


def self_test(build):
    (law, _), shown = page()
    more = "".join(f"--- /dev/null\n+++ b/host_sim/x{i}.hpp\n@@ -0,0 +1 @@\n+#pragma once\n" for i in range(FILES_MAX))
    seeded = [("too many files", lambda: try_law(law + more, build)),
              ("a law that does not compile", lambda: try_law(law.replace("rational,", "rationale,", 1), build)),
              ("a hunk that does not apply", lambda: try_law(re.sub(r"^ (.)", r" gone\1", law, flags=re.M), build)),
              ("another output than the page's", lambda: compare(shown, shown + "."))]
    failed = 0
    for what, attempt in seeded:
        try:
            attempt()
            failed += 1
            print(f"patches_test.py: accepts {what}")
        except Refused:
            pass
    print(f"{len(seeded) - failed} of {len(seeded)} seeded errors refused")
    return failed


def main():
    arguments = sys.argv[1:]
    seeded = arguments[:1] == ["--self-test"]
    if len(arguments) != 1 + seeded:
        print(__doc__, file=sys.stderr)
        return 2
    build = Build(Path(arguments[-1]).resolve())
    if seeded:
        return 1 if self_test(build) else 0
    try:
        (law, command), shown = page()
        print(try_law(law, build), end="")
        printed = try_command(command, build)
        print(printed, end="")
        compare(printed, shown)
    except Refused as e:
        print(f"docs/extending.md: {e}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
