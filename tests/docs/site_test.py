#!/usr/bin/env python3
"""The documents as a site (.cmake/docs_site.yml): it builds without a warning, every page of docs/ is in it, every link and anchor of
it leads somewhere, nothing comes from the network, search has an index, and users' pages are few.

usage: site_test.py MKDOCS BUILD_FOLDER | --self-test MKDOCS"""
import html.parser
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import urllib.parse

ROOT = pathlib.Path(__file__).resolve().parents[2]
USER_PAGES_MAX = 26


class Page(html.parser.HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.links, self.anchors, self.loads = set(), set(), set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        a = dict(attrs)
        self.anchors.update(v for k in ("id", "name") if (v := a.get(k)))
        if tag == "a" and a.get("href"):
            self.links.add(a["href"])
        if tag in ("script", "img") and a.get("src"):
            self.loads.add(a["src"])
        if tag == "link" and a.get("rel") in ("stylesheet", "icon") and a.get("href"):
            self.loads.add(a["href"])


def problems(mkdocs, root, site):
    run = subprocess.run([mkdocs, "build", "--strict", "--clean", "--config-file", root / ".cmake/docs_site.yml", "--site-dir", site],
                         capture_output=True, text=True, check=False)
    if run.returncode != 0:
        yield "mkdocs: " + next((x for x in run.stderr.splitlines() if "WARNING" in x or "ERROR" in x), run.stderr[-300:])
        return
    for line in run.stderr.splitlines():
        if "not included in the" in line or line.startswith("  - "):
            yield "in no section: " + line.strip()
    pages = {f.name: Page(f.read_text(encoding="utf-8")) for f in site.glob("*.html") if f.name != "404.html"}
    users = sum(1 for line in (root / ".cmake/docs_site.yml").read_text().split("- Contributors:")[0].splitlines() if line.endswith(".md") and "notebooks/" not in line)
    if users - 1 > USER_PAGES_MAX:  # but home
        yield f"{users - 1} pages for users, at most {USER_PAGES_MAX}"
    for name, page in sorted(pages.items()):
        for link in sorted(page.links | page.loads):
            url = urllib.parse.urlsplit(link)
            if url.scheme or url.netloc:
                if link in page.loads:
                    yield f"{name}: loads {link} from the network"
                continue
            target = urllib.parse.unquote(url.path) or name
            if target in (".", "./"):
                target = "index.html"
            if not (site / target).exists():
                yield f"{name}: {link} leads nowhere"
            elif url.fragment and target in pages and urllib.parse.unquote(url.fragment) not in pages[target].anchors:
                yield f"{name}: {link} has no such anchor"
    if len(json.loads((site / "search/search_index.json").read_text(encoding="utf-8"))["docs"]) < 100:
        yield "the index of the search is nearly empty"


def self_test(mkdocs):
    failed = 0
    builds = (("docs/get-started.md", "\n[away](no-such-page.md)\n", "no-such-page"),), (
        ("docs/get-started.md", "\n[away](safety.md#no-such-anchor)\n", "no-such-anchor has no such anchor"), ("docs/orphan.md", "# Orphan\n", "orphan.md"),
        ("docs/get-started.md", "\n![p](https://example.org/p.png)\n", "example.org/p.png from the network"))
    for seeded in builds:  # the first one ends the build
        with tempfile.TemporaryDirectory() as d:
            copy = pathlib.Path(d) / "esmc"
            shutil.copytree(ROOT / "docs", copy / "docs")
            shutil.copytree(ROOT / ".cmake", copy / ".cmake")
            for name, text, _ in seeded:
                with (copy / name).open("a", encoding="utf-8") as f:
                    f.write(text)
            found = list(problems(mkdocs, copy, pathlib.Path(d) / "site"))
        for _, text, words in seeded:
            if not any(words in f for f in found):
                print(f"site_test.py: does not notice {text.strip()}: {found}")
                failed += 1
    print(f"{failed} seeded problems not found")
    return failed


def main():
    if sys.argv[1] == "--self-test":
        return 1 if self_test(sys.argv[2]) else 0
    found = list(problems(sys.argv[1], ROOT, pathlib.Path(sys.argv[2]) / "site"))
    print("\n".join(found[:40]))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
