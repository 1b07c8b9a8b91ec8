#!/usr/bin/env python3
"""esmc plan and programs in scenes, from outside: what is printed and written, and programs that are refused by name and place.
usage: plan_test.py ESMC [unittest args]"""
import json
import math

from command import CIRCLE, PROGRAM, Case, esmc, main, read_table

FIVE_BAR = """name = "program"
[mechanism]
type = "five_bar"
half_base = 0.05
gravity = 9.8
effector_mass = 0.05
leg = { l1 = 0.12, l2 = 0.16, lg1 = 0.06, lg2 = 0.068, m1 = 0.1, m2 = 0.1, J1 = 2e-4, J2 = 7e-4 }
working_mode = ["+", "+"]
assembly_mode = "-"
[control]
law = "esmc"
lambda = 60.0
gain = 150.0
torque_limit = 1.5
[simulation]
duration = 0.5
step = 5e-4
[limits]
joint_speed = 50.0
workspace = { x = [-0.14, 0.14], y = [-0.2, 0.25] }
"""
ARM = """name = "program"
[mechanism]
type = "rr"
gravity = 9.8
leg = { l1 = 0.30, l2 = 0.25, lg1 = 0.15, lg2 = 0.11, m1 = 1.2, m2 = 0.8, J1 = 1.0e-2, J2 = 4.5e-3 }
working_mode = ["+"]
[control]
law = "esmc"
lambda = 30.0
gain = 80.0
torque_limit = [15.0, 6.0]
[simulation]
duration = 0.5
step = 5e-4
[limits]
min_abs_sin_type1 = 0.05
joint_speed = 20.0
joint_angle = [[-2.0, 2.0], [-3.0, 3.0]]
"""


def program(moves, start="[-0.08, 0.16]", more=""):
    return f'[reference]\ntype = "program"\nfrom = {start}\n{more}\n' + "".join(f"[[reference.moves]]\n{m}\n" for m in moves)


