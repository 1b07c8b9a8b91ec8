#!/usr/bin/python3
"""The documentation against the program it describes. Python's standard library only.

usage: docs_test.py ESMC [BUILD_DIR]    BUILD_DIR: also installs it and builds the README's example against it
       docs_test.py ESMC --update       writes the key table and what console blocks print into the pages
       docs_test.py --self-test         seeds an error of each kind into a copy and expects it to be found

Checked: the key table of docs/scenes.md; every relative link and heading that is linked to; every fault named in
docs/safety.md; every column and summary key in docs/output.md; every line `build/host/esmc ...` of a ```sh block ends
with 0; every ```console block prints what it shows (numbers within 0.6 %; digests exactly, where processor, compiler and C library are
those that docs/output.md names). Lines with `socketcan` need a CAN interface
and are not run; lines with `build/host/tests/` need BUILD_DIR, where that is built. Blocks of one page run in their order, in a scratch folder.
A block whose first line names a file (```cpp firmware/types.hpp) quotes lines of that file, indented as it likes.
Every numbered equation stands on one page; no block of commands and no output of a command stands twice. The names of the product in
docs/glossary.md exist."""
import csv
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from page import part, put

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = "build/host/esmc"
QUOTE = re.compile(r"^```\w+ (\S+)\n(.*?)^```$", re.M | re.S)
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.M | re.S)
UPDATE = "--update" in sys.argv
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def pages(root):
    return [p for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md") if (p := root / name).is_file()] + \
        sorted((root / "docs").rglob("*.md"))


def key_table(root, esmc):
    scenes = root / "docs/scenes.md"
    if scenes.read_text(encoding="utf-8").count("<!-- keys -->\n") != 1:
        yield "docs/scenes.md: the markers of the key table are gone"
        return
    want = subprocess.run([esmc, "keys"], capture_output=True, text=True, check=True).stdout
    if UPDATE:
        put(scenes, {"keys": want})
    elif (table := part(scenes, "keys")) != want:
        have = table.splitlines()
        line = next((new for new in want.splitlines() if new not in have), "the order of the lines")
        yield f"docs/scenes.md: the key table is not what `esmc keys` prints ({line}); docs_test.py ESMC --update"


def anchors(page):
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    for heading in re.findall(r"^#+ +(.+)$", text, re.M):
        yield re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")
    yield from re.findall(r'<a name="([^"]+)">', text)


def links(root):
    for page in pages(root):
        text = FENCE.sub("", page.read_text(encoding="utf-8"))
        for target in re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'(?:src|href)="([^"]+)"', text):
            if re.match(r"[a-z]+:", target):
                continue
            file, _, anchor = target.partition("#")
            other = (page.parent / file).resolve() if file else page
            if not other.exists():
                yield f"{page.relative_to(root)}: link to {target}: there is no such file"
            elif anchor and anchor not in anchors(other):
                yield f"{page.relative_to(root)}: link to {target}: there is no such heading"


def faults(root):
    source = (root / "firmware/safety/faults.hpp").read_text(encoding="utf-8")
    enum = re.search(r"enum class.*?Fault[^{]*\{(.*?)\};", source, re.S)
    names = re.findall(r"^\s*(\w+)(?: = \d+)?,", enum[1], re.M) if enum else []
    if len(names) < 2:
        yield "firmware/safety/faults.hpp: the list of faults cannot be read"
    halting = re.findall(r"case Fault::(\w+):", cases[1]) if (cases := re.search(
        r"reaction\(Fault f\) \{(.*?)return Reaction::halt;", source, re.S)) else []
    text = (root / "docs/safety.md").read_text(encoding="utf-8")
    for name in names:
        row = re.search(rf"^\| `{name}` \| (\(halt)?", text, re.M)
        if name != "none" and not row:
            yield f"docs/safety.md: no row for the fault {name}"
        elif row and bool(row[1]) != (name in halting):
            yield f"docs/safety.md: the fault {name} is {'' if name in halting else 'not '}answered with a halt"


