#!/usr/bin/env python3
"""The command line as design contracts it, tried from outside. usage: contract_test.py ESMC [unittest args]"""
import json
import math
import struct
from pathlib import Path

from command import ARM, CIRCLE, FRICTION, SCENES, Case, esmc, main, read_table

KEYS = ["scene", "seed", "duration_s", "ticks", "wall_s", "real_time_factor", "law", "active_effects", "state_dimension",
        "tracking", "torque", "closure", "energy", "bus", "supervisor", "final_state", "digest"]
TRACKING = [a + b for b in ("_m", "_rad") for a in ("rms", "max", "settled_rms", "settled_max")]


def fnv(values):
    h = 0xCBF29CE484222325
    for byte in struct.pack(f"<{len(values)}d", *values):
        h = ((h ^ byte) * 0x100000001B3) & 0xFFFFFFFFFFFFFFFF
    return h


class Runs(Case):
    def test_the_demo_tracks_the_comparison_circle_through_frames(self):
        a, b = (self.document("hil", CIRCLE) for _ in range(2))
        for key in KEYS:
            self.assertIn(key, a)
        for key in TRACKING:
            self.assertIn(key, a["tracking"])
        self.assertEqual(a["ticks"], 2000)
        self.assertLessEqual(a["tracking"]["settled_max_rad"], 2e-4)
        self.assertEqual(a["supervisor"], {"final_state": "running", "faults": [], "fault_t_s": None})
        self.assertLess(a["closure"]["max_m"], 1e-13)
        self.assertLess(a["energy"]["relative_error"], 1e-6)
        self.assertEqual(a["bus"]["lost"], 0)
        self.assertRegex(a["digest"], "^[0-9a-f]{16}$")
        self.assertEqual(a["digest"], b["digest"])

    def test_digest_and_errors_follow_from_the_log(self):
        for command, scene in (("sim", CIRCLE), ("hil", FRICTION), ("hil", ARM)):
            out = self.tmp / (command + scene.stem)
            s = self.document(command, scene, "--out", out, "--set", "simulation.duration=0.5")
            rows = read_table(out / "log.csv")
            self.assertEqual(len(rows), s["ticks"])
            five_bar = "theta11" in rows[0]
            q = ["x", "y", "theta11", "theta12", "theta21", "theta22"] if five_bar else ["theta1", "theta2"]
            qd = ["xd", "yd"] + [a + "_rate" for a in q[2:]] if five_bar else [a + "_rate" for a in q]
            state = [float(r[c]) for r in rows for c in q + qd]
            self.assertEqual(f"{fnv(state):016x}", s["digest"])
            distance = [math.hypot(float(r["x"]) - float(r["x_ref"]), float(r["y"]) - float(r["y_ref"])) for r in rows]
            self.assertAlmostEqual(max(distance), s["tracking"]["max_m"], delta=1e-12)
            settled = [d for r, d in zip(rows, distance) if float(r["t"]) >= 0.25]
            rms = math.sqrt(sum(d * d for d in settled) / len(settled))
            self.assertAlmostEqual(rms, s["tracking"]["settled_rms_m"], delta=1e-12)
            head = list(rows[0])
            want = ["t"] + (q + ["tau11", "tau21"] if five_bar else ["x", "y", *q, "tau1", "tau2"]) + ["x_ref", "y_ref"]
            self.assertEqual(head[:len(want)], want)
            names = {p.name for p in out.iterdir()}
            files = {"scene.toml", "summary.json", "log.csv", "report.html"} | ({"frames.log"} if command == "hil" else set())
            self.assertEqual(names, files)
            self.assertEqual(json.loads((out / "summary.json").read_text())["digest"], s["digest"])

    def test_the_scene_as_run_repeats_the_run(self):
        first = self.document("sim", FRICTION, "--out", self.tmp / "a", "--set", "control.gain=35.0",
                             "--set", "control.law=smc")
        again = self.document("sim", self.tmp / "a" / "scene.toml")
        self.assertEqual(first["law"], "smc")
        self.assertEqual(first["digest"], again["digest"])

    def test_every_law_holds_every_mode_of_an_asymmetric_five_bar(self):
        legs = ("[{ l1 = 0.13, l2 = 0.17, lg1 = 0.06, lg2 = 0.07, m1 = 0.12, m2 = 0.09, J1 = 2e-4, J2 = 6e-4 },"
                " { l1 = 0.11, l2 = 0.15, lg1 = 0.05, lg2 = 0.06, m1 = 0.1, m2 = 0.11, J1 = 2.5e-4, J2 = 8e-4 }]")
        text = CIRCLE.read_text()
        text = "\n".join(line for line in text.splitlines() if not line.startswith(("leg =", "assembly_mode")))
        text = text.replace("[mechanism]", f"[mechanism]\nlegs = {legs}\neffector_mass = 0.05", 1)
        text = text.replace("effector_mass = 0.0\n", "")
        # A small circle that every pair of elbows reaches on one side of type 2.
        text = text.replace("center = [0.0, 0.17]", "center = [0.02, 0.20]").replace("radius = 0.07", "radius = 0.015")
        path = self.tmp / "asymmetric.toml"
        path.write_text(text)
        for mode in ('["+", "+"]', '["+", "-"]', '["-", "+"]', '["-", "-"]'):
            for law in ("esmc", "esmc_projected", "smc", "ctc"):
                for motors in ("base", "all"):
                    with self.subTest(mode=mode, law=law, motors=motors):
                        s = self.document("sim", path, "--set", f"mechanism.working_mode={mode}", "--set", f"control.law={law}",
                                         "--set", f"control.motors={motors}", "--set", f"control.sensors={motors}",
                                         "--set", "simulation.duration=0.6", "--set", "reference.join=0.2",
                                         "--set", "control.torque_limit=6.0")
                        self.assertEqual(s["supervisor"]["faults"], [])
                        self.assertLess(s["tracking"]["settled_max_m"], 1e-3)

    def test_a_pose_that_the_limits_do_not_allow_is_not_armed(self):
        # Frames of such a refusal: tests/vcan/loop_job. esmc sim has no drives to arm: the same fault, in its first tick.
        for fault, setting in (("joint_angle", "limits.joint_angle=[[-3,0.1],[-3,0.1]]"), ("type1_singularity", "limits.min_abs_sin_type1=0.99"),
                               ("type2_singularity", "limits.min_abs_sin_type2=0.99")):
            with self.subTest(fault=fault):
                options = (CIRCLE, "--set", setting, "--set", "limits.halt_time=0", "--set", "simulation.duration=0.2")
                run = esmc("hil", *options, "--out", self.tmp / fault)
                self.assertEqual((run.returncode, run.stdout, run.stderr), (1, "", f"esmc: the controller refused to arm: {fault}\n"))
                self.assertFalse((self.tmp / fault).exists(), "there was no run to record")
                run = esmc("sim", *options, "--json", "--out", self.tmp / fault)
                self.assertEqual((run.returncode, [f["name"] for f in json.loads(run.stdout)["supervisor"]["faults"]]), (1, [fault]))
                rows = read_table(self.tmp / fault / "log.csv")
                self.assertEqual(len(rows), 200)
                self.assertEqual({float(r[t]) for r in rows for t in ("tau11", "tau21")}, {0.0})

    def test_init_prints_scenes_that_run(self):
        for kind in ("five_bar", "rr"):
            path = self.tmp / (kind + ".toml")
            path.write_text(esmc("init", kind).stdout)
            self.assertEqual(esmc("check", path).returncode, 0)
            self.assertEqual(esmc("sim", path).returncode, 0)

    def test_eval_reads_stdin_and_float(self):
        text = Path(SCENES, "../../tests/reference/rr_static.json").read_text()
        double = json.loads(esmc("eval", "-", input=text).stdout)["cases"]
        single = json.loads(esmc("eval", "--scalar", "float", input=text).stdout)["cases"]
        self.assertEqual(len(double), 20)
        for a, b in zip(double, single):
            for x, y in zip(a["inverse"]["tau"], b["inverse"]["tau"]):
                self.assertNotEqual(x, y)
                self.assertLess(abs(x - y), 1e-4 * (1 + abs(x)))


