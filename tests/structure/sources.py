"""The C++ files of the repository, and their code without comments and literals."""

import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[2]
PRODUCT = ("firmware", "hal", "boards", "host_sim")
SUFFIXES = (".cpp", ".hpp", ".h")

LITERAL = re.compile(r'(?<![A-Za-z0-9_])(?:u8|[uUL])?R"([^()\\\s]{0,16})\((?:.*?)\)\1"|//[^\n]*|/\*.*?\*/'
                     r'|"(?:\\.|[^"\\\n])*"|(?<![0-9a-fA-F])\'(?:\\.|[^\'\\\n])+\'', re.S)


def code_of(text):
    """The text with comments and literals blanked, line for line."""
    return LITERAL.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)


def cpp_files(root, *folders):
    """C++ files that git tracks; without git (an archive of the sources) all but those of builds and packages."""
    git = subprocess.run(["git", "ls-files", "--", *folders], cwd=root, capture_output=True, text=True, check=False)
    if git.returncode == 0:
        names = git.stdout.splitlines()
    else:
        names = [f.relative_to(root).as_posix() for folder in folders or ["."] for f in (root / folder).rglob("*")]
        names = [n for n in names if not re.match(r"build/|.*node_modules/", n)]
    return sorted(n for n in names if n.endswith(SUFFIXES) and (root / n).is_file())