def option_codes(root):
    """What docs/safety.md says of a drive's own reactions is what the set-up writes."""
    source = (root / "firmware/drive/cia402_setup.hpp").read_text(encoding="utf-8")
    text = (root / "docs/safety.md").read_text(encoding="utf-8")
    for code, name in (("6007h", "abort_connection"), ("605Eh", "fault_reaction"), ("605Ah", "quick_stop")):
        value = re.search(rf"\b{name} = (-?\d+)[,;]", source)
        said = set(re.findall(rf"{code} = (-?\d+)", text))
        if not value or said != {value[1]}:
            yield f"docs/safety.md: {code} = {', '.join(sorted(said)) or 'nothing'}, cia402_setup.hpp: {value[1] if value else 'nothing'}"


def output_files(root, esmc):
    """Names in docs/output.md may stand in short: `tau11` for `tau11_cmd` is not enough, `<joint>_rate` is."""
    text = (root / "docs/output.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([^`\n]+)`", text))
    short = re.compile(r"(s_)?(theta[12]{1,2}|tau[12]{1,2}|x|y|(phi|Xg|Yg)[12]{1,2})(_\w+)?")
    kinds = {"theta": "<joint>", "tau": "<motor>"}
    with tempfile.TemporaryDirectory() as folder:
        for scene in ("five_bar_circle", "rr_line"):
            run = subprocess.run([esmc, "hil", root / f"host_sim/scenes/{scene}.toml", "--out", folder, "--json",
                                  "--set", "simulation.duration=0.05"], capture_output=True, text=True, check=True)
            with open(Path(folder, "log.csv"), newline="", encoding="utf-8") as log:
                for column in next(csv.reader(log)):
                    m = short.fullmatch(column)
                    kind = next((kinds[k] for k in kinds if m and m[2].startswith(k)), "")
                    if column not in named and not (m and m[1] and "s_<channel>" in named) and \
                            not (kind and kind + (m[4] or "") in named):
                        yield f"docs/output.md: column {column} of {scene} is not described"
            for key in re.findall(r'"(\w+)":', run.stdout):
                if key not in named:
                    yield f"docs/output.md: key {key} of summary.json is not described"


def machine(esmc):
    """What a digest depends on besides scene and program: processor, compiler of the program, C library."""
    program = Path(esmc).read_bytes()
    gcc = re.search(rb"GCC: \([^)]*\) (\d+\.\d+)", program)
    compiler = "clang" if b"clang version" in program else f"g++ {gcc[1].decode()}" if gcc else "unknown compiler"
    flags = Path("/proc/cpuinfo").read_text(encoding="utf-8") if Path("/proc/cpuinfo").exists() else ""
    return f"{platform.machine()}{' with FMA' if ' fma ' in flags else ''}, {compiler}, {' '.join(platform.libc_ver())}"


def digests_of(root):
    said = re.search(r"^Digests on these pages: ([^;]+);", (root / "docs/output.md").read_text(encoding="utf-8"), re.M)
    return said[1] if said else None


def same(shown, printed, digests=False):
    """Equal but for numbers, which may differ by 0.6 %; speeds and what is rounding alone are free, and digests where `digests` is false."""
    digest = r"\b[0-9a-f]{16}\b"
    if digests and re.findall(digest, shown) != re.findall(digest, printed):
        return False
    free = [(digest, "DIGEST"), (r"\d+ x real time", "N x real time"), (r"(?<=closure )\S+", "TINY"),
            (r"(?<=energy balance )[^\s,]+", "TINY"), (r"\S+ s of CPU time", "N s of CPU time")]
    for pattern, instead in free:
        shown, printed = re.sub(pattern, instead, shown), re.sub(pattern, instead, printed)
    if NUMBER.sub("#", shown) != NUMBER.sub("#", printed):
        return False
    pairs = zip(map(float, NUMBER.findall(shown)), map(float, NUMBER.findall(printed)))
    return all(abs(a - b) <= max(1e-9, 0.006 * abs(a)) for a, b in pairs)


def console_parts(block):
    """(command, what it prints) of each `$ ` in a console block."""
    for part in re.split(r"^\$ ", block, flags=re.M)[1:]:
        command, _, output = part.partition("\n")
        yield command, output


def plain_lines(text):
    """Without indentation, and without the lines that say nothing."""
    return "\n" + "".join(line.strip() + "\n" for line in text.splitlines() if line.strip())


