#!/usr/bin/python3
"""Executes the notebooks of docs/notebooks and writes each as a page with its results, for tests and for the site.

usage: notebooks.py MODULE_FOLDER OUT [NAME ...]     OUT/notebooks/NAME.md and its pictures; 1 where a cell fails"""
import contextlib
import io
import json
import os
import pathlib
import sys
import time
import traceback

FOLDER = pathlib.Path(__file__).resolve().parents[1] / "docs/notebooks"


def figures(place):
    """Names of the pictures that a cell has drawn, now files beside the page."""
    if "matplotlib.pyplot" not in sys.modules:
        return
    plot = sys.modules["matplotlib.pyplot"]
    for number in plot.get_fignums():
        figure = plot.figure(number)
        file = place.with_name(f"{place.stem}_{len(list(place.parent.glob(place.stem + '_*.svg')))}.svg")
        figure.set_size_inches(7, 4)
        figure.savefig(file, bbox_inches="tight")
        plot.close(figure)
        yield file.name


def page(notebook, place=None):
    """The text of its page; `place`: the file that it becomes, which makes the cells run."""
    names = {"__name__": "__main__"}
    for number, cell in enumerate(json.loads(notebook.read_text(encoding="utf-8"))["cells"]):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            yield f"{source}\n"
            continue
        yield f"```python\n{source}\n```\n"
        if place is None:
            continue
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(compile(source, f"{notebook.name}, cell {number}", "exec"), names)
        if said.getvalue().strip():
            yield f"```text\n{said.getvalue().rstrip()}\n```\n"
        yield from (f"![result of the cell above]({name})\n" for name in figures(place))
    yield f"[The notebook]({notebook.name})\n"


def write(out, names=(), run=True):
    """Whether all of them could be written."""
    fine = True
    (out / "notebooks").mkdir(parents=True, exist_ok=True)
    for notebook in sorted(FOLDER.glob("*.ipynb")):
        if names and notebook.stem not in names:
            continue
        place = out / "notebooks" / f"{notebook.stem}.md"
        for old in place.parent.glob(place.stem + "_*.svg"):
            old.unlink()
        begin = time.monotonic()
        try:
            place.write_text("\n".join(page(notebook, place if run else None)), encoding="utf-8")
        except Exception:  # pylint: disable=broad-except
            fine = False
            print(f"{notebook.name}: failed\n{traceback.format_exc()}")
        if run:
            print(f"{notebook.name}: {time.monotonic() - begin:.1f} s")
    return fine


if __name__ == "__main__":
    os.environ["MPLBACKEND"] = "agg"
    sys.path.insert(0, str(pathlib.Path(sys.argv[1]).resolve()))
    target = pathlib.Path(sys.argv[2]).resolve()
    os.chdir(FOLDER)
    sys.exit(0 if write(target, sys.argv[3:]) else 1)
