"""What the tests of the commands that read logs share: runs that leave one, and what a refusal looks like."""
import json
import subprocess
from pathlib import Path

failures = []


def expect(truth, what):
    if not truth:
        failures.append(what)


class LogBench:
    def __init__(self, command, esmc, scenes, folder):
        self.command, self.esmc, self.scenes, self.folder = command, esmc, scenes, Path(folder)

    def run(self, *arguments):
        return subprocess.run([self.esmc, *map(str, arguments)], capture_output=True, text=True)

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

    def bad(self, what, *arguments):
        run = self.run(self.command, *arguments)
        expect(run.returncode == 2 and not run.stdout and run.stderr.startswith("esmc: ") and run.stderr.count("\n") == 1 and
               what in run.stderr, f"{what!r}: {arguments}: exit {run.returncode}: {run.stderr}")
