"""What pages are made with: their parts between <!-- NAME --> and <!-- /NAME -->, and runs of the program."""
import csv
import json
import subprocess
import tempfile
from pathlib import Path


def cut(text, name):
    """What is before, in and after a part; the marks belong to the others."""
    begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    if text.count(begin) != 1 or text.count(end) != 1:
        raise SystemExit(f"the markers of '{name}' are not there, once each")
    head, rest = text.split(begin)
    body, tail = rest.split(end)
    return head + begin, body, end + tail


def put(file, parts):
    """Writes parts of a page: {name: text}."""
    text = file.read_text(encoding="utf-8")
    for name, body in parts.items():
        head, _, tail = cut(text, name)
        text = head + body + tail
    file.write_text(text, encoding="utf-8")


def part(file, name):
    return cut(file.read_text(encoding="utf-8"), name)[1]


def run(esmc, command, scene, *sets, log=False, more=()):
    """Summary of a run; with log also its rows as numbers, without their state. A fault is an answer, a refusal is the end."""
    with tempfile.TemporaryDirectory() as folder:
        words = [esmc, command, scene, "--json", *(w for s in sets for w in ("--set", s)), *more, *(["--out", folder] if log else [])]
        done = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1) or not done.stdout:
            raise SystemExit(f"{' '.join(map(str, words))}\n{done.stderr}")
        summary = json.loads(done.stdout)
        if not log:
            return summary
        with open(Path(folder, "log.csv"), newline="", encoding="utf-8") as rows:
            return summary, [{k: float(v) for k, v in row.items() if k != "state"} for row in csv.DictReader(rows)]
