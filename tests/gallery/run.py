"""Runs of the program for the gallery."""
import json
import math
import subprocess
from pathlib import Path

import page

ROOT = Path(__file__).resolve().parents[2]
WHEEL = ROOT / "tests/gallery/wheel.toml"
SCENES = ROOT / "host_sim/scenes"


class Program:
    def __init__(self, esmc):
        self.esmc = str(Path(esmc).resolve())

    def eval(self, file):
        done = subprocess.run([self.esmc, "eval", file], capture_output=True, text=True, check=True)
        return json.loads(done.stdout)

    def beside(self, name):
        """What a program of the same build prints."""
        return subprocess.run([Path(self.esmc).parent / name], capture_output=True, text=True, check=True).stdout

    def summary(self, scene, *sets, log=False):
        return page.run(self.esmc, "sim", scene, *sets, log=log)

    def refusal(self, scene, *sets):
        """The line of a run that is refused (exit 1); empty where it is not."""
        command = [self.esmc, "sim", str(scene)] + [word for s in sets for word in ("--set", s)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        return done.stderr if done.returncode == 1 else ""

    def rows(self, scene, *sets):
        return self.summary(scene, *sets, log=True)[1]


def column(rows, name, start=0.0, end=1e9):
    return [(r["t"], r[name]) for r in rows if start <= r["t"] <= end]


def worst(points, truth):
    """Largest distance of (t, value) from the function truth."""
    return max(abs(v - truth(t)) for t, v in points)


def digits(points):
    """Logarithms, for a picture of errors."""
    return [(t, math.log10(max(v, 1e-17))) for t, v in points]
