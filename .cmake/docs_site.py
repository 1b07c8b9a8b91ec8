"""Hooks of the site. A link out of docs/ leads to the repository, which is not part of the site: its text stays, with the path. An
equation that a sentence names, like [F29], becomes a link to the page that has it. Notebooks become pages, with results where
ESMC_NOTEBOOKS is the folder that .cmake/notebooks.py has written."""
import importlib.util
import os
import pathlib
import re
import tempfile

from mkdocs.structure.files import File

OUTSIDE = re.compile(r"\[([^\]]+)\]\(\.\./([^)\s#]+)[^)]*\)")
CODE = re.compile(r"(^```.*?^```$|^    [^\n]*$|`[^`\n]+`)", re.M | re.S)
EQUATION = re.compile(r"(?<![\\\[])\[(F(?:[1-9]|[1-3]\d)b?)\](?![(\]])")


def on_files(files, config):
    folder = os.environ.get("ESMC_NOTEBOOKS")
    if not folder:
        spec = importlib.util.spec_from_file_location("notebooks", pathlib.Path(__file__).with_name("notebooks.py"))
        notebooks = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(notebooks)
        folder = tempfile.mkdtemp()
        notebooks.write(pathlib.Path(folder), run=False)
    for file in sorted(pathlib.Path(folder, "notebooks").iterdir()):
        files.append(File(f"notebooks/{file.name}", folder, config["site_dir"], config["use_directory_urls"]))
    return files


def on_page_markdown(markdown, page, **_):
    text = OUTSIDE.sub(lambda m: m[1] if m[2] in m[1] else f"{m[1]} (`{m[2]}`)", markdown)
    if page.file.src_uri == "model.md":
        return text
    parts = CODE.split(text)
    parts[::2] = [EQUATION.sub(r"[\\[\1\\]](model.md#\1)", part) for part in parts[::2]]
    return "".join(parts)
