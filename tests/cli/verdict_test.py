#!/usr/bin/env python3
"""Verdicts before and after a run: what `esmc check` says of a scene against what the scene does in `esmc sim`, and the words of a run.
usage: verdict_test.py ESMC SCENES_DIR [unittest args]"""
import json
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

ESMC = SCENES = ""
DOCS = Path(__file__).parents[2] / "docs"


def esmc(*args):
    return subprocess.run([ESMC, *map(str, args)], capture_output=True, text=True, timeout=120)


def sets(*values):
    return [a for v in values for a in ("--set", v)]


class Verdicts(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.tmp = Path(self.folder.name)
        self.circle = Path(SCENES, "five_bar_circle.toml")

    def tearDown(self):
        self.folder.cleanup()

    def check(self, scene, *values):
        run = esmc("check", scene, "--json", *sets(*values))
        self.assertEqual(run.stderr, "")
        j = json.loads(run.stdout)
        levels = {f["level"] for f in j["findings"]}
        self.assertEqual(j["verdict"], "unfit" if "error" in levels else "warnings" if "warning" in levels else "fit")
        self.assertEqual(run.returncode, 1 if j["verdict"] == "unfit" else 0)
        self.assertEqual(j["runs"], run.returncode == 0)
        return j

    def found(self, scene, *values):
        return {(f["level"], f["code"], f["where"]) for f in self.check(scene, *values)["findings"]}

    def test_every_finding_has_a_code_that_the_documents_list(self):
        listed = set(re.findall(r"`(\w+)`", " ".join(line.split("|")[1] for line in re.findall(
            r"^\| `.*", (DOCS / "output.md").read_text().split("| code | says |")[1], re.M))))
        for values, one in (([], None), (["bus.bitrate=700000"], ("warning", "bus_load", "bus.bitrate")),
                            (["limits.joint_speed=3"], ("error", "limit_crossed", "limits.joint_speed")),
                            (["control.torque_limit=0.1"], ("error", "torque_exceeded", "control.torque_limit")),
                            (["drives.nodes=[0, 1]"], ("warning", "node_zero", "drives.nodes")),
                            (["control.law=none", 'effects=[{type="jitter", sigma=1e-4}]'], ("warning", "effect_idle", "effects"))):
            found = self.found(self.circle, *values)
            self.assertTrue(found == set() if one is None else one in found, (values, found))
            self.assertLessEqual({code for _, code, _ in found}, listed)


if __name__ == "__main__":
    ESMC, SCENES = sys.argv[1], sys.argv[2]
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]])
