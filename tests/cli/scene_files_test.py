#!/usr/bin/env python3
"""Scene files, --set and --out from outside: what a message says, what an override replaces, what is left behind.
usage: scene_files_test.py ESMC [unittest args]"""
import json
import re

from command import ARM, CIRCLE, SCENES, Case, esmc, main, sets


class Scenes(Case):
    def changed(self, old, new):
        text = CIRCLE.read_text()
        self.assertIn(old, text)
        path = self.tmp / "s.toml"
        path.write_text(text.replace(old, new, 1))
        return path

    def says(self, scene, *values, words=(), without=()):
        run = esmc("sim", scene, *sets("simulation.duration=0.1", *values))
        self.refused(run, *words)
        for word in without:
            self.assertNotIn(word, run.stderr)

    def runs(self, scene, *values):
        return self.document("sim", scene, *sets("simulation.duration=0.05", *values))

    def test_a_slip_of_the_pen_is_named_before_the_key_that_is_missing_for_it(self):
        self.says(self.changed("lambda = 40.0", "lamda = 40.0"), words=["s.toml:19: unknown key 'control.lamda'", "mean 'lambda'?"])
        self.says(self.changed("[simulation]", "[simulatoin]"), words=["unknown key 'simulatoin'", "mean 'simulation'?"])
        self.says(self.changed("radius = 0.07", "raduis = 0.07"), words=["unknown key 'reference.raduis'", "mean 'radius'?"])
        self.says(self.changed("lambda = 40.0", "banana = 40.0"), words=["unknown key 'control.banana'"], without=["mean"])
        self.says(CIRCLE, "reference.position=[0, 0]", words=["it belongs to type = \"hold\""])

    def test_all_errors_of_a_file_are_named_at_once(self):
        text = CIRCLE.read_text()
        for old, new in (('law = "esmc"', 'law = "emsc"'), ("lambda = 40.0", "lamda = 40.0"), ("radius = 0.07", 'radius = "x"'),
                         ("nodes = [1, 2]", "nodes = [1, 2, 3]"), ("step = 5e-4", "step = -1")):
            self.assertIn(old, text)
            text = text.replace(old, new, 1)
        path = self.tmp / "bad.toml"
        path.write_text(text)
        run = esmc("sim", path)
        self.assertEqual((run.returncode, run.stdout), (2, ""))
        want = {"'control.law' must be": "did you mean esmc?", "unknown key 'control.lamda'": "did you mean 'lambda'?", "'reference.radius' must be": "a number",
                "'drives.nodes' must be": "2 integers", "'simulation.step' must be": "a number > 0"}
        lines = run.stderr.splitlines()
        self.assertEqual(len(lines), len(want), run.stderr)
        for line, (what, more) in zip(lines, want.items()):
            number = next(i for i, x in enumerate(text.splitlines(), 1) if x.split("=")[0].strip() == what.split("'")[1].split(".")[1])
            self.assertTrue(line.startswith(f"esmc: {path}:{number}: {what}"), line)
            self.assertIn(more, line)
        path.write_text(CIRCLE.read_text() + "".join(f"key{i} = 1\n" for i in range(30)))
        lines = esmc("sim", path).stderr.splitlines()
        self.assertEqual((len(lines), lines[-1]), (20, "esmc: and 11 more errors"))

    def test_slips_have_suggestions(self):
        self.says(CIRCLE, "control.law=emsc", words=["did you mean esmc?"])
        self.says(CIRCLE, "lambda=30", words=["did you mean 'control.lambda'?"])
        self.says(CIRCLE, "name=a b", words=["""quote it: --set 'name="..."'"""])
        self.says(CIRCLE, 'effects=[{type="encoder"}]', words=["missing key 'effects[1].bits' of type = \"encoder\" (integer"])

    def test_entries_count_from_one(self):
        def of(*sets):
            return self.runs(CIRCLE, *sets)["digest"]
        leg = "{ l1 = %g, l2 = 0.16, lg1 = 0.06, lg2 = 0.068, m1 = 0.1, m2 = 0.1, J1 = 2e-4, J2 = 7e-4 }"
        two = self.changed("leg = " + leg % 0.12, "legs = [" + leg % 0.121 + ", " + leg % 0.12 + "]")
        self.assertEqual(of("mechanism.legs.1.l1=0.121"), self.runs(two)["digest"])
        self.assertEqual(self.runs(two, "mechanism.legs.1.l1=0.12")["digest"], of())
        self.assertNotEqual(of("mechanism.legs.2.l1=0.121"), of("mechanism.legs.1.l1=0.121"))
        both = [self.runs(CIRCLE, *order)["digest"] for order in (("mechanism.leg.m2=0.09", "mechanism.legs.2.J1=3e-4"), ("mechanism.legs.2.J1=3e-4", "mechanism.leg.m2=0.09"))]
        self.assertEqual(both[0], both[1])
        self.assertNotEqual(both[0], of("mechanism.legs.2.J1=3e-4"))
        run = esmc("sim", CIRCLE, *sets("mechanism.legs.2.J1=3e-4", "mechanism.leg.l1=-1"))
        self.assertEqual((run.returncode, re.findall(r"--set mechanism.leg.l1=-1: 'mechanism.legs\[(.)\].l1'", run.stderr)), (2, ["1", "2"]), run.stderr)
        self.says(CIRCLE, "mechanism.legs.2.J1=3e-4", "mechanism.leg.l1=[1, 2]", "mechanism.leg.l1.3=1", words=["--set mechanism.leg.l1.3=1: 'mechanism.leg.l1' has entries 1 to 2"])
        self.says(CIRCLE, "mechanism.legs.3.l1=0.1", words=["'mechanism.legs' has entries 1 to 2"])
        self.says(CIRCLE, "mechanism.legs.2.l1=-1", words=["'mechanism.legs[2].l1' must be"])
        friction = 'effects=[{type="viscous_friction", coefficient=[0.01, 0.01]}]'
        self.assertEqual(of(friction, "effects.1.coefficient=[0.02, 0.02]"), of(friction.replace("0.01", "0.02")))

    def test_one_number_stands_for_equal_entries(self):
        for one, all_of_them in (("drives.gear_ratio=4", "drives.gear_ratio=[4, 4]"), ("drives.direction=-1", "drives.direction=[-1, -1]"),
                                 ('effects=[{type="viscous_friction", coefficient=0.01}]', 'effects=[{type="viscous_friction", coefficient=[0.01, 0.01]}]'),
                                 ('effects=[{type="coulomb_friction", torque=0.02}]', 'effects=[{type="coulomb_friction", torque=[0.02, 0.02]}]')):
            self.assertEqual(self.runs(CIRCLE, one)["digest"], self.runs(CIRCLE, all_of_them)["digest"])
        sine = 'reference={type="joint_sine", offset=%s, amplitude=[0.1, 0.1], omega=%s}'
        stops = 'effects=[{type="end_stops", lower=%s, upper=%s}]'
        for one, all_of_them in ((sine % (1.0, 3), sine % ([1.0, 1.0], [3, 3])), (stops % (-3, 3), stops % ([-3, -3], [3, 3]))):
            self.assertEqual(self.runs(ARM, one)["digest"], self.runs(ARM, all_of_them)["digest"])
        self.says(CIRCLE, "reference.center=0.1", words=["'reference.center' must be 2 numbers"])  # of a point

    def test_help_and_version(self):
        self.assertEqual(esmc("-V").stdout, esmc("--version").stdout)
        self.assertEqual(esmc("help").stdout, esmc("--help").stdout)
        self.assertEqual(esmc("help", "sim").stdout, esmc("sim", "--help").stdout)
        self.assertEqual(esmc("help").returncode, 0)

    def test_a_folder_of_other_files_is_no_place_for_results(self):
        (self.tmp / "docs").mkdir()
        (self.tmp / "docs" / "page.md").write_text("x")
        run = esmc("sim", CIRCLE, "--out", self.tmp / "docs", "--set", "simulation.duration=0.01")
        self.assertEqual((run.returncode, [p.name for p in (self.tmp / "docs").iterdir()]), (2, ["page.md"]))
        self.assertIn("page.md is there, which no earlier run has left", run.stderr)

    def test_bare_words_are_strings(self):
        self.assertEqual(self.runs(CIRCLE, "name=Foo/a-b_1.c")["scene"], "Foo/a-b_1.c")
        self.says(CIRCLE, "control.law=SMC", words=["--set control.law=SMC: 'control.law' must be one of: esmc"])
        self.says(CIRCLE, "name=a b", words=["neither a TOML value nor a bare word"])

    def test_entries_in_brackets_are_told_how_they_are_named(self):
        for value in ("drives.nodes[1]=4", "drives.nodes[0]=[4]", 'effects[0].type="noise"'):
            self.says(CIRCLE, value, words=[f"--set {value}: ", "an entry is named by its number from 1 or by its type"])
        self.says(CIRCLE, "effects.encoder.bits=18", words=["--set effects.encoder.bits=18: the scene has no effects", 'effects=[{type="encoder"}]'])

    def test_another_type_or_start_drops_the_keys_of_the_former(self):
        self.runs(CIRCLE, "initial.position=[0, 0.2]", "reference.type=hold")
        self.runs(CIRCLE, "initial.position=[0, 0.2]", 'reference={type="hold"}')
        self.runs(CIRCLE, "initial.joints=[0.5, 0.5]", "initial.joint_rates=[0, 0]")
        self.runs(CIRCLE, "reference.from=[0, 0.2]", "reference.type=line", "reference.to=[0.02, 0.2]", "reference.duration=1")
        self.says(CIRCLE, "reference.type=hold", words=["reference.type=hold", "[initial] needs position or joints"])
        self.says(CIRCLE, 'reference={type="hold", radius=1}', words=["unknown key 'reference.radius'", "type = \"circle\""])
        self.says(CIRCLE, "initial.joints=[0.5, 0.5]", "initial.position=[0, 0.2]", words=["one of at, position, joints"])
        joined = self.changed('type = "circle"', 'join = 0.04\ntype = "circle"')
        self.assertLess(self.runs(joined, "initial.position=[0, 0.2]", "reference.type=hold", "reference.position=[0, 0.21]")
                        ["torque"]["saturated_ticks"], 30)

    def test_findings_that_depend_on_a_set_name_it(self):
        for value in ("reference.radius=70", "reference.radius=0.12", "mechanism.assembly_mode=+", "control.law=pd"):
            self.says(CIRCLE, value, words=["five_bar_circle.toml:", f" with --set {value}: "])
        self.says(self.changed("radius = 0.07", "radius = 70"), words=["s.toml:24: (70"])

    def test_grammar(self):
        for value, words in (("limits.max_age_ticks=1.5", "must be an integer from 0 to 100, ticks"),
                             ("control.lambda=-1", "must be a number, or a table {position, angle} of numbers, > 0"),
                             ("mechanism.gravity=-1", "must be a number from 0 to 1000"),
                             ("drives.direction=[0.5, 1]", "'drives.direction' must be 1 or -1"),
                             ("drives.nodes=[1, 1]", "'drives.nodes' names node 1 twice")):
            self.says(CIRCLE, value, words=[words])
        mit = "drives.protocol=mit"
        for value, words in (("drives.master_id=1.5", "'drives.master_id' must be an integer from 0 to 2047"),
                             ("drives.master_id=2048", "'drives.master_id' must be an integer or integers"),
                             ("drives.master_id=2", "'drives.master_id' is 2, the node of another motor"),
                             ("drives.torque_range=1.0", "motor 1 may be asked for 2 N m at the joint, its field ends at 1"),
                             ("drives.velocity_range=[1.0]", "'drives.velocity_range' must be"),
                             ("drives.position_range=0", "'drives.position_range' must be"),
                             ("drives.dialect=mit", "must be one of: mini_cheetah | cubemars | damiao | cubemars_v3"),
                             ("drives.nodes=[0, 1]", "'drives.nodes' must be from 1")):
            self.says(CIRCLE, mit, value, words=[words])
        self.says(CIRCLE, mit, "drives.dialect=damiao", "drives.nodes=[1, 16]", words=["must be from 1 to 15"])
        self.says(ARM, 'mechanism.working_mode="-"', words=['must be ["+"] or ["-"]'])
        self.says(SCENES, words=["is a directory"])
        run = esmc("sim", CIRCLE, "--out", CIRCLE)
        self.assertEqual((run.returncode, run.stderr.strip()[-15:]), (2, "Not a directory"))

    def test_the_scene_as_run_has_the_numbers_that_were_typed(self):
        text = ARM.read_text().replace("l1 = 0.30", "l1 = 0.35").replace('"rr-line"', "\"a \\\"b\\\"\\n'c'\"")
        (self.tmp / "a.toml").write_text(text + '[[effects]]\ntype = "viscous_friction"\ncoefficient = [0.3, 1e-9]\n')
        first = esmc("sim", self.tmp / "a.toml", "--json", "--out", self.tmp / "o")
        self.assertEqual(first.returncode, 0, first.stderr)
        written = (self.tmp / "o/scene.toml").read_text()
        for part in ("l1 = 0.35,", "coefficient = [0.3, 1e-09]", "gravity = 9.8\n", "torque_limit = [15.0, 6.0]", "[[effects]]"):
            self.assertIn(part, written)
        again = json.loads(esmc("sim", self.tmp / "o/scene.toml", "--json").stdout)
        self.assertEqual((again["digest"], again["scene"]), (json.loads(first.stdout)["digest"], "a \"b\"\n'c'"))

    def test_a_reference_file_goes_along(self):
        (self.tmp / "p.csv").write_text("t,x,y\n0,0,0.2\n0.02,0.001,0.2\n0.05,0.002,0.201\n")
        scene = self.changed('type = "circle"', 'type = "file"\npath = "p.csv"')
        scene.write_text("\n".join(a for a in scene.read_text().splitlines() if not a.startswith(("center", "radius", "speed"))))
        out = self.tmp / "o"
        first = esmc("sim", scene, "--out", out, "--json")
        self.assertEqual(first.returncode, 0, first.stderr)
        self.assertEqual((out / "scene_reference.csv").read_text(), (self.tmp / "p.csv").read_text())
        again = esmc("sim", out / "scene.toml", "--json", "--out", out)
        self.assertEqual(json.loads(again.stdout)["digest"], json.loads(first.stdout)["digest"])
        esmc("sim", CIRCLE, "--out", out)
        self.assertFalse((out / "scene_reference.csv").exists())
        marked = b"\xef\xbb\xbf" + (self.tmp / "p.csv").read_bytes()  # as spreadsheets write it
        (self.tmp / "p.csv").write_bytes(marked)
        self.assertEqual(esmc("sim", scene, "--out", out).returncode, 0)
        self.assertEqual((out / "scene_reference.csv").read_bytes(), marked)
        (self.tmp / "p.csv").write_text("t,x,y\n0,0,0.2\n0.02,0.001,0.2\n")
        self.says(scene, words=["p.csv:2: three or more points"])


if __name__ == "__main__":
    main()
