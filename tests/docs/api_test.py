#!/usr/bin/python3
"""The reference that Doxygen makes: no warnings, and its links lead somewhere. Python's standard library only.

usage: api_test.py DOXYGEN DOXYFILE
       api_test.py --self-test DOXYGEN DOXYFILE     seeds errors into copies of the input and expects them to be found

Checked: Doxygen has no complaints; every class, enumeration and concept has a comment; every equation and section that a comment of firmware/ or hal/ names is in docs/model.md, and
the pages link there; every name in the table of docs/api.md is a link."""
import re
import subprocess
import sys
import tempfile
from html.parser import HTMLParser
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# A member whose name and type say everything has no comment.
MEMBER = re.compile(r"Member .*\((variable|function|typedef|friend)\) of .* is not documented\.$")


class Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.links, self.anchors, self._href = [], set(), None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        a = dict(attributes)
        self.anchors |= {a[k] for k in ("id", "name") if a.get(k)}
        if tag == "a":
            self._href = a.get("href")

    def handle_data(self, data):
        if self._href:
            self.links.append((data, self._href))

    def handle_endtag(self, tag):
        if tag == "a":
            self._href = None


def named(root):
    """Equations and sections that the headers name."""
    for file in sorted([*(root / "firmware").rglob("*.hpp"), *(root / "hal").rglob("*.hpp")]):
        text = file.read_text(encoding="utf-8")
        for what in re.findall(r"\[(F\d+b?)\]", text):
            yield file.name, what
        for number in re.findall(r"model\.md section (\d+)", text):
            yield file.name, f"section_{number}"


def judge(doxygen, doxyfile, root):
    with tempfile.TemporaryDirectory() as folder:
        text = Path(doxyfile).read_text(encoding="utf-8").replace(str(ROOT) + "/firmware", f"{root}/firmware")
        text = text.replace(str(ROOT) + "/hal", f"{root}/hal").replace(str(ROOT) + "/docs", f"{root}/docs")
        text = re.sub(r'(?m)^(INPUT\b.*?=).*$', rf'\1 "{root}/firmware" "{root}/hal" "{root}/docs/api.md" "{root}/docs/model.md"', text)
        text += f"\nOUTPUT_DIRECTORY = {folder}\nWARN_IF_UNDOCUMENTED = YES\n"
        run = subprocess.run([doxygen, "-"], input=text, capture_output=True, text=True, cwd=root)
        for line in (run.stdout + run.stderr).splitlines():
            if line.strip() and not MEMBER.search(line):
                yield line.strip()
        pages = {p.name: Page(p.read_text(encoding="utf-8")) for p in Path(folder, "api").glob("*.html")}
    if len(pages) < 100:
        yield f"there are {len(pages)} pages"
        return
    for name, page in pages.items():
        for text, href in page.links:
            file, _, anchor = href.partition("#")
            if re.match(r"F\d|section_", anchor) and anchor not in pages[file or name].anchors:
                yield f"{name}: link to {href}, where there is no such place"
    model = next((p for p in pages.values() if {"F1", "F39"} <= p.anchors), None)
    if model is None:
        yield "docs/model.md is no page with anchors of equations"
        return
    linked = {href.partition("#")[2] for p in pages.values() for _, href in p.links}
    for file, what in sorted(set(named(root))):
        if what not in model.anchors:
            yield f"{file}: {what} is not in docs/model.md"
    if not {"F29", "F33", "F18", "section_9"} <= linked:
        yield "comments do not link to their equations"
    linked_names = {text for text, _ in pages["index.html"].links}
    for name in re.findall(r"`(esmc::[\w:]+)`", (root / "docs/api.md").read_text(encoding="utf-8").partition("Where to begin")[2]):
        if name not in linked_names:
            yield f"docs/api.md: {name} is no link: there is no such thing, or it has no comment"


def self_test(doxygen, doxyfile):
    seeds = [("firmware/control/law.hpp", "/// Sets v' = C u + c", "/// \\nonsense Sets v' = C u + c", "nonsense"),
             ("firmware/control/law.hpp", "[F27]", "[F99]", "F99"),
             ("firmware/control/law.hpp", "/// Laws, see docs/theory.md.", "", "LawKind"),
             ("docs/api.md", "`esmc::Cycle`", "`esmc::Cyclone`", "Cyclone"),
             ("docs/model.md", '<a name="F23"></a>', "", "F23")]
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        subprocess.run(["cp", "-r", *(str(ROOT / n) for n in ("firmware", "hal", "docs")), folder], check=True)
        for file, old, new, _ in seeds:
            text = (root / file).read_text(encoding="utf-8")
            if old not in text:
                raise SystemExit(f"api_test.py: {file} has no {old} to be spoilt")
            (root / file).write_text(text.replace(old, new, 1), encoding="utf-8")
        found = list(judge(doxygen, doxyfile, root))
    failed = 0
    for file, _, _, want in seeds:
        if not any(want in f for f in found):
            failed += 1
            print(f"api_test.py: should find {want} in {file}, found {found[:5]}")
    print(f"{len(seeds) - failed} of {len(seeds)} seeded errors found")
    return failed


def main():
    arguments = sys.argv[1:]
    if len(arguments) == 3 and arguments[0] == "--self-test":
        return 1 if self_test(*arguments[1:]) else 0
    if len(arguments) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    found = list(judge(*arguments, ROOT))
    for problem in found:
        print(problem)
    print(f"{len(found)} problems")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
