#!/usr/bin/python3
"""Writes the tables and figures of docs/accuracy.md from a run of `esmc accuracy`. usage: accuracy_page.py ESMC"""
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
BEGIN, END = "<!-- study -->\n", "<!-- /study -->"


def main():
    page = DOCS / "accuracy.md"
    before, rest = page.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.argv[1], "accuracy", "--out", folder], check=True, stdout=subprocess.DEVNULL)
        tables = (Path(folder) / "accuracy.md").read_text(encoding="utf-8")
        effects = tables.index("### Effects")  # docs/effects.md has them, with instructions
        page.write_text(before + BEGIN + tables[:effects] + END + after, encoding="utf-8")
        for name in ("work_5r_free", "work_b1_andrews"):
            shutil.copy(Path(folder) / f"{name}.svg", DOCS / "images" / f"{name}.svg")


if __name__ == "__main__":
    main()
