"""What the tests of the commands that read logs share: runs that leave one, their tables, and what a refusal looks like."""
import csv
import json
import sys
import tempfile
from pathlib import Path

from command import esmc, sets

failures = []


def expect(truth, what):
    if not truth:
        failures.append(what)


class LogBench:
    def __init__(self, command, folder):
        self.command, self.folder, self.run = command, Path(folder), esmc

    def record(self, name, simulator, scene, *more):
        """(directory, its summary) of a run of `sim` or `hil`."""
        out = self.folder / name
        run = self.run(simulator, scene, "--json", "--out", out, *more)
        expect(run.returncode == 0, f"{name}: exit {run.returncode}: {run.stderr}")
        return out, json.loads(run.stdout) if run.returncode == 0 else None

    def good(self, *arguments):
        run = self.run(self.command, *arguments, "--json")
        expect(run.returncode == 0 and not run.stderr, f"{self.command} {arguments}: exit {run.returncode}: {run.stderr}")
        return json.loads(run.stdout) if run.returncode == 0 else None

    def refused(self, run, *words):
        expect(run.returncode == 2 and not run.stdout and run.stderr.startswith("esmc: ") and run.stderr.count("\n") == 1 and
               all(word in run.stderr for word in words), f"{words}: {run.args[1:]}: exit {run.returncode}: {run.stderr}")

    def bad(self, what, *arguments):
        self.refused(self.run(self.command, *arguments), what)

    def settled(self, scene, *values):
        """Root mean square error of a run, m."""
        run = self.run("sim", scene, "--json", *sets(*values))
        expect(run.returncode == 0, f"sim {values}: {run.stderr}")
        return json.loads(run.stdout)["tracking"]["settled_rms_m"] if run.returncode == 0 else float("nan")


def write_table(path, rows):
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def main(bench_of, *checks):
    """Runs them all before it ends with what has failed."""
    with tempfile.TemporaryDirectory() as folder:
        bench = bench_of(folder)
        for check in checks:
            check(bench)
    for what in failures:
        print("FAILED:", what)
    sys.exit(1 if failures else 0)
