#!/usr/bin/python3
"""`esmc design` and gain = "robust", from outside. usage: design_test.py ESMC [--sample COUNT]"""
import json
import re

from command import ARM, CIRCLE, ROBUST, SAMPLE, Case, esmc, main, sample, sets


def design(scene, *values, expect=0, more=()):
    done = esmc("design", scene, "--json", *more, *sets(*values))
    assert done.returncode == expect, done
    return json.loads(done.stdout)


def need(d, channel):
    return next(g["need"] for g in d["gains"] if g["channel"] == channel)


WORKSPACE = "limits.workspace={x=[-0.06,0.06], y=[0.11,0.23]}"  # holds the circle of ROBUST
# nothing is uncertain
EXACT = [f"uncertainty.{k}=0.0" for k in ("m1", "m2", "J1", "J2", "lg1", "lg2", "l1", "l2")] + [
    "uncertainty.payload=[0.0, 0.0]", "uncertainty.viscous=[[0.0, 0.0], [0.0, 0.0]]", "uncertainty.coulomb=[[0.0, 0.0], [0.0, 0.0]]"]
AT_REST = ["reference={type='hold', position=[0.0, 0.17]}", "simulation.duration=0.02", "control.reaching=sign", "control.law=esmc_projected"]


class Design(Case):
    def test_runs_use_the_gains_that_design_prints(self):
        for scene, values in ((ROBUST, []), (ROBUST, ["control.law=smc"]), (ARM, ["control.gain=robust", "uncertainty.m2=0.1"])):
            d = design(scene, *values)
            baked = esmc("bake", scene, *sets(*values, "control.torque_limit=20.0"))
            self.assertEqual(baked.returncode, 0, baked.stderr)
            columns = [[float.fromhex(x) for x in c.split(",")] for c in
                       re.findall(r"column\(([^)]*)\)", baked.stdout) if len(c.split(",")) in (8, 18)]
            k = columns[1]  # after lambda
            if d["gain_independent"] is not None:
                own = re.search(r"\), \{(\S+), (\S+), ", baked.stdout)
                self.assertEqual(float.fromhex(own[2].rstrip("F")), d["gain_independent"])
            else:
                self.assertEqual([v for v in k if v != 0.0], [g["k"] for g in d["gains"]])

    def test_the_promised_band_is_held_by_sampled_plants(self):
        for values in ([], ["control.law=esmc"], ["control.law=smc"], ["control.law=smc", "control.delay_ticks=2"],
                       ["control.motors=all", "control.sensors=all", "drives={nodes=[1,2,3,4]}"]):
            d = design(ROBUST, *values, "simulation.duration=0.8", "uncertainty.l1=0.0", "uncertainty.l2=0.0", more=("--simulate", "4"))
            p = d["simulated"]["exact_lengths"]
            self.assertEqual((p["outside_band"], p["stopped"]), (0, 0), (values, p))
            self.assertGreater(p["largest_error"], 0.05 * d["band"]["sampled"]["error"])  # else the band says nothing
            self.assertIsNone(d["simulated"]["lengths"])

    def test_of_four_motors_counts_what_they_give_together(self):
        four = ["control.motors=all", "control.sensors=all", "drives={nodes=[1,2,3,4]}", "simulation.duration=0.6"]
        free = design(ROBUST, *four)
        whole = {"force": 1.0, "preload": 1.0}
        self.assertEqual(free["four_motors"], {"hold": whole, "peak": whole})
        self.assertIsNone(design(ROBUST, "simulation.duration=0.6")["four_motors"])
        # A limit below what the least norm asks of one motor, and above what all have to give.
        most = max(t["hold_nm"] for t in free["torque"])
        tight = design(ROBUST, *four, f"control.torque_limit={0.95 * most}")
        self.assertEqual(tight["four_motors"]["hold"], whole)
        self.assertLessEqual(max(t["hold_nm"] for t in tight["torque"]), 0.95 * most)
        self.assertLess(tight["four_motors"]["peak"]["force"], 1.0)
        self.assertTrue(any("give" in w and "of what the law asks for" in w for w in tight["warnings"]))
        refused = design(ROBUST, *four, f"control.torque_limit={0.5 * most}", expect=1)["refused"]
        self.assertIn("of what the worst plant takes on the motion itself", refused)

    def test_preload_is_in_the_torques_and_what_is_left_of_it_is_told(self):
        four = ["control.motors=all", "control.sensors=all", "drives={nodes=[1,2,3,4]}", "simulation.duration=0.6", "mechanism.gravity=0.0",
                "reference.speed=1.0", "reference.radius=0.01"]
        preload = "control.preload=[0.05, 0.05, 0.05, 0.05]"
        free, held = design(ROBUST, *four), design(ROBUST, *four, preload)
        self.assertTrue(all(t["hold_nm"] < 0.05 for t in free["torque"]), free["torque"])
        self.assertTrue(all(t["hold_nm"] >= 0.05 for t in held["torque"]), held["torque"])
        self.assertEqual(held["four_motors"]["hold"]["preload"], 1.0)
        self.assertFalse(any("preload" in w for w in held["warnings"]))
        # Motors that cannot be against each other with these signs: what is left is the bound after yielding.
        signs = design(ROBUST, "simulation.duration=0.6", *four[:3], "control.preload=[0.1, -0.1, -0.1, 0.1]", "control.torque_limit=2.0")
        rest = 0.1 - (1.0 - signs["four_motors"]["hold"]["preload"]) * 2.1
        self.assertLess(rest, 0.0)
        self.assertEqual(sum(f"leaves {rest:.3g} N m on the motion itself: its gear changes sides" in w for w in signs["warnings"]), 4)
        # gain = "robust" has them as well
        self.assertEqual(esmc("sim", ROBUST, *sets(*four, "control.gain=robust", preload)).returncode, 0)

    def test_lengths_are_simulated_and_no_gain_answers_for_them(self):
        a = design(ROBUST, "simulation.duration=0.6", expect=0, more=("--simulate", "4", "--seed", "7"))
        b = design(ROBUST, "simulation.duration=0.6", expect=0, more=("--simulate", "4", "--seed", "7"))
        self.assertEqual(a, b)
        self.assertGreater(a["simulated"]["lengths"]["outside_band"], 0)
        plain = design(ROBUST, "simulation.duration=0.6", "uncertainty.l1=0.0", "uncertainty.l2=0.0")
        self.assertEqual([g["k"] for g in plain["gains"]], [g["k"] for g in a["gains"]])

    def test_need_at_rest_is_what_the_condition_says(self):
        # a mass wrong by 10 % under gravity: K >= 0.1 g in the vertical rows, nothing in the horizontal ones
        d = design(CIRCLE, *AT_REST, "uncertainty={m1=0.1, m2=0.2, tube=1e-5}")
        self.assertAlmostEqual(need(d, "Yg11"), 0.98, delta=0.01)
        self.assertAlmostEqual(need(d, "Yg22"), 1.96, delta=0.02)
        self.assertLess(need(d, "Xg11"), 0.01)
        # dry friction of the outer joint loads both bars, that of the inner one its own
        d = design(CIRCLE, *AT_REST, "uncertainty={coulomb=[[0.0, 0.01], [0.0, 0.004]], tube=1e-5}")
        self.assertAlmostEqual(need(d, "phi11"), 0.014 / 2e-4, delta=0.01 * 70)
        self.assertAlmostEqual(need(d, "phi12"), 0.004 / 7e-4, delta=0.01 * 6)
        # a payload where no mass is believed: half of it in each distal bar, moved to its mass centre
        d = design(CIRCLE, *AT_REST, "uncertainty={payload=[0.0, 0.05], tube=1e-5}")
        self.assertAlmostEqual(need(d, "Yg12"), 0.5 * 0.05 * 9.8 / 0.1, delta=0.03)
        # and where one is: its own row
        d = design(CIRCLE, *AT_REST, "mechanism.effector_mass=0.05", "uncertainty={payload=[0.0, 0.05], tube=1e-5}")
        self.assertAlmostEqual(need(d, "y"), 9.8, delta=0.1)
        # gravity wrong by 2 %
        d = design(CIRCLE, *AT_REST, "uncertainty={gravity=0.02, tube=1e-5}")
        self.assertAlmostEqual(need(d, "Yg21"), 0.196, delta=0.002)
        # a mass centre 4 mm off, at rest: a moment m g times the horizontal arm, at most
        d = design(CIRCLE, *AT_REST, "uncertainty={lg2=0.004, tube=1e-5}")
        self.assertLess(need(d, "phi12"), 0.1 * 9.8 * 0.004 / 7e-4)
        self.assertGreater(need(d, "phi12"), 0.2 * 0.1 * 9.8 * 0.004 / 7e-4)

    def test_more_uncertainty_needs_more(self):
        narrow, wide = design(ROBUST, "uncertainty.tube=0.02"), design(ROBUST, "uncertainty.tube=0.02", "uncertainty.m1=0.3")
        self.assertGreater(need(wide, "Yg11"), 1.5 * need(narrow, "Yg11"))
        self.assertGreater(wide["torque"][0]["hold_nm"], narrow["torque"][0]["hold_nm"])
        there = design(ROBUST, "uncertainty.tube=0.007", "control.reaching=sign", WORKSPACE, more=("--workspace",))
        self.assertEqual(there["over"], "workspace")
        self.assertGreater(need(there, "phi11"), need(design(ROBUST, "uncertainty.tube=0.007", "control.reaching=sign"), "phi11"))

    def test_a_workspace_needs_all_that_a_reference_in_it_needs(self):
        for law in ("esmc_projected", "smc"):
            values = ["control.reaching=sign", "uncertainty.tube=0.003", f"control.law={law}"]
            here, there = design(ROBUST, *values), design(ROBUST, *values, WORKSPACE, more=("--workspace",))
            if law == "smc":
                self.assertGreaterEqual(there["gain_independent"], here["gain_independent"])
            for a, b in zip(here["gains"], there["gains"]):
                self.assertGreaterEqual(b["need"], a["need"], a["channel"])
            for a, b in zip(here["torque"], there["torque"]):
                self.assertGreaterEqual(b["hold_nm"], a["hold_nm"])

    def test_a_workspace_beyond_reach_is_what_can_be_reached(self):
        values = ("uncertainty.tube=0.003", "control.reaching=sign", "control.law=smc", "control.torque_limit=100.0")
        boxes = ([], ["limits.workspace={x=[-3.0,3.0], y=[-3.0,3.0]}"])
        here, there = (design(ROBUST, *values, *box, more=("--workspace",)) for box in boxes)
        for key in ("gain_independent", "states", "torque"):
            self.assertEqual(here[key], there[key])

    def test_a_late_torque_of_exact_plants_has_a_band_over_a_workspace_too(self):
        d = design(ROBUST, *EXACT, "control.law=smc", "control.delay_ticks=2", "uncertainty.tube=0.006", "simulation.duration=0.6", WORKSPACE,
                   more=("--workspace", "--simulate", "2"))
        p = d["simulated"]["exact_lengths"]
        self.assertGreater(d["band"]["sampled"]["error"], 1e-6)
        self.assertEqual((p["outside_band"], p["stopped"]), (0, 0), p)

    def test_how_long_a_scene_lasts_changes_no_gain(self):
        short, *longer = (design(ROBUST, "uncertainty.tube=0.00466", f"simulation.duration={t}") for t in (1.5, 60, 600))
        for d in longer:
            self.assertEqual((d["gains"], d["torque"]), (short["gains"], short["torque"]))
        # a motion that looks at regular distances would keep step with
        fast = ["reference.speed=21.4443866", "reference.radius=0.02", "control.law=smc", "control.reaching=sign", "uncertainty.tube=0.004"]
        for t in (3, 600):
            self.assertIn("0.683 N m", design(ROBUST, *fast, "control.torque_limit=0.6", f"simulation.duration={t}", expect=1)["refused"])

    def test_the_band_of_a_smooth_layer_is_held(self):
        for reaching in ("tanh", "saturation"):
            d = design(ROBUST, *EXACT, "control.law=smc", f"control.reaching={reaching}", "control.layer=0.05", "uncertainty.gravity=[0.8, 1.2]",
                       "uncertainty.reaching_time=5.0", "reference.radius=0.01", "reference.speed=1.0", more=("--simulate", "4"))
            p = d["simulated"]["exact_lengths"]
            self.assertEqual((p["outside_band"], p["stopped"]), (0, 0), p)
            self.assertGreater(p["largest_error"], 0.3 * d["band"]["layer"]["error"])

    def test_a_layer_too_steep_for_the_tick_is_refused(self):
        steep, smc = "(gain / layer + lambda) * tick = ", ["control.law=smc", "control.reaching=tanh"]
        refused = design(ROBUST, *smc, "control.layer=0.003", expect=1)["refused"]
        self.assertIn(steep, refused)
        for command in ("check", "sim"):  # gain = "robust" is the same design
            said = esmc(command, ROBUST, *sets(*smc, "control.layer=0.003", "control.gain=robust"))
            self.assertEqual((said.returncode, refused[:100] in said.stderr), (2, True), said.stderr)
        warned = design(ROBUST, *smc, "control.layer=0.01")["warnings"]
        self.assertTrue(any("better below 0.3" in w for w in warned), warned)
        for law in ("esmc_projected", "smc"):  # gain / layer is no number any more
            for layer in ("1e-300", "1e-310"):
                given = ["control.reaching=saturation", f"control.law={law}", f"control.layer={layer}", "uncertainty.tube=0.004"]
                self.assertIn(steep, design(ROBUST, *given, expect=1)["refused"])
        # A delay, told or not, leaves less.
        self.assertIn("at most 0.17", design(ROBUST, *smc, "control.layer=0.01", "control.delay_ticks=4", expect=1)["refused"])
        late = "effects=[{type='compute_delay', time=4e-3}]"
        self.assertIn("with these gains " + steep, design(ROBUST, *smc, "control.layer=0.01", late, expect=1)["refused"])

    def test_a_row_may_be_steep_where_it_is_hardly_heavy(self):
        for law in ("esmc", "esmc_projected"):
            given = ["control.reaching=saturation", f"control.law={law}", "uncertainty.gravity=[0.9, 1.1]"]
            d = design(ROBUST, *given, "control.layer=0.3")
            self.assertGreater(max(g["k"] for g in d["gains"]) / 0.3 * 1e-3, 2.0, "by its steepest row it would ring")
            sim = esmc("sim", ROBUST, "--json", *sets(*given, "control.layer=0.3", "control.gain=robust", "simulation.duration=0.8"))
            self.assertLess(json.loads(sim.stdout)["torque"]["mean_abs_delta_nm"], 2e-3)
            self.assertIn("too stiff for its tick", design(ROBUST, *given, "control.layer=0.01", expect=1)["refused"])

    def test_a_delay_of_parts_of_a_tick_lies_between_its_neighbours(self):
        late = [design(ROBUST, "control.law=smc", f"control.delay_ticks={t}") for t in (0, 0.25, 0.5, 1, 1.5, 2)]
        for what in (lambda d: d["gain_independent"], lambda d: d["band"]["sampled"]["error"]):
            found = [what(d) for d in late]
            self.assertEqual(found, sorted(found))

    def test_a_told_lag_of_what_is_measured_is_in_the_band(self):
        lag, speed = 2 / 5000, 0.05 * 11.27
        values = ["effects=[{type='delay', ticks=2}]", "control.law=smc", "control.lambda=68", "control.rate_hz=5000", "control.torque_limit=20",
                  "reference.speed=11.27", "mechanism.gravity=0.0", "uncertainty={lg2=0.005}", "simulation.duration=0.6"]
        d = design(ROBUST, *values, "control.sensor_lag_ticks=2", more=("--simulate", "2"))
        self.assertEqual(d["simulated"]["exact_lengths"]["outside_band"], 0)
        self.assertGreater(d["band"]["sampled"]["error"], lag * speed)
        self.assertFalse(any("knows nothing" in w for w in d["warnings"]))
        for told in ("control.sensor_lag_ticks=1", "control.delay_ticks=2"):  # a lag told as a delay of torques has no such term
            self.assertTrue(any("knows nothing of: delay" in w for w in design(ROBUST, *values, told)["warnings"]))

    def test_a_told_delay_of_torques_is_known_and_simulated(self):
        late = ["effects=[{type='compute_delay', time=1e-3}]", "control.law=smc"]
        for told, known in ((0, False), (1, True), (2, True)):
            d = design(ROBUST, *late, f"control.delay_ticks={told}")
            self.assertEqual(any("knows nothing of: compute_delay" in w for w in d["warnings"]), not known)
        # plants have the longer of the scene's delay and the told one
        short = ["control.law=smc", "simulation.duration=0.6", "uncertainty.l1=0.0", "uncertainty.l2=0.0"]
        told, given, more = (design(ROBUST, *short, f"control.delay_ticks={t}", *e, more=("--simulate", "2"))["simulated"]["exact_lengths"]
                             for t, e in ((1, []), (1, [late[0]]), (1, ["effects=[{type='compute_delay', time=2e-3}]"])))
        self.assertEqual(told, given)
        self.assertNotEqual(told["largest_error"], more["largest_error"])

    def test_exact_plants_have_a_design(self):
        d = design(ROBUST, *EXACT, "simulation.duration=0.6", more=("--simulate", "1"))
        self.assertLess(d["tube"]["error"], 1e-4)
        self.assertEqual(d["simulated"]["exact_lengths"]["outside_band"], 0)

    def test_advice_of_a_refusal_helps(self):
        wide = ["control.gain=robust", "control.law=esmc_projected", "uncertainty={m1=0.1, m2=0.1, lg1=0.01, lg2=0.01, payload=[0.0, 0.3], coulomb=[[0.0, 0.3], [0.0, 0.1]]}",
                "control.torque_limit=100.0"]
        for scene, values in ((ARM, wide), (ARM, [*wide, "control.law=smc"]),
                              (ROBUST, ["control.law=smc", "uncertainty.m2=0.6", "uncertainty.J2=0.6"]), (ROBUST, ["control.delay_ticks=2"])):
            refused = design(scene, *values, expect=1)["refused"]
            advice = re.search(r"; tried and helps: ([^;]*)", refused)[1].replace(" (it chatters)", "").split(", ")
            for one in advice:
                keys = ["control." + pair.replace(" ", "=") for pair in one.split(" with ")]
                self.assertIsNone(design(scene, *values, *keys)["refused"], one)
            for one in re.search(r"; tried in vain: (.*)", refused)[1].replace(" (it chatters)", "").split(", ")[:1]:
                keys = ["control." + pair.replace(" ", "=") for pair in one.split(" with ")]
                self.assertIsNotNone(design(scene, *values, *keys, expect=1)["refused"], one)

    def test_what_plants_are_judged_by_is_said(self):
        for values, judge, word in (([], "sampled", "outside the band"), (["control.reaching=sign"], "tube", "outside the tube"),
                                    (["control.law=smc", "control.reaching=tanh", "control.layer=0.01"], "layer", "outside the band of the layer")):
            values = [*values, "simulation.duration=0.4", "uncertainty.l1=0.0", "uncertainty.l2=0.0"]
            self.assertEqual(design(ROBUST, *values)["simulated"]["judged_by"], judge)
            self.assertIn(word, esmc("design", ROBUST, "--simulate", "1", *sets(*values)).stdout)

    def test_refusals_have_a_reason(self):
        for values, word in ((["control.torque_limit=0.3"], "torque_limit"),
                             (["control.law=smc", "uncertainty.m2=0.8", "uncertainty.J2=0.8"], "no gain works"),
                             (["control.delay_ticks=3"], "[F38]"),
                             (["uncertainty.tube=1e-4"], "tube"),
                             (["uncertainty.tube=0.09"], "leaves the reach"),
                             (["mechanism.leg.J1=0.0"], "believes no inertia")):
            d = design(ROBUST, *values, expect=1)
            self.assertIn(word, d["refused"])
            self.assertEqual(esmc("design", ROBUST, *sets(*values)).returncode, 1)
            self.refused(esmc("sim", ROBUST, *sets(*values)), word, "robust")

    def test_bad_input(self):
        for scene, values, words in (
                (CIRCLE, ["control.gain=robust"], ["[uncertainty]"]),
                (ROBUST, ["control.gain=robus"], ["control.gain", "robust"]),
                (ROBUST, ["uncertainty.m1=1.5"], ["uncertainty.m1", "0.1 is 10 %"]),
                (ROBUST, ["uncertainty.m1=[1.1, 0.9]"], ["lower <= upper"]),
                (ROBUST, ["uncertainty.m1=-0.1"], ["uncertainty.m1"]),
                (ROBUST, ["uncertainty.lg1=-0.1"], ["uncertainty.lg1"]),
                (ROBUST, ["uncertainty.lg1=nan"], ["uncertainty.lg1"]),
                (ROBUST, ["uncertainty.payload=[-0.2, 0.1]"], ["uncertainty.payload", "takes away"]),
                (ROBUST, ["uncertainty.viscous=[[0.0, 0.1]]"], ["uncertainty.viscous"]),
                (ROBUST, ["uncertainty.viscous=[[0.0, 0.1],[0.2,0.1]]"], ["uncertainty.viscous"]),
                (ROBUST, ["uncertainty.tube=0.0"], ["uncertainty.tube"]),
                (ROBUST, ["uncertainty.mass=0.1"], ["uncertainty.mass"]),
                (ROBUST, ["uncertainty.over=here"], ["reference | workspace"]),
                (ROBUST, ["command={speed=0.1, acceleration=1.0}"], ["[command]", "robust"]),
                (ARM, ["control.gain=robust", "uncertainty.half_base=0.1"], ["half_base"])):
            self.refused(esmc("sim", scene, *sets(*values)), *words)
        self.refused(esmc("design", CIRCLE), "[uncertainty]")
        self.refused(esmc("design", ROBUST, *sets("control.law=ctc")), "esmc_projected")
        self.refused(esmc("design", ROBUST, "--simulate", "0"), "--simulate")

    def test_a_law_without_gain_may_keep_the_key(self):
        self.assertEqual(esmc("sim", ROBUST, *sets("control.law=ctc", "simulation.duration=0.05")).returncode, 0)

    def test_a_plant_outside_its_intervals_is_named(self):
        d = design(ROBUST, "uncertainty.m1=0.01")
        self.assertTrue(any("m1 of leg 1" in w for w in d["warnings"]))
        self.assertFalse(any("outside" in w for w in design(ROBUST)["warnings"]))
        self.assertTrue(any("encoder" in w for w in design(ROBUST, "effects=[{type='encoder', bits=14}]")["warnings"]))


if __name__ == "__main__":
    main(testLoader=sample.SampledLoader(SAMPLE))
