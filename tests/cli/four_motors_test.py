#!/usr/bin/python3
"""What `esmc check` and `esmc bake` say of four motors against what the controller does with them in `esmc sim`.
usage: four_motors_test.py ESMC [--sample COUNT] [unittest args]; COUNT: of the 20 random mechanisms"""
import json
import math
import random
import re

from command import SAMPLE, SCENES, Case, esmc, main, read_table, sample, sets

# Unlike legs, limits and weights; the least norm asks more of motor 4 than it may give, and the other three can do it without.
UNLIKE = """
name = "unlike"
[mechanism]
type = "five_bar"
half_base = 0.07
gravity = 9.8
effector_mass = 0.15
working_mode = ["+", "-"]
[[mechanism.legs]]
l1 = 0.14
l2 = 0.19
lg1 = 0.05
lg2 = 0.11
m1 = 0.2
m2 = 0.12
J1 = 3e-4
J2 = 5e-4
[[mechanism.legs]]
l1 = 0.12
l2 = 0.2
lg1 = 0.07
lg2 = 0.06
m1 = 0.09
m2 = 0.16
J1 = 2e-4
J2 = 8e-4
[control]
law = "esmc"
reaching = "saturation"
lambda = 30.0
gain = { position = 15.0, angle = 100.0 }
layer = { position = 0.1, angle = 0.8 }
rate_hz = 500
motors = "all"
sensors = "all"
torque_limit = [0.9, 0.5, 0.8, 0.35]
torque_weight = [1.0, 3.0, 2.0, 0.7]
model = { m1 = 0.9, J2 = 1.5 }
[drives]
nodes = [1, 2, 3, 4]
[reference]
type = "circle"
center = [0.02, 0.2]
radius = 0.05
speed = 8.0
join = 0.3
[simulation]
duration = 0.6
step = 5e-4
"""
MOTORS = ("tau11", "tau12", "tau21", "tau22")


