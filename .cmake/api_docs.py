#!/usr/bin/python3
"""Doxygen's input filter: api_docs.py FILE prints FILE as Doxygen is to read it.

Headers: the comment after `#pragma once` is about the file; [F29] and "model.md section 9" become links into docs/model.md.
Pages: the anchors of equations and sections become Doxygen's, and links to pages that are not part of the reference become text."""
import re
import sys
from pathlib import Path

EQUATION = re.compile(r"\[(F\d+b?)\]")
SECTION = re.compile(r"(?:docs/)?model\.md section (\d+)")


def header(text):
    text = re.sub(r"^#pragma once\n///", "#pragma once\n/// \\\\file\n///", text)
    lines = []
    for line in text.split("\n"):
        code, mark, comment = line.partition("///")
        if mark:
            comment = EQUATION.sub(r'\\ref \1 "[\1]"', comment)
            comment = SECTION.sub(r'\\ref section_\1 "model.md section \1"', comment)
        lines.append(code + mark + comment)
    return "\n".join(lines)


def page(text):
    text = re.sub(r'<a name="(F\d+b?)"></a>', r"\\anchor \1 ", text)
    text = re.sub(r"^(## (\d+)\. .*)$", r"\1 {#section_\2}", text, flags=re.M)
    return re.sub(r"\[([^\]\n]+)\]\((?!https?:)[^)\n]+\)", r"\1", text)


def main():
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    file = Path(sys.argv[1])
    text = file.read_text(encoding="utf-8")
    sys.stdout.write(page(text) if file.suffix == ".md" else header(text))
    return 0


if __name__ == "__main__":
    sys.exit(main())