class BadInput(Case):
    """One line on stderr that names file, line, key and what is allowed; exit 2; nothing written."""

    good = CIRCLE.read_text()

    def bad(self, *args, words=(), code=2):
        out = self.tmp / "out"
        self.refused(esmc(*args, *(["--out", out] if args[0] in ("sim", "hil") else [])), *words, code=code)
        self.assertFalse(out.exists())

    def scene(self, old, new):
        self.assertIn(old, self.good)
        path = self.tmp / "bad.toml"
        path.write_text(self.good.replace(old, new, 1))
        line = next((i for i, (a, b) in enumerate(zip(self.good.splitlines(), path.read_text().splitlines()), 1) if a != b), 1)
        return path, f"bad.toml:{line}"

    def test_scenes(self):
        cases = [
            ('half_base = 0.05', 'half_bse = 0.05', ["half_base"], False),
            ('lambda = 40.0', 'lamda = 40.0', [], False),
            ('gravity = 9.8', 'gravity = "9.8"', ["mechanism.gravity", "number"], True),
            ('gravity = 9.8', 'gravity = -9.8', ["mechanism.gravity", ">= 0", "from 0"][:1], True),
            ('gravity = 9.8', 'gravity = nan', ["mechanism.gravity"], True),
            ('gravity = 9.8', 'gravity = inf', ["mechanism.gravity"], True),
            ('m1 = 0.1,', 'm1 = -0.1,', ["m1"], True),
            ('l1 = 0.12,', 'l1 = 0.0,', ["l1"], True),
            ('working_mode = ["+", "+"]', 'working_mode = ["+", "x"]', ["working_mode", "+"], True),
            ('law = "esmc"', 'law = "pid"', ["control.law", "esmc_projected"], True),
            ('reaching = "implicit"', 'reaching = "twisting"', ["control.reaching", "super_twisting"], True),
            ('law = "esmc"', 'law = "pd"\nkp = 40.0\nkd = 1.0\npredictor = true', ["control.predictor", "with a model"], False),
            ('law = "esmc"', 'law = "pd"\nkp = 40.0\nkd = 1.0\ndisturbance_observer = 50.0', ["control.disturbance_observer"], False),
            ('law = "esmc"', 'law = "esmc"\npredictor = true\ndelay_ticks = 1.5', ["control.delay_ticks", "whole number"], False),
            ('law = "esmc"', 'law = "esmc"\npredictor = true\ndelay_ticks = 0', ["control.delay_ticks", "at least 1"], False),
            ('law = "esmc"', 'law = "esmc"\ndisturbance_observer = 50.0\ndelay_ticks = 9', ["control.delay_ticks", "0 to 8"], False),
            ('law = "esmc"', 'law = "esmc"\ndisturbance_observer = 50.0\nmotors = "all"\nsensors = "all"', ["control.sensors", "type 2"], False),
            ('law = "esmc"', 'law = "esmc"\nmodel = {m1 = 0.0, m2 = 0.0, J1 = 0.0, J2 = 0.0}', ["control.model", "without mass"], False),
            ('law = "esmc"', 'law = "esmc"\nmotors = "all"\ntorque_weight = [1e12, 1e-300, 1.0, 1.0]', ["control.torque_weight", "factor of 1e+08"], False),
            ('torque_limit = 2.0', 'motors = "all"\ntorque_limit = [1e6, 1e-6, 1.0, 1.0]', ["control.torque_limit", "factor of 10000"], False),
            ('law = "esmc"', 'law = "esmc"\nsensors = "all"\nencoder_sigma = [1e-300, 1.0, 1.0, 1.0]', ["control.encoder_sigma", "factor of 1000"], False),
            ('law = "esmc"', 'law = "esmc"\ndisturbance_observer = -1.0', ["control.disturbance_observer"], False),
            ('torque_limit = 2.0', 'torque_limit = 0.0', ["torque_limit"], True),
            ('torque_limit = 2.0', '', ["torque_limit"], False),
            ('radius = 0.07', 'radius = 0.7', ["reach"], False),
            ('radius = 0.07', 'radius = 0.0', ["radius"], True),
            ('nodes = [1, 2]', 'nodes = [1, 1]', ["node 1"], False),
            ('nodes = [1, 2]', 'nodes = [1, 99]', ["drives.nodes"], True),
            ('duration = 2.0', 'duration = 0.0', ["simulation.duration"], True),
            ('[limits]', '[limits', ["TOML"], True),
            ('assembly_mode = "-"', 'assembly_mode = "+"', ["assembly_mode"], False),
            ('[simulation]', '[[effects]]\ntype = "magic"\n[simulation]', ["effects", "viscous_friction"], False),
            ('[simulation]', '[simulatoin]', ["simulat"], False),
        ]
        for old, new, words, exact in cases:
            with self.subTest(new=new):
                path, where = self.scene(old, new)
                self.bad("sim", path, words=words + ([where] if exact else ["bad.toml"]))

    def test_overrides(self):
        for value, word in (("control.gain=abc", "--set control.gain=abc"), ("control.nothing=1", "unknown key"),
                            ("control.gain", "section.key=value"), ("=3", "section.key=value"),
                            ("simulation.step=0", "simulation.step"), ("control={", "--set")):
            with self.subTest(value=value):
                self.bad("sim", CIRCLE, "--set", value, words=[word])

    def test_arguments_and_files(self):
        self.bad("sim", self.tmp / "missing.toml", words=["missing.toml"])
        self.bad("nonsense")
        self.bad("sim")
        self.bad("hil", CIRCLE, "--bus", "nonsense", words=["--bus", "socketcan:"])
        self.bad("hil", CIRCLE, "--bus", "socketcan:nosuchcan0", words=["socketcan:nosuchcan0"])
        self.bad("plant", CIRCLE, "--bus", "virtual", words=["--bus"])
        self.bad("hil", CIRCLE, "--set", "control.law=none", words=["sim only"])
        self.bad("eval", self.tmp / "missing.json")

    def test_eval(self):
        text = Path(SCENES, "../../tests/reference/fiver_static.json").read_text()
        case = json.loads(text)["cases"][0]
        def broken(change):
            c = json.loads(json.dumps(case))
            change(c)
            path = self.tmp / "cases.json"
            path.write_text(json.dumps({"cases": [c]}, indent=1))
            return path
        self.bad("eval", broken(lambda c: c["params"].pop("l0")), words=["cases.json:", "params.l0"])
        self.bad("eval", broken(lambda c: c["params"]["legs"][1].update(l1=-1)), words=["cases.json:"])
        self.bad("eval", broken(lambda c: c["state"].update(x=9.0)), words=["reach"])
        self.bad("eval", broken(lambda c: c["esmc"].update(switch="loud")), words=["esmc.switch", "sat"])
        self.bad("eval", broken(lambda c: c["esmc"].update(switch="super_twisting")), words=["esmc.switch", "sample time"])
        self.bad("eval", broken(lambda c: c["forward"].update(tau4=[1, 2])), words=["forward.tau4"])
        path = self.tmp / "x.json"
        path.write_text('{"cases": [\n{"id": }')
        self.bad("eval", path, words=["x.json:2"])

    def test_accuracy_that_cannot_be_met_is_a_failed_run(self):
        # Free fall through both singularities for five seconds: chaotic, the twelfth digit is out of reach.
        text = self.good.replace("step = 5e-4", "accuracy = 1e-12").replace("duration = 2.0", "duration = 5.0")
        path = self.tmp / "sharp.toml"
        path.write_text(text.replace('law = "esmc"', 'law = "none"'))
        self.bad("sim", path, words=["accuracy"], code=1)


if __name__ == "__main__":
    main()