LINE = 'move = "line"\nto = [0.08, 0.16]'
# Mechanism, moves, and what the message must have: the key, and the place where the way cannot be driven.
BAD = [
    ("no move", FIVE_BAR, [], ["reference.moves", "1 to 1000"]),
    ("only rest", FIVE_BAR, ['move = "dwell"\ntime = 1.0'], ["reference.moves", "dwell"]),
    ("unknown kind", FIVE_BAR, ['move = "circle"\nto = [0.08, 0.16]'], ["reference.moves[1].move", "arc"]),
    ("unknown key", FIVE_BAR, [LINE + "\nvelocity = 1.0"], ["reference.moves[1].velocity"]),
    ("key of another kind", FIVE_BAR, [LINE + "\nvia = [0.0, 0.2]"], ["reference.moves[1].via"]),
    ("no end", FIVE_BAR, ['move = "line"'], ["needs to = [x, y], m"]),
    ("one coordinate", FIVE_BAR, ['move = "line"\nto = [0.1]'], ["reference.moves[1].to", "2 numbers"]),
    ("text as end", FIVE_BAR, ['move = "line"\nto = "home"'], ["reference.moves[1].to"]),
    ("a dwell that moves", FIVE_BAR, [LINE, 'move = "dwell"\ntime = 1.0\nto = [0.0, 0.1]'], ["reference.moves[2].to"]),
    ("a dwell without time", FIVE_BAR, [LINE, 'move = "dwell"'], ["reference.moves[2].time"]),
    ("negative time", FIVE_BAR, [LINE + "\ntime = -0.5"], ["reference.moves[1].time", "optimal"]),
    ("misspelt time", FIVE_BAR, [LINE + '\ntime = "fast"'], ["reference.moves[1].time", "optimal"]),
    ("no speed", FIVE_BAR, [LINE + "\nspeed = 0.0"], ["reference.moves[1].speed"]),
    ("negative blend", FIVE_BAR, [LINE + "\nblend = -0.01", 'move = "line"\nto = [0.08, 0.2]'], ["reference.moves[1].blend"]),
    ("a time beyond its jerk", FIVE_BAR, ['move = "line"\nto = [0.02, 0.16]\ntime = 0.5\njerk = 1.0'], ["reference.moves[1].time", "% of jerk", "optimal"]),
    ("nan", FIVE_BAR, [LINE + "\nacceleration = nan"], ["reference.moves[1].acceleration"]),
    ("blend at the end", FIVE_BAR, [LINE + "\nblend = 0.01"], ["reference.moves[1].blend", "no corner"]),
    ("blend before rest", FIVE_BAR, [LINE + "\nblend = 0.01", 'move = "dwell"\ntime = 0.1'], ["reference.moves[1].blend", "dwell"]),
    ("blend of two timings", FIVE_BAR, [LINE + "\nblend = 0.01", 'move = "line"\nto = [0.08, 0.2]\ntime = 1.0'],
     ["reference.moves[1].blend", "optimal"]),
    ("blend of a turn back", FIVE_BAR, [LINE + "\nblend = 0.01", 'move = "line"\nto = [-0.05, 0.16]'],
     ["reference.moves[1].blend", "(0.08, 0.16)", "turns back"]),
    ("no way", FIVE_BAR, ['move = "line"\nto = [-0.08, 0.16]'], ["reference.moves[1].to", "where the move begins"]),
    ("out of reach", FIVE_BAR, [LINE, 'move = "line"\nto = [0.08, 0.4]'], ["reference.moves[2].to", "out of reach", "(0.08, 0.2"]),
    ("arc through a line", FIVE_BAR, ['move = "arc"\nvia = [0.0, 0.16]\nto = [0.08, 0.16]'], ["reference.moves[1].via", "(0, 0.16)"]),
    ("spline without points", FIVE_BAR, ['move = "spline"\nto = [0.08, 0.16]'], ["through"]),
    ("spline point twice", FIVE_BAR, ['move = "spline"\nthrough = [[0.0, 0.18], [0.0, 0.18]]\nto = [0.08, 0.16]'],
     ["reference.moves[1].through", "(0, 0.18)"]),
    ("beyond the workspace", FIVE_BAR, [LINE, 'move = "line"\nto = [0.15, 0.16]'], ["reference.moves[2].to", "limits.workspace", "(0.1"]),
    ("into the leg", FIVE_BAR, ['move = "line"\nto = [-0.08, -0.1]'], ["reference.moves[1].to", "out of reach", "(-0.08, 0.02"]),
    ("through type 2", FIVE_BAR, ['move = "line"\nto = [0.0, 0.05]'], ["reference.moves[1].to", "type-2", "min_abs_sin_type2", "(-0.001"]),
    ("change of working mode", FIVE_BAR, ['move = "joint"\nto = [2.0, 0.5]\nworking_mode = ["-", "+"]'], ["reference.moves[1].working_mode"]),
    ("legs that do not close", FIVE_BAR, ['move = "joint"\nto = [0.0, 0.0]'], ["reference.moves[1].to", "cannot be closed"]),
    ("too fast", FIVE_BAR, [LINE + "\ntime = 0.02"], ["reference.moves[1].time", "motor", "optimal", "("]),
    ("in a tick", FIVE_BAR, [LINE + "\ntime = 0.001"], ["reference.moves[1].time", "four ticks"]),
    ("faster than its speed", FIVE_BAR, [LINE + "\ntime = 1.0\nspeed = 0.1"], ["reference.moves[1].time", "speed"]),
    ("repeat elsewhere", FIVE_BAR, [LINE], ["reference.moves[1].to", "(0.08, 0.16)", "(-0.08, 0.16)"], "repeat = true"),
    ("through the stretched arm", ARM, ['move = "joint"\nto = [-0.5, -0.5]\nworking_mode = ["-"]'],
     ["reference.moves[1].working_mode", "type 1", "min_abs_sin_type1"]),
    ("singular arm", ARM, ['move = "line"\nto = [0.5499, 0.0]'], ["reference.moves[1].to", "type-1", "(0.54"]),
    ("beyond a joint's angle", ARM, ['move = "joint"\nto = [2.2, 1.0]'], ["reference.moves[1].to", "limits.joint_angle", "base joint 1"]),
    ("too heavy", ARM.replace("15.0, 6.0", "4.5, 6.0"), ['move = "line"\nto = [0.5, 0.0]'], ["reference.moves[1].to", "motor 1", "at rest"]),
]


