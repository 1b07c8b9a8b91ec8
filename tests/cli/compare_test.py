#!/usr/bin/env python3
"""`esmc compare`, against the files of the runs themselves. usage: compare_test.py ESMC [unittest args]"""
import json
import shutil
import tempfile
import unittest
from pathlib import Path

from command import CIRCLE, FRICTION, esmc, main, read_table, sets


class Compare(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.tmp = Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        for name, *values in (("a",), ("same",), ("b", "control.lambda=41", "effects=[]"), ("short", "simulation.duration=0.4"), ("four", "control.motors=all")):
            assert esmc("sim", FRICTION, "--out", cls.tmp / name, *sets("simulation.duration=0.5", *values)).returncode == 0, name

    def compare(self, a, b, *args, code=0):
        run = esmc("compare", self.tmp / a, self.tmp / b, "--json", *args)
        self.assertEqual((run.returncode, run.stderr), (code, ""))
        return json.loads(run.stdout)

    def rows(self, name):
        return read_table(self.tmp / name / "log.csv")

    def test_a_run_is_like_itself(self):
        j = self.compare("a", "same")
        self.assertEqual((j["within"], j["scene"], j["log"]["first_difference"], j["log"]["largest_difference"]), (True, [], None, None))
        self.assertEqual(esmc("compare", self.tmp / "a", self.tmp / "same").stdout, "within 0\n")
        for name in ("accurate", "as_accurate"):
            self.assertEqual(esmc("sim", CIRCLE, "--out", self.tmp / name, *sets("simulation.duration=0.2", "simulation.accuracy=1e-4")).returncode, 0)
        self.assertTrue(self.compare("accurate", "as_accurate")["within"])

    def test_differences_are_those_of_the_files(self):
        j = self.compare("a", "b", code=1)
        self.assertEqual({(d["key"], d["b"]) for d in j["scene"]} & {("control.lambda", "41"), ("effects", "[]")}, {("control.lambda", "41"), ("effects", "[]")})
        self.assertIn(("effects.1.type", None), {(d["key"], d["b"]) for d in j["scene"]})
        summaries = [json.loads((self.tmp / n / "summary.json").read_text()) for n in "ab"]
        metric = {m["key"]: (m["a"], m["b"]) for m in j["metrics"]}
        self.assertEqual(metric["tracking.rms_m"], tuple(s["tracking"]["rms_m"] for s in summaries))
        self.assertNotIn("wall_s", metric)
        one, two = self.rows("a"), self.rows("b")
        row, column = next((i, c) for i, (x, y) in enumerate(zip(one, two)) for c in x if x[c] != y[c] and "nan" not in (x[c], y[c]))
        first = j["log"]["first_difference"]
        self.assertEqual((first["row"], first["column"], first["a"], first["b"]), (row + 1, column, float(one[row][column]), float(two[row][column])))
        worst = max(abs(float(x[c]) - float(y[c])) for x, y in zip(one, two) for c in x if c != "state" and "nan" not in (x[c], y[c]))
        largest = j["log"]["largest_difference"]
        self.assertEqual(abs(largest["a"] - largest["b"]), worst)
        self.compare("a", "b", "--tolerance", 1.001 * worst)
        self.assertLess(float(one[row]["t"]), 0.1)

    def test_files_that_scenes_name_differ_by_their_contents(self):
        for name, x in (("left", -0.03), ("right", 0.03)):
            (self.tmp / "path.csv").write_text(f"t,x,y\n0,0,0.18\n0.5,{x},0.2\n1,0,0.22\n", encoding="utf-8")
            self.assertEqual(esmc("sim", CIRCLE, "--out", self.tmp / name, *sets("simulation.duration=0.1", 'reference={type="file", path="' + str(self.tmp / "path.csv") + '", join=0.3}')).returncode, 0)
        self.assertEqual([d["key"] for d in self.compare("left", "right", code=1)["scene"]], ["reference.path"])

    def test_logs_of_other_ticks_are_not_compared(self):
        self.assertEqual(esmc("sim", FRICTION, "--out", self.tmp / "thinned", "--log-every", "3", *sets("simulation.duration=0.5")).returncode, 0)
        run = esmc("compare", self.tmp / "a", self.tmp / "thinned")
        self.assertEqual(run.returncode, 2)
        self.assertIn("--log-every", run.stderr)

    def test_rows_and_columns_that_one_has_not(self):
        j = self.compare("a", "short", "--tolerance", "1e9", code=1)
        self.assertEqual((j["log"]["rows_a"], j["log"]["rows_b"]), (len(self.rows("a")), len(self.rows("short"))))
        j = self.compare("a", "four", "--tolerance", "1e9", code=1)
        self.assertEqual((j["log"]["only_in_a"], j["log"]["only_in_b"]), ([], ["tau12", "tau22", "tau12_cmd", "tau22_cmd"]))

    def test_how_a_run_ended_counts(self):
        for name, code, more in (("whole", 0, ()), ("faulty", 1, ("limits.joint_speed=0.5",))):  # of one row: the log cannot tell
            run = esmc("sim", CIRCLE, "--out", self.tmp / name, "--log-every", 1000, *sets("simulation.duration=0.2", *more))
            self.assertEqual(run.returncode, code, run.stderr)
        j = self.compare("whole", "faulty", "--tolerance", "1e9", code=1)
        self.assertEqual(j["faults"], {"a": [], "b": ["joint_speed"]})
        self.assertIn('faults: [] and ["joint_speed"]\n', esmc("compare", self.tmp / "whole", self.tmp / "faulty").stdout)
        shutil.copytree(self.tmp / "whole", self.tmp / "silent")
        summary = json.loads((self.tmp / "whole/summary.json").read_text())
        summary["torque"]["max_nm"] = None
        (self.tmp / "silent/summary.json").write_text(json.dumps(summary))
        self.assertFalse(self.compare("whole", "silent", "--tolerance", "1e9", code=1)["within"])

    def test_page(self):
        self.compare("a", "b", "--out", self.tmp / "page", code=1)
        self.assertEqual({p.name for p in (self.tmp / "page").iterdir()}, {"comparison.json", "report.html"})
        page = (self.tmp / "page/report.html").read_text()
        for text in ("control.lambda", "tracking.rms_m", "Effector error"):
            self.assertIn(text, page)

    def test_what_is_no_run(self):
        for a, b, words in ((self.tmp, self.tmp / "a", "no such scene file"), (self.tmp / "a", self.tmp / "nowhere", "no such scene file")):
            run = esmc("compare", a, b)
            self.assertEqual((run.returncode, run.stdout), (2, ""))
            self.assertIn(words, run.stderr)
        self.assertEqual(esmc("compare", self.tmp / "a", self.tmp / "b", "--tolerance", "-1").returncode, 2)
        shutil.copytree(self.tmp / "a", self.tmp / "deep")
        (self.tmp / "deep/summary.json").write_text('{"torque":{},"ticks":1,"a":' + 20000 * '{"a":' + "1" + 20001 * "}")
        for command in (("compare", self.tmp / "deep", self.tmp / "a"), ("replay", self.tmp / "deep")):
            run = esmc(*command)
            self.assertEqual((run.returncode, run.stdout), (2, ""), run.stderr)


if __name__ == "__main__":
    main()
