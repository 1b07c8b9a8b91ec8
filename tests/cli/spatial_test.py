#!/usr/bin/python3
"""`esmc spatial` from outside: bad scenes, digests that must or must not change, faults, files. usage: spatial_test.py ESMC"""
import json
import math
import signal
import subprocess
import time

from command import ARM, ESMC, SCENES, Case, esmc, main, read_table, sets

BODY, PLATFORM = (SCENES / "spatial" / f"{n}.toml" for n in ("free_body", "hexapod"))


def run(*arguments):
    return esmc("spatial", *arguments)


class Spatial(Case):
    def summary(self, scene, *values, more=(), code=0):
        return self.document("spatial", scene, *sets(*values), *more, code=code)

    def bad(self, *arguments, words):
        out = self.tmp / "out"
        self.refused(run(*arguments, "--out", out), *words)
        self.assertFalse(out.exists())

    def test_bad_scenes_are_named_by_file_line_and_key(self):
        cases = [
            (BODY, "mass = 4.0", "mass = 0.0", ["body.mass", "> 0"]),
            (BODY, "inertia = [0.05, 0.09, 0.12]", "inertia = [0.05, 0.09, 0.15]", ["body.inertia", "sum of the other two"]),
            (BODY, "inertia = [0.05, 0.09, 0.12]", "inertia = [0.05, 0.09]", ["body.inertia", "3 numbers"]),
            (BODY, "axis = [0.0, 1.0, 0.0]", "axis = [0.0, 0.0, 0.0]", ["reference.axis", "direction"]),
            (BODY, 'type = "turn"', 'type = "turns"', ["reference.type", "sway"]),
            (BODY, "angle = 4.71238898038469", "angel = 4.7", ["angel", "did you mean 'angle'"]),
            (BODY, 'law = "esmc"', 'law = "smc"', ["control.law", "smc_euler"]),
            (BODY, "lambda = 20.0", "lambda = nan", ["control.lambda"]),
            (PLATFORM, "spread = 0.20", "spread = 0.85", ["platform.spread", "singular"]),
            (PLATFORM, "mass = 0.6", "mass = 0.0", ["platform.rod.mass"]),
            (PLATFORM, "force_limit = 400.0", "force_limit = 400.0\nmoment_limit = 3.0", ["control.moment_limit", "force_limit"]),
        ]
        for scene, old, new, words in cases:
            with self.subTest(new=new):
                text = scene.read_text(encoding="utf-8")
                self.assertIn(old, text)
                bad = self.tmp / "bad.toml"
                bad.write_text(text.replace(old, new, 1), encoding="utf-8")
                line = text[:text.index(old)].count("\n") + 1 + new.count("\n")
                self.bad(bad, words=words + [f"bad.toml:{line}:"])
        self.bad(BODY, *sets("control.model.legs=2", "platform.mass=1"), words=["either [body] or [platform]"])
        self.bad(BODY, *sets("simulation.step=1e-300"), words=["simulation.step", "1e6 steps"])
        self.bad(BODY, *sets("simulation.duration=1e-300"), words=["simulation.duration", "control ticks"])
        self.bad(ARM, words=["rr_line.toml", "either [body] or [platform]"])
        self.bad(self.tmp / "nowhere.toml", words=["nowhere.toml"])
        without = self.tmp / "without.toml"
        without.write_text((BODY).read_text(encoding="utf-8").replace("moment_limit = 20.0\n", ""), encoding="utf-8")
        self.bad(without, words=["without.toml", "control.moment_limit"])

    def test_signs_of_quaternions_change_no_bit(self):
        for scene in (BODY, PLATFORM):
            for law in ("esmc", "esmc_projected"):
                plain = self.summary(scene, f"control.law={law}", "simulation.duration=1.2")
                other = self.summary(scene, f"control.law={law}", "simulation.duration=1.2", "measurement.alternate_sign=true")
                self.assertEqual(plain["digest"], other["digest"])
                self.assertEqual(plain["input"], other["input"])

    def test_seed_law_and_scalar(self):
        noisy = ("measurement.attitude_noise=1e-4", "measurement.position_noise=1e-5", "measurement.rate_noise=1e-3")
        one, again, two = (self.summary(BODY, *noisy, more=("--seed", s)) for s in ("1", "1", "2"))
        self.assertEqual(one["digest"], again["digest"])
        self.assertNotEqual(one["digest"], two["digest"])
        self.assertNotEqual(self.summary(BODY)["digest"], one["digest"])
        short = "simulation.duration=0.5"
        double, single = self.summary(PLATFORM, short), self.summary(PLATFORM, short, more=("--scalar", "float"))
        self.assertNotEqual(double["digest"], single["digest"])
        for a, b in zip(double["final_state"]["attitude"], single["final_state"]["attitude"]):
            self.assertAlmostEqual(a, b, delta=1e-5)

    def test_arrives_where_it_was_sent(self):
        j = self.summary(BODY)
        # 270 degrees about y from the identity: (cos 135, 0, sin 135, 0) or its negative
        q, want = j["final_state"]["attitude"], (math.cos(0.75 * math.pi), 0.0, math.sin(0.75 * math.pi), 0.0)
        self.assertAlmostEqual(abs(sum(a * b for a, b in zip(q, want))), 1.0, delta=1e-9)
        self.assertAlmostEqual(j["final_state"]["position"][0], 0.5, delta=1e-4)
        self.assertLess(j["tracking"]["settled_max_deg"], 0.01)
        j = self.summary(PLATFORM)
        self.assertLess(j["tracking"]["settled_max_deg"], 1e-3)
        self.assertLess(j["tracking"]["settled_max_m"], 1e-6)
        self.assertLess(j["energy"]["relative_error"], 1e-9)
        self.assertIsNone(j["fault"])
        for axis in ("[1,0,0]", "[0,1,0]", "[0,0,1]", "[1,-1,1]"):  # from half a turn off
            j = self.summary(BODY, 'reference={type="hold"}', "initial.position=[0,0,0]", "control.lambda=6.0",
                             "initial.rotation=" + str([math.pi * float(a) / math.hypot(*json.loads(axis)) for a in json.loads(axis)]))
            self.assertAlmostEqual(j["tracking"]["max_deg"], 180.0, delta=1e-6)
            self.assertLess(j["tracking"]["settled_max_deg"], 2.0)

    def test_a_top_let_go_keeps_what_it_has(self):
        j = self.summary(BODY, "control.law=none", "initial.turning=[0.01,6.0,0.02]", "simulation.duration=20.0", "simulation.step=2e-4")
        self.assertLess(j["energy"]["relative_error"], 1e-9)
        self.assertLess(j["momentum"]["relative_error"], 1e-9)
        self.assertIsNone(j["tracking"])
        self.assertEqual(j["input"]["force_max_n"], 0.0)

    def test_a_plant_that_is_not_integrated_is_warned_of(self):
        self.assertEqual(self.summary(BODY)["warnings"], [])
        warned, = self.summary(BODY, "initial.turning=[1000,1000,1000]")["warnings"]
        self.assertIn("a smaller simulation.step than 0.001 s", warned)

    def test_faults_end_with_one_and_no_force(self):
        j = self.summary(BODY, "control.law=smc_euler", code=1)
        self.assertEqual(j["fault"]["name"], "euler_singular")
        self.assertAlmostEqual(j["fault"]["t"], 0.612, delta=0.02)
        self.assertIsNone(j["tracking"]["settled_rms_deg"])
        out = self.tmp / "out"
        r = run(PLATFORM, *sets("reference={type=\"turn\", axis=[0,0,1], angle=2.0, duration=1.0}", "control.force_limit=1e5"), "--out", out)
        self.assertEqual(r.returncode, 1, r)
        self.assertIn("fault: type2", r.stdout)
        rows = read_table(out / "log.csv")
        at = json.loads((out / "summary.json").read_text(encoding="utf-8"))["fault"]["t"]
        for row in rows:
            forces = [float(row[f"u{i}"]) for i in range(1, 7)]
            self.assertEqual(all(f == 0.0 for f in forces), float(row["t"]) >= at, row)

    def test_files(self):
        out = self.tmp / "out"
        r = run(BODY, *sets("simulation.duration=0.1"), "--out", out)
        self.assertEqual(r.returncode, 0, r)
        self.assertEqual(sorted(f.name for f in out.iterdir()), ["log.csv", "scene.toml", "summary.json"])
        again = run(out / "scene.toml", "--json")
        first = json.loads((out / "summary.json").read_text(encoding="utf-8"))
        self.assertEqual(json.loads(again.stdout)["digest"], first["digest"])
        rows = [{k: float(v) for k, v in row.items()} for row in read_table(out / "log.csv")]
        self.assertEqual(len(rows), first["ticks"])
        for row in rows:
            a, b = ([row[k + of] for k in ("qw", "qx", "qy", "qz")] for of in ("", "_ref"))
            angle = 2 * math.degrees(math.acos(min(1.0, abs(sum(x * y for x, y in zip(a, b))))))
            self.assertAlmostEqual(angle, row["angle_deg"], delta=1e-5)
        before = (BODY).read_text(encoding="utf-8")
        own = self.tmp / "own"
        own.mkdir()
        (own / "scene.toml").write_text(before, encoding="utf-8")
        r = run(own / "scene.toml", "--out", own)
        self.assertEqual((r.returncode, (own / "scene.toml").read_text(encoding="utf-8")), (2, before))

    def test_interrupt(self):
        out = self.tmp / "out"
        p = subprocess.Popen([ESMC, "spatial", PLATFORM, *sets("simulation.duration=1000.0"), "--json", "--out", out],
                             stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        while not out.exists() and p.poll() is None:  # it reads the scene first, and listens before that
            time.sleep(0.01)
        p.send_signal(signal.SIGINT)
        printed, err = p.communicate(timeout=60)
        self.assertEqual((p.returncode, err), (130, ""))
        self.assertTrue(json.loads(printed)["interrupted"])
        self.assertEqual(json.loads((out / "summary.json").read_text(encoding="utf-8")), json.loads(printed))


if __name__ == "__main__":
    main()