def quotes(root):
    for page in pages(root):
        for name, block in QUOTE.findall(page.read_text(encoding="utf-8")):
            source = root / name
            text = plain_lines(source.read_text(encoding="utf-8")) if source.is_file() else ""
            for part in re.split(r"^\s*\.\.\.\s*$", block, flags=re.M):  # a line of three dots leaves lines out
                if plain_lines(part) not in text:
                    first = part.strip().split("\n")[0]
                    yield f"{page.relative_to(root)}: this is not what stands in {name}: {first}"


def repeated(root):
    """Numbered equations, blocks of commands and outputs that stand twice."""
    equations, blocks = {}, {}
    for page in pages(root):
        name = page.relative_to(root)
        text = page.read_text(encoding="utf-8")
        displayed = [block for kind, block in FENCE.findall(text) if not kind] + re.findall(r"^    \S.*$", FENCE.sub("", text), re.M)
        for label in sorted(set(re.findall(r"\[(F\d+b?)\]", "\n".join(displayed)))):
            if (first := equations.setdefault(label, name)) != name:
                yield f"{name}: equation [{label}] stands in {first} already"
        for kind, block in FENCE.findall(text):
            parts = [output for _, output in console_parts(block)] if kind == "console" else [block] if kind in ("", "sh") else []
            for part in parts:
                lines = [line for line in part.strip().splitlines() if "x real time" not in line]
                if len(lines) > 1 and (first := blocks.setdefault("\n".join(lines), name)) is not name:
                    yield f"{name}: this block stands in {first} already: {lines[0]}"


def glossary(root):
    """Every name of the product in docs/glossary.md stands in the sources, or is a file of them."""
    page, keys = root / "docs/glossary.md", (root / "docs/scenes.md").read_text(encoding="utf-8")
    sources = "\n".join(f.read_text(encoding="utf-8") for folder in ("firmware", "host_sim") for f in sorted((root / folder).rglob("*"))
                        if f.suffix in (".hpp", ".cpp", ".toml") and "node_modules" not in f.parts)
    for row in re.findall(r"^\|(?: .* )\| (.*) \|$", page.read_text(encoding="utf-8"), re.M) if page.is_file() else ():
        for name in re.findall(r"`([^`<*]+)`", row):
            key, word = name.split(" = ")[0].strip("[]"), name.removeprefix("esmc ").split("::")[-1].strip("-")
            if not (root / name).exists() and f"`{key}" not in keys and not re.search(rf"\b{re.escape(word)}\b", sources) and \
                    not any((root / "firmware").rglob(name)):
                yield f"docs/glossary.md: the product has no {name}"


def scratch_folder(folder, root, esmc, build):
    (folder / "build/host").mkdir(parents=True)
    (folder / PROGRAM).symlink_to(esmc)
    if build:
        (folder / "build/host/tests").symlink_to(build / "tests")
    for name in ("host_sim", "tests"):
        (folder / name).symlink_to(root / name)


def commands(root, esmc, build=None):
    digests = digests_of(root) == machine(esmc)
    for page in pages(root):
        text = page.read_text(encoding="utf-8")
        updated = text
        with tempfile.TemporaryDirectory() as folder:
            scratch_folder(Path(folder), root, esmc, build)
            for kind, block in FENCE.findall(text):
                if kind == "sh":
                    lines = block.replace("\\\n", "").splitlines()
                    todo = [(line, None) for line in lines if line.startswith(PROGRAM)]
                else:
                    todo = console_parts(block) if kind == "console" else ()
                for command, shown in todo:
                    example = re.search(r"build/host/(tests/\w+)", command)
                    if "socketcan" in command or (example and not (build and (build / example[1]).exists())):
                        continue
                    run = subprocess.run(["bash", "-c", command], cwd=folder, capture_output=True, text=True, timeout=120)
                    printed = run.stdout + run.stderr
                    if shown is None and run.returncode != 0:
                        yield f"{page.relative_to(root)}: exit {run.returncode}: {command}\n{printed}"
                    elif shown is not None and not same(shown.strip(), printed.strip(), digests):
                        updated = updated.replace(f"$ {command}\n{shown}", f"$ {command}\n{printed}")
                        yield f"{page.relative_to(root)}: prints something else: {command}\n{printed}"
        if UPDATE and updated != text:
            page.write_text(updated, encoding="utf-8")