class Plan(Case):
    def scene(self, text):
        path = self.tmp / "scene.toml"
        path.write_text(text)
        return path

    def plan(self, *args):
        return self.document("plan", *args)

    def test_bad_programs_are_refused_by_name_and_place(self):
        self.assertGreaterEqual(len(BAD), 25)
        for name, mechanism, moves, words, *more in BAD:
            start = "[0.40, -0.10]" if 'type = "rr"' in mechanism else "[-0.08, 0.16]"
            scene = self.scene(mechanism + program(moves, start, *more))
            for command in ("plan", "sim", "check"):
                run = esmc(command, scene, "--out", self.tmp / f"{name} {command}")
                with self.subTest(name, command=command):
                    self.assertEqual(run.returncode, 2, run.stdout + run.stderr)
                    self.assertFalse((self.tmp / f"{name} {command}").exists())
                    self.assertRegex(run.stderr.splitlines()[0], r"^esmc: .*scene\.toml:\d+: ")
                    for word in words:
                        self.assertIn(word, run.stderr)

    def test_the_line_of_the_key_is_named(self):
        scene = self.scene(FIVE_BAR + program([LINE, 'move = "line"\nto = [0.08, 0.4]']))
        number = scene.read_text().splitlines().index("to = [0.08, 0.4]") + 1
        self.assertIn(f"scene.toml:{number}: 'reference.moves[2].to'", esmc("plan", scene).stderr)

    def test_pick_and_place_is_as_fast_as_its_torque_allows(self):
        j = self.plan(PROGRAM, "--out", self.tmp / "out")
        self.assertEqual(next(iter(j)), "schema")
        self.assertGreaterEqual(j["duration_s"], j["bound_s"] * 0.999)
        self.assertLess(j["duration_s"], 1.1 * j["bound_s"])
        self.assertTrue(any(limit.startswith("torque") for limit in j["limits_active"]), j["limits_active"])
        self.assertGreaterEqual(j["margin"]["torque"], -1e-9)
        self.assertGreater(j["margin"]["speed"], 0.0)
        self.assertLessEqual(j["deviation_m"], 0.01)
        self.assertEqual([m["move"] for m in j["moves"]], list(range(1, 9)))
        self.assertAlmostEqual(sum(m["duration_s"] for m in j["moves"]), j["duration_s"], delta=1e-9)
        for row in j["point_to_point"]:
            self.assertAlmostEqual(row["gained_s"], row["line_s"] - row["joint_s"], delta=1e-12)
        self.assertEqual({p.name for p in (self.tmp / "out").iterdir()}, {"plan.json", "path.csv", "report.html", "scene.toml"})
        rows = [{k: float(v) for k, v in row.items()} for row in read_table(self.tmp / "out" / "path.csv")]
        self.assertEqual(list(rows[0])[:5], ["t", "x", "y", "theta11", "theta21"])
        self.assertEqual(len(rows), math.ceil(j["duration_s"] * 1000 - 1e-6) + 1)
        for a, b in zip(rows, rows[1:]):  # speed is the change of position, torque within its limit
            for x, v in (("x", "xd"), ("y", "yd"), ("theta11", "theta11_rate"), ("theta21", "theta21_rate")):
                scale = max(abs(r[v]) for r in rows)
                self.assertAlmostEqual(b[x] - a[x], 5e-4 * (a[v] + b[v]), delta=0.03e-3 * scale)
            self.assertLessEqual(max(abs(b["tau11"]), abs(b["tau21"])), 1.5 * (1 + 1e-9))
        self.assertEqual((rows[0]["x"], rows[0]["xd"]), (-0.1, 0.0))

    def test_motors_give_what_the_controller_believes(self):
        whole, weak = (self.plan(PROGRAM, "--set", f"control.model.torque_factor={f}") for f in (1.0, 0.7))
        self.assertGreater(weak["duration_s"], 1.05 * whole["duration_s"])
        same = self.plan(PROGRAM, "--set", "control.torque_limit=%.17g" % (0.7 * 1.5))
        self.assertAlmostEqual(weak["duration_s"], same["duration_s"], delta=1e-9)
        four = esmc("plan", PROGRAM, *("--set", "control.motors=all", "--set", 'effects=[{type="torque_saturation", limit=0.4}]'))
        self.assertEqual(four.returncode, 2)
        self.assertIn("'control.torque_limit' must be at most 0.4 N m for every motor", four.stderr)

    def test_a_dwell_at_the_beginning_is_at_the_start(self):
        for rate, time in ((500, 0.0502), (250, 0.05), (1000, 0.05)):
            moves = [f'move = "dwell"\ntime = {time}', 'move = "line"\nto = [0.05, 0.17]\nspeed = 0.2', 'move = "line"\nto = [-0.05, 0.17]']
            self.plan(self.scene(FIVE_BAR + program(moves, "[-0.05, 0.17]", "repeat = true")), "--out", self.tmp / f"{rate}", "--set", f"control.rate_hz={rate}")
            rows = read_table(self.tmp / f"{rate}" / "path.csv")
            for row in rows[:int(time * rate)]:
                self.assertAlmostEqual(float(row["x"]), -0.05, delta=1e-12)

    def test_every_command_runs_a_program(self):
        check = json.loads(esmc("check", PROGRAM, "--json").stdout)
        self.assertNotEqual(check["verdict"], "unfit", check["findings"])
        for command in ("sim", "hil"):
            s = self.document(command, PROGRAM)
            self.assertEqual(s["supervisor"]["faults"], [])
            self.assertLess(s["tracking"]["settled_max_m"], 2e-4)
            self.assertEqual(s["torque"]["saturated_ticks"], 0)
        baked = esmc("bake", PROGRAM, "--scalar", "float")
        self.assertEqual(baked.returncode, 0, baked.stderr)
        self.assertIn("PathSegment", baked.stdout)

    def test_all_of_the_torque_is_tracked_too(self):
        text = PROGRAM.read_text().split("[uncertainty]")[0] + "[simulation]\nduration = 1.0\nstep = 5e-4\n"
        scene = self.scene(text)
        j = self.plan(scene)
        self.assertAlmostEqual(j["duration_s"] / j["bound_s"], 1.0, delta=0.005)
        s = self.document("sim", scene)
        self.assertGreater(s["torque"]["max_nm"], 1.49)
        self.assertLess(s["tracking"]["settled_max_m"], 3e-5)
        self.assertEqual(s["supervisor"]["faults"], [])

    def test_moves_in_time_take_that_time(self):
        moves = [LINE + "\ntime = 0.5", 'move = "dwell"\ntime = 0.1', 'move = "arc"\nvia = [0.0, 0.2]\nto = [-0.08, 0.16]\ntime = 0.7']
        j = self.plan(self.scene(FIVE_BAR + program(moves, more="repeat = true")))
        self.assertAlmostEqual(j["duration_s"], 1.3, delta=1e-12)
        self.assertEqual([round(m["duration_s"], 12) for m in j["moves"]], [0.5, 0.1, 0.7])

    def test_all_working_modes_and_the_arm(self):
        for modes, y in ((["+", "+"], 0.2), (["+", "-"], 0.2), (["-", "+"], 0.2), (["-", "-"], 0.2)):
            text = FIVE_BAR.replace('["+", "+"]', json.dumps(modes)).replace('assembly_mode = "-"\n', "")
            for motors in ("base", "all"):
                scene = self.scene(text.replace('law = "esmc"', f'law = "esmc"\nmotors = "{motors}"') +
                                   program([f'move = "line"\nto = [0.02, {y}]\nblend = 0.003', f'move = "line"\nto = [0.02, {y - 0.02}]'], f"[-0.02, {y}]"))
                with self.subTest(modes=modes, motors=motors):
                    self.assertLessEqual(self.plan(scene)["deviation_m"], 0.003)
                    self.assertEqual(esmc("sim", scene).returncode, 0)
        scene = self.scene(ARM + program(['move = "joint"\nto = [0.2, 1.2]', 'move = "line"\nto = [0.40, -0.10]'], "[0.40, -0.10]", "repeat = true"))
        self.plan(scene)
        self.assertEqual(esmc("sim", scene).returncode, 0)

    def test_an_arm_carries_its_payload_at_the_effector(self):
        text = ARM + program(['move = "line"\nto = [0.40, -0.10]\ntime = 5.0'], "[0.40, 0.10]") + '[[effects]]\ntype = "payload"\nmass = 0.4\n'
        self.plan(self.scene(text), "--out", self.tmp / "out")
        first = read_table(self.tmp / "out" / "path.csv")[0]
        a, b = float(first["theta1"]), float(first["theta1"]) + float(first["theta2"])  # at rest: weights and their levers, by hand
        outer = 9.8 * (0.8 * 0.11 + 0.4 * 0.25) * math.cos(b)
        inner = outer + 9.8 * (1.2 * 0.15 + 0.8 * 0.30 + 0.4 * 0.30) * math.cos(a)
        got = [float(first[k]) for k in first if k.startswith("tau")]
        for value, want in zip(got, (inner, outer), strict=True):
            self.assertAlmostEqual(value, want, delta=1e-6)

    def test_reserves_of_slow_motion_are_tried(self):
        """Where the reserve of the fastest motion leaves no torque that of a slower one does; a move that no line makes is no error."""
        j = self.plan(PROGRAM, "--set", "uncertainty={payload=[0,0.2]}")
        self.assertGreater(j["margin"]["torque"], 0.0)
        scene = self.scene(ARM + program(['move = "line"\nto = [0.2, 0.45]\nacceleration = 10.0'], "[0.40, -0.10]") + "[uncertainty]\npayload = [0.0, 0.2]\n")
        self.plan(scene)

    def test_friction_costs_what_it_costs(self):
        """Much of it: a tenth more friction costs about a tenth of the time or less, and the bound is no longer than the plan."""
        times = []
        for viscous in (0.0, 0.06, 0.066, 0.0726, 0.12):
            j = self.plan(PROGRAM, "--set", f'effects=[{{type="viscous_friction",coefficient=[{viscous},{viscous / 4}]}}]')
            self.assertLessEqual(j["bound_s"], 1.002 * j["duration_s"])
            times.append(j["duration_s"])
        self.assertEqual(times, sorted(times))
        self.assertLess(max(b / a for a, b in zip(times[1:4], times[2:4])), 1.1)
        self.assertLess(times[-1], 1.5 * times[0])
        j = self.plan(PROGRAM, "--set", 'uncertainty={viscous=[[0.0,0.08],[0.0,0.016]]}')  # none of it at rest
        self.assertLess(j["duration_s"], 2.0 * times[0])

    def test_a_law_that_answers_slowly_keeps_more_torque(self):
        for law, least in (("esmc", 0.0195), ("ctc", 0.0695)):
            margin = self.plan(PROGRAM, "--set", f'control.law="{law}"')["margin"]["torque"]
            self.assertTrue(least < margin < least + 0.01, (law, margin))

    def test_no_plant_of_the_intervals_saturates(self):
        """Masses and inertias at the ends of [uncertainty], in all combinations; the figure of docs/scenes.md."""
        vary = "".join(f'[[vary]]\nkey = "plant.legs.{leg}.{key}"\nfactor = [0.95, 1.05]\nsteps = 2\n' for leg in (1, 2) for key in ("m1", "m2", "J1", "J2"))
        for law, most in (("esmc", 1.472), ("ctc", 1.5)):
            spec = self.tmp / "corners.toml"
            spec.write_text(f'scene = "{PROGRAM}"\nset = ["control.law=\\"{law}\\""]\nobjectives = ["torque_max_nm", "saturated_ticks"]\n'
                            f'[sample]\nmethod = "grid"\n{vary}')
            run = esmc("sweep", spec, "--out", self.tmp / law)
            self.assertEqual(run.returncode, 0, run.stderr)
            cases = read_table(self.tmp / law / "cases.csv")
            self.assertEqual(len(cases), 256)
            self.assertEqual({c["outcome"] for c in cases}, {"ok"})
            self.assertLess(max(float(c["torque_max_nm"]) for c in cases), most)
            self.assertEqual({float(c["saturated_ticks"]) for c in cases}, {0.0})

    def test_short_moves_and_dense_tables(self):
        j = self.plan(self.scene(FIVE_BAR + program(['move = "line"\nto = [-0.07995, 0.16]'])))
        self.assertTrue(0.9 < j["bound_s"] / j["duration_s"] <= 1.002, j)
        # Several points of a table within a tick, also of 1 ms: only the last of their pieces lasts until the tick.
        times = sorted([0.005 * i for i in range(101)] + [0.2502, 0.2506])
        rows = [(t, -0.04 + 0.08 * (u := t / 0.5) ** 3 * (10 - 15 * u + 6 * u * u), 0.17) for t in times]
        (self.tmp / "dense.csv").write_text("t,x,y\n" + "".join(f"{t:.6f},{x:.12f},{y}\n" for t, x, y in rows))
        for rate in (1000, 125):
            s = json.loads(esmc("sim", CIRCLE, "--json", "--set", f"control.rate_hz={rate}", "--set",
                                f'reference={{type="file", path="{self.tmp}/dense.csv"}}', "--set", 'initial={at="reference"}', "--set", "simulation.duration=0.5").stdout)
            self.assertEqual((s["supervisor"]["faults"], s["torque"]["saturated_ticks"]), ([], 0))

    def test_without_a_start_the_program_begins_where_it_ends(self):
        text = FIVE_BAR + program([LINE, 'move = "line"\nto = [-0.05, 0.17]']).replace("from = [-0.08, 0.16]\n", "")
        self.plan(self.scene(text), "--out", self.tmp / "out")
        first = (self.tmp / "out" / "path.csv").read_text().splitlines()[1].split(",")
        self.assertEqual([float(v) for v in first[1:3]], [-0.05, 0.17])
        text += "[initial]\nposition = [-0.08, 0.16]\n"
        self.plan(self.scene(text), "--out", self.tmp / "out")
        first = (self.tmp / "out" / "path.csv").read_text().splitlines()[1].split(",")
        for value, want in zip(first[1:3], (-0.08, 0.16)):
            self.assertAlmostEqual(float(value), want, delta=1e-12)

    def test_other_references_are_not_planned(self):
        run = esmc("plan", CIRCLE)
        self.refused(run)
        self.assertRegex(run.stderr, r"five_bar_circle\.toml:\d+: 'reference\.type' must be \"program\"")


if __name__ == "__main__":
    main()
