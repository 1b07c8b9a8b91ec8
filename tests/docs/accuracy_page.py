#!/usr/bin/python3
"""Writes the tables and figures of docs/accuracy.md from a run of `esmc accuracy`. usage: accuracy_page.py ESMC"""
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import page

DOCS = Path(__file__).resolve().parents[2] / "docs"


def main():
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.argv[1], "accuracy", "--out", folder], check=True, stdout=subprocess.DEVNULL)
        tables = (Path(folder) / "accuracy.md").read_text(encoding="utf-8")
        effects = tables.index("### Effects")  # docs/effects.md has them, with instructions
        page.put(DOCS / "accuracy.md", {"study": tables[:effects]})
        for name in ("work_5r_free", "work_b1_andrews"):
            shutil.copy(Path(folder) / f"{name}.svg", DOCS / "images" / f"{name}.svg")


if __name__ == "__main__":
    main()