def example(root, build):
    """The README's CMake and C++ blocks against an installed copy; its output is the one the README names."""
    text = (root / "README.md").read_text(encoding="utf-8")
    blocks = dict((kind, block) for kind, block in FENCE.findall(text))
    want = re.search(r"It prints `([^`]+)`", text)[1]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "CMakeLists.txt").write_text(blocks["cmake"], encoding="utf-8")
        (place / "main.cpp").write_text(blocks["cpp"], encoding="utf-8")
        for step in (["cmake", "--install", build, "--prefix", place / "prefix"],
                     ["cmake", "-G", "Ninja", "-S", place, "-B", place / "b", f"-DCMAKE_PREFIX_PATH={place / 'prefix'}"],
                     ["cmake", "--build", place / "b"], [place / "b/hold"]):
            run = subprocess.run(list(map(str, step)), capture_output=True, text=True)
            if run.returncode != 0:
                yield f"README.md: the example fails at {' '.join(map(str, step))}\n{run.stdout[-2000:]}{run.stderr[-2000:]}"
                return
        if run.stdout.strip() != want:
            yield f"README.md: the example prints {run.stdout.strip()}"


def self_test():
    fake = """#!/bin/sh
case "$1" in keys) echo '| key |';; digest) echo 'digest 1111111111111111';; *) exit 1;; esac
"""

    def elsewhere(root):
        program = root / "esmc"
        program.write_text(fake + "# clang version 14\n", encoding="utf-8")
        return program

    seeded = [
        (lambda r: list(links(r)), "docs/a.md", "[x](gone.md)", "no such file"),
        (lambda r: list(links(r)), "docs/a.md", "[x](safety.md#nowhere)", "no such heading"),
        (lambda r: list(faults(r)), "docs/safety.md", "# Safety\n| `first` | |\n", "fault second"),
        (lambda r: list(faults(r)), "docs/safety.md", "| `first` | |\n| `second` | (halt) no |\n", "second is not answered"),
        (lambda r: list(faults(r)), "firmware/safety/faults.hpp", "enum class Fault {\n none,\n first,\n second,\n};\nreaction(Fault f) {\n"
         "case Fault::second: return Reaction::halt;", "second is answered"),
        (lambda r: list(option_codes(r)), "docs/safety.md", "605Eh = 0, 605Ah = 0, 6007h = 0", "6007h = 0, cia402_setup.hpp: 1"),
        (lambda r: list(option_codes(r)), "docs/safety.md", "605Eh = 0, 605Ah = 0, 6007h = 1", None),
        (lambda r: list(key_table(r, r / "esmc")), "docs/scenes.md", "<!-- keys -->\n| old |\n<!-- /keys -->", "key table"),
        (lambda r: list(key_table(r, r / "esmc")), "docs/scenes.md", "nothing", "markers"),
        (lambda r: list(commands(r, r / "esmc")), "docs/a.md", f"```sh\n{PROGRAM} sim x\n```\n", "exit 1"),
        (lambda r: list(commands(r, r / "esmc")), "docs/a.md", f"```console\n$ {PROGRAM} keys\n| keys |\n```\n", "something else"),
        (lambda r: list(commands(r, r / "esmc")), "docs/a.md", f"```console\n$ {PROGRAM} keys\n| key |\n```\n", None),
        (lambda r: list(commands(r, r / "esmc")), "docs/a.md", f"```sh\n{PROGRAM} hil --bus socketcan:x\n```\n", None),
        (lambda r: list(quotes(r)), "docs/a.md", "```cpp firmware/safety/faults.hpp\nnone,\n  first,\n```\n", None),
        (lambda r: list(quotes(r)), "docs/a.md", "```cpp firmware/safety/faults.hpp\nnone,\n...\nsecond,\n```\n", None),
        (lambda r: list(quotes(r)), "docs/a.md", "```cpp firmware/safety/faults.hpp\nnone,\nsecond,\n```\n", "not what stands"),
        (lambda r: list(quotes(r)), "docs/a.md", "```cpp gone.hpp\nnone,\n```\n", "not what stands"),
        (lambda r: list(links(r)), "docs/a.md", "[x](safety.md#safety-first) [y](https://example.org)", None),
        (lambda r: list(commands(r, r / "esmc")), "docs/a.md", f"```console\n$ {PROGRAM} digest\ndigest {'1' * 16}\n```\n", None),
        (lambda r: list(commands(r, r / "esmc")), "docs/a.md", f"```console\n$ {PROGRAM} digest\ndigest {'2' * 16}\n```\n", "something else"),
        (lambda r: list(commands(r, elsewhere(r))), "docs/a.md", f"```console\n$ {PROGRAM} digest\ndigest {'2' * 16}\n```\n", None),
        (lambda r: list(repeated(r)), "docs/a.md", "```\na = b  [F1]\n```\n", "[F1] stands in"),
        (lambda r: list(repeated(r)), "docs/a.md", "    a = b  [F1]\n", "[F1] stands in"),
        (lambda r: list(repeated(r)), "docs/a.md", f"```console\n$ {PROGRAM} b\nfirst\nsecond\n```\n", "block stands in"),
        (lambda r: list(glossary(r)), "docs/glossary.md", "| fault | cause | `Fault` |\n| other | none | `Gone` |\n", "no Gone"),
        (lambda r: list(glossary(r)), "docs/glossary.md", "| fault | cause | `Fault`, `firmware/safety/`, `drives.nodes` |\n", None),
        (lambda r: list(repeated(r)), "docs/a.md", f"By [F1] and\n```console\n$ {PROGRAM} a\nfirst\nthird\n```\n", None),
    ]
    failed = 0
    for check, name, text, want in seeded:
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder)
            for sub in ("docs", "firmware/drive", "firmware/safety", "host_sim", "tests"):
                (root / sub).mkdir(parents=True)
            (root / "docs/scenes.md").write_text("| `drives.nodes` |\n", encoding="utf-8")
            (root / "docs/safety.md").write_text("# Safety first\n| `first` | |\n| `second` | |\n", encoding="utf-8")
            (root / "firmware/safety/faults.hpp").write_text("enum class Fault {\n none,\n first,\n second,\n};", encoding="utf-8")
            (root / "firmware/drive/cia402_setup.hpp").write_text("abort_connection = 1, fault_reaction = 0, quick_stop = 0;", encoding="utf-8")
            (root / "esmc").write_text(fake, encoding="utf-8")
            (root / "esmc").chmod(0o755)
            (root / "docs/output.md").write_text(f"Digests on these pages: {machine(root / 'esmc')}; elsewhere they may differ.\n",
                                                 encoding="utf-8")
            (root / "docs/model.md").write_text(f"    a = c  [F1]\n\n```console\n$ {PROGRAM} a\nfirst\nsecond\n```\n", encoding="utf-8")
            (root / name).write_text(text, encoding="utf-8")
            found = [f for f in check(root) if "docs/model.md: prints" not in f]
            if (want is None) != (not found) or (want and not any(want in f for f in found)):
                failed += 1
                print(f"docs_test.py: should find {want or 'nothing'} in {text!r}, found {found}")
    if same("0.5 m, 3 faults", "0.52 m, 3 faults") or not same("0.500 m", "0.501 m") or same("a 1", "b 1"):
        failed += 1
        print("docs_test.py: numbers are not compared as promised")
    print(f"{len(seeded) + 1 - failed} of {len(seeded) + 1} seeded cases judged rightly")
    return failed


def main():
    arguments = [a for a in sys.argv[1:] if a != "--update"]
    if arguments == ["--self-test"]:
        return 1 if self_test() else 0
    if len(arguments) not in (1, 2) or not os.access(arguments[0], os.X_OK):
        print(__doc__, file=sys.stderr)
        return 2
    esmc = Path(shutil.which(arguments[0]) or arguments[0]).resolve()
    found = list(key_table(ROOT, esmc))
    if UPDATE:
        print(*commands(ROOT, esmc), sep="\n")
        return 1 if found else 0
    build = Path(arguments[1]).resolve() if len(arguments) == 2 else None
    found += [*links(ROOT), *faults(ROOT), *option_codes(ROOT), *quotes(ROOT), *repeated(ROOT), *glossary(ROOT), *output_files(ROOT, esmc), *commands(ROOT, esmc, build)]
    if build:
        found += example(ROOT, build)
    for problem in found:
        print(problem.rstrip())
    if digests_of(ROOT) != machine(esmc):
        print(f"digests are not compared: here {machine(esmc)}, on the pages {digests_of(ROOT)}")
    print(f"{len(pages(ROOT))} pages, {len(found)} problems")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