class FourMotors(Case):
    def setUp(self):
        super().setUp()
        self.unlike = self.tmp / "unlike.toml"
        self.unlike.write_text(UNLIKE, encoding="utf-8")

    def check(self, scene, *values):
        """Whether the reference has its torque, the margins, and what is found about torques."""
        run = esmc("check", scene, "--json", *sets(*values))
        self.assertIn(run.returncode, (0, 1), run.stderr)
        j = json.loads(run.stdout)
        self.assertEqual(j["runs"], run.returncode == 0)
        return not any(f["code"] == "torque_exceeded" for f in j["findings"]), j["margins"], [f["level"] + ": " + f["text"] for f in j["findings"] if "torque_limit" in f["text"]]

    def unsaturated(self, scene, *values):
        """Whether it runs to its end and no tick is saturated: where torque is short the mechanism falls, and a guard may end the run."""
        run = esmc("sim", scene, "--json", *sets(*values))
        self.assertIn(run.returncode, (0, 1), run.stderr)
        return run.returncode == 0 and json.loads(run.stdout)["torque"]["saturated_ticks"] == 0

    def largest(self, scene, *values):
        """Of each motor in a run, N m."""
        out = self.tmp / "run"
        self.assertEqual(esmc("sim", scene, "--out", out, *sets(*values)).returncode, 0)
        rows = read_table(out / "log.csv")
        return [max(abs(float(r[m])) for r in rows) for m in MOTORS]

    def baked(self, scene, *values):
        return esmc("bake", scene, *sets(*values))

    def test_what_one_motor_may_not_give_another_one_gives(self):
        runs, margins, found = self.check(self.unlike)
        self.assertEqual((runs, found), (True, []))
        self.assertEqual(margins["max_torque_nm"][3], 0.35)
        self.assertLess(margins["torque_share"], 0.7)
        self.assertTrue(self.unsaturated(self.unlike))
        for scalar in ("double", "float"):
            done = esmc("bake", self.unlike, "--scalar", scalar)
            self.assertEqual((done.returncode, done.stderr), (0, ""))
            self.assertIn("&part::four_motors<Mechanism>", done.stdout)
        # The least norm is all inside where motor 4 may give what that asks of it.
        wide = self.check(self.unlike, "control.torque_limit=[0.9, 0.5, 0.8, 0.5]")[1]
        self.assertGreater(wide["max_torque_nm"][3], 0.36)
        self.assertIn("four motors together: <= %.3g %% of" % (100 * margins["torque_share"]), esmc("check", self.unlike).stdout)

    def test_what_all_four_cannot_give_is_refused(self):
        # A share of the limits that is just enough, and one that is not, in motion with the reference from the first tick on.
        moving = ("control.law=ctc", "control.model={m1=1.0, J2=1.0}", "reference.join=0", "initial.position=[0.07, 0.2]", "initial.velocity=[0, 0.4]",
                  "simulation.duration=0.8")
        share = self.check(self.unlike, *moving)[1]["torque_share"]
        limits = [0.9, 0.5, 0.8, 0.35]
        for scale, enough in ((1.03, True), (0.97, False)):
            tight = (*moving, "control.torque_limit=%s" % [scale * share * v for v in limits])
            runs, margins, found = self.check(self.unlike, *tight)
            self.assertEqual(runs, enough)
            self.assertAlmostEqual(margins["torque_share"], 1 / scale, delta=1e-9)
            self.assertEqual(self.unsaturated(self.unlike, *tight), enough)
            done = self.baked(self.unlike, *tight)
            if enough:
                self.assertEqual(len(found), 1, found)
                self.assertRegex(found[0], r"^warning: the reference alone takes 97.1 % of what the four motors together give within "
                                           r"torque_limit \(t = 0\.\d{3} s\); little is left to correct errors with$")
                self.assertEqual((done.returncode, done.stderr), (0, ""))
                continue
            self.assertEqual(len(found), 1, found)
            text, names = found[0], re.match(r"(?:error|warning): motors (\d), (\d) and (\d): ", found[0])
            self.assertTrue(names, text)
            self.assertRegex(text, r": at their torque_limit the four motors together give 97 % of what the reference alone takes \(t = 0\.\d{3} s\)$")
            at = float(re.search(r"t = (0\.\d{3}) s", text)[1])
            out = self.tmp / "check"
            self.assertIn(esmc("check", self.unlike, "--out", out, *sets(*tight)).returncode, (0, 1))
            row, = [r for r in read_table(out / "check.csv") if abs(float(r["t"]) - at) < 1e-9]
            held = [i for i in range(4) if abs(abs(float(row[MOTORS[i]])) - scale * share * limits[i]) < 1e-9]
            self.assertEqual([int(names[n]) - 1 for n in (1, 2, 3)], held)
            self.assertEqual((done.returncode, done.stdout), (2, ""))
            self.assertEqual(done.stderr, f"esmc: {self.unlike}: esmc check refuses it: {text.split(': ', 1)[1]}\n")

    def variant(self, r):
        """A scene that can be followed from the first tick on, and its torque limits up to a scale."""
        legs, modes = [], []
        for _ in range(2):
            l1, l2 = r.uniform(0.11, 0.15), r.uniform(0.16, 0.2)
            legs.append("{l1=%.4f, l2=%.4f, lg1=%.4f, lg2=%.4f, m1=%.3f, m2=%.3f, J1=%.6f, J2=%.6f}" % (
                l1, l2, r.uniform(0.2, 0.8) * l1, r.uniform(0.2, 0.8) * l2, r.uniform(0.05, 0.2), r.uniform(0.05, 0.2),
                r.uniform(1e-4, 4e-4), r.uniform(2e-4, 9e-4)))
            modes.append(r.choice("+-"))
        radius, speed, center = r.uniform(0.01, 0.04), r.uniform(2.0, 12.0), [r.uniform(-0.03, 0.03), r.uniform(0.16, 0.22)]
        values = [f"mechanism.legs=[{', '.join(legs)}]", f"mechanism.half_base={r.uniform(0.04, 0.07):.4f}", f"mechanism.working_mode={modes}",
                  f"mechanism.gravity={r.choice((0.0, 9.8))}", f"mechanism.effector_mass={r.uniform(0.0, 0.3):.3f}",
                  f"reference.center={center}", f"reference.radius={radius}", f"reference.speed={speed}", "reference.join=0.0",
                  f"initial.position={[center[0] + radius, center[1]]}", f"initial.velocity={[0.0, radius * speed]}",
                  f"simulation.duration={min(0.002 * math.ceil(500 * 2 * math.pi / speed), 1.6)}", "simulation.step=1e-3",
                  "control.law=ctc", "limits.min_abs_sin_type1=0.02", "limits.min_abs_sin_type2=0.02"]
        friction = r.random() < 0.5
        if friction:
            values.append("effects=[{type=\"viscous_friction\", coefficient=%s}]" % [r.uniform(0.0, 0.02) for _ in range(4)])
        values.append("control.model={m1=1.0, J2=1.0%s}" % (", friction=\"exact\"" if friction else ""))
        weights = r.choice((None, [round(10 ** r.uniform(-1.5, 1.5), 3) for _ in range(4)]))
        limits = [r.uniform(0.2, 1.0) for _ in range(4)]
        signs = r.choice((None, None, [r.choice((-0.1, 0.1)) for _ in range(4)]))

        def of(scale):
            own = [v * scale for v in limits]
            out = [*values, f"control.torque_limit={own}"]
            if weights:
                out.append(f"control.torque_weight={weights}")
            if signs:
                out.append(f"control.preload={[s * v for s, v in zip(signs, own)]}")
            return out
        return of

    def test_check_calls_fit_what_runs_unsaturated(self):
        """From which limits on a run is not saturated is found with `sim` alone; 1 % to either side check has to say the same. The rest
        is sampling: the reference asks at instants, a torque is held for a tick."""
        r, at_limit = random.Random(5), 0
        variants = [self.variant(r) for _ in range(20)]
        chosen = sample.drawn(range(20), SAMPLE)
        for of in (variants[i] for i in chosen):
            high = 1e-3
            while not self.unsaturated(self.unlike, *of(high)):
                high *= 2
                self.assertLess(high, 1e3)
            low = high / 2
            while high > low * 1.004:
                middle = math.sqrt(low * high)
                low, high = (low, middle) if self.unsaturated(self.unlike, *of(middle)) else (middle, high)
            with self.subTest(of(high)):
                for scale, enough in ((1.01 * high, True), (low / 1.01, False)):
                    runs, margins, found = self.check(self.unlike, *of(scale))
                    self.assertEqual(runs, enough, found)
                    self.assertAlmostEqual(margins["torque_share"], high / scale, delta=0.01)
                    self.assertEqual(sum("at their torque_limit" in f for f in found), 0 if enough else 1, found)
                    self.assertEqual(self.baked(self.unlike, *of(scale)).returncode, 0 if enough else 2)
                # And the torques themselves, with more of them at their limits and with fewer. Close to all that the motors have little is
                # left to choose, and a small force moves much: sampled finely.
                for scale in (1.02 * high, 1.6 * high):
                    fine = (*of(scale), "control.rate_hz=4000")
                    told, seen = self.check(self.unlike, *fine)[1]["max_torque_nm"], self.largest(self.unlike, *fine)
                    for a, b in zip(told, seen):
                        self.assertAlmostEqual(a, b, delta=0.01 * max(told))
                    limits, = [json.loads(v.split("=")[1]) for v in of(scale) if v.startswith("control.torque_limit")]
                    at_limit += any(abs(a - b) < 1e-9 for a, b in zip(told, limits))
        if len(chosen) == len(variants):
            self.assertGreater(at_limit, len(variants))  # else limits were of no account

    def test_near_the_singularities(self):
        # Through type 2 and back: as fit as anywhere else, down to where the motors together have no more.
        scene = SCENES / "five_bar_type2.toml"
        runs, margins, found = self.check(scene)
        self.assertEqual((runs, found), (True, []))
        self.assertLess(margins["min_abs_sin_type2"], 0.01)
        share = margins["torque_share"]
        for scale, enough in ((1.05, True), (0.95, False)):
            tight = "control.torque_limit=%s" % [scale * share * v for v in (2.0, 1.0, 2.0, 1.0)]
            self.assertEqual(self.check(scene, tight)[0], enough)
            self.assertEqual(self.unsaturated(scene, tight), enough)

    def test_pd_has_two_motors(self):
        # Its torques come from the base motors also where others are: what those give together is of no account.
        pd = ("control.law=pd", "control.kp=20", "control.kd=0.5")
        runs, margins, _ = self.check(self.unlike, *pd)
        two = self.check(self.unlike, *pd, "control.motors=base", "control.torque_limit=[0.9, 0.8]", "control.torque_weight=[1, 1]", "drives.nodes=[1, 2]",
                         "sensors.nodes=[3, 4]")[1]
        self.assertEqual(margins["max_torque_nm"], [two["max_torque_nm"][0], 0.0, two["max_torque_nm"][1], 0.0])
        self.assertEqual(self.largest(self.unlike, *pd)[1::2], [0.0, 0.0])
        self.assertEqual(runs, True)
        self.assertNotIn("part::four_motors", self.baked(self.unlike, *pd).stdout)
        runs, _, found = self.check(self.unlike, *pd, "control.torque_limit=[%g, 9, 9, 9]" % (0.9 * two["max_torque_nm"][0]))
        self.assertFalse(runs)
        self.assertRegex(found[0], "^(?:error|warning): motor 1: the reference alone takes .* N m of torque_limit")


if __name__ == "__main__":
    main()
