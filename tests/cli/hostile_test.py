#!/usr/bin/env python3
"""Files, numbers and surroundings that mean no good: each is refused in one line, or the run says how it failed.
usage: hostile_test.py ESMC [unittest args]"""
import fcntl
import json
import os
import re
import shlex
import signal
import subprocess
import time
from pathlib import Path

from command import ARM, CIRCLE, ESMC, SCENES, Case, esmc, main, sets

# The scene file of the design's contract, as a whole.
CONTRACT = """
name = "usp-circle"
[mechanism]
type = "five_bar"              # "five_bar" | "rr"
half_base = 0.05               # l0 > 0 (five_bar)
gravity = 9.8                  # >= 0, along -y; 0 = horizontal
effector_mass = 0.0            # m0 >= 0
leg = { l1 = 0.12, l2 = 0.16, lg1 = 0.06, lg2 = 0.068, m1 = 0.1, m2 = 0.1, J1 = 2e-4, J2 = 7e-4 }   # both legs (or the arm); or [[mechanism.legs]] twice
working_mode = ["+", "+"]      # sign of sin(theta_j2), per leg in its own frame; RR: one entry
assembly_mode = "-"            # sign of D2 = sin(phi12 + phi22); optional where the initial pose fixes it
[control]
law = "esmc"                   # esmc | esmc_projected | smc | ctc | pd | open_loop | none
reaching = "implicit"          # sign | saturation | tanh | implicit | super_twisting
lambda = 40.0                  # 1/s; number, or a table per kind of channel { position = , angle = }
gain = 150.0                   # k: number, table, or "robust" (from [uncertainty])
layer = 0.05                   # epsilon, for saturation and tanh
delay_ticks = 0                # known torque delay told to the implicit law; default 0 in sim and lockstep, 2 in --realtime and on boards until measured
rate_hz = 1000
motors = "base"                # base | all (5R: 4 motors); RR: both joints are "base"
sensors = "base"               # base encoders + closure | all (passive joints too)
torque_limit = 2.0             # hard clamp at the controller, N m at the joint; required unless law = none/open_loop
model = { m1 = 1.2, friction = "none" }    # what the controller believes, as factors on [mechanism]; friction believed: "none" (default) | "exact"
[reference]
type = "circle"                # circle: center + radius (cos, sin)(phase + speed t) | line | polyline | joint_sine | hold | file
center = [0.0, 0.17]
radius = 0.07
speed = 10.0                   # rad/s
phase = 0.0
join = 0.0                     # s: from the measured pose onto the reference by a quintic; default 0 in sim and lockstep, 1.0 on hardware
[initial]
at = "reference"               # on the reference at rest; or position = [x, y] with velocity = [vx, vy]; or joints = [..] with joint_rates = [..]
[limits]                       # controller side; each a latched fault when crossed
min_abs_sin_type1 = 0.02
min_abs_sin_type2 = 0.05
joint_speed = 50.0
workspace = { x = [-0.3, 0.3], y = [-0.05, 0.3] }   # optional
max_age_ticks = 2              # up to two missed samples are extrapolated, the third is the fault
joint_angle = [[-3.2, 3.2], [-3.2, 3.2]]   # optional, per base joint
[drives]                       # one entry per motor, base joints first
protocol = "odrive"            # odrive | odrive_0.5 | cia402 | mit
nodes = [1, 2]
direction = [1, 1]             # +1: motor turns with the joint angle of the model (leg 2: clockwise seen from the front)
gear_ratio = [1.0, 1.0]        # motor turns per joint turn
offset = [0.0, 0.0]            # joint angle at encoder zero, rad
zero = "absolute"              # absolute | pose (confirmed by hand in a known pose) | end_stop: base angles alone do not fix the assembly mode
[sensors]                      # only for sensors = "all": passive encoders (idle drive nodes may serve): nodes, direction, offset
[bus]
bitrate = 1000000
[simulation]
duration = 2.0
integrator = "rk4"             # a named method with step = ...; or accuracy = 1e-6 (max abs error of final_state.q; 1e-12 .. 1e-2) and the program chooses
step = 1e-4
[[effects]]
type = "viscous_friction"
coefficient = [0.01, 0.01]     # per joint of a leg; four values = the two legs differ
"""


class Hostile(Case):
    def bad(self, *values, words):
        self.refused(esmc("sim", CIRCLE, *sets(*values)), *words)

    def findings(self, *values):
        run = esmc("check", CIRCLE, "--json", *sets(*values))
        self.assertEqual(run.stderr, "")
        return run.returncode, "\n".join(f"{f['level']}: {f['text']}" for f in json.loads(run.stdout)["findings"])

    # What a scene says

    def test_a_choice_is_one_of_the_choices(self):
        for value, key in (('control.law="esmc | esmc_projected | smc | ctc"', "control.law"), ('control.law="smc | ctc"', "control.law"),
                           ('control.law=""', "control.law"), ('control.reaching="sign | saturation"', "control.reaching"),
                           ('mechanism.working_mode=["+ | -", "+"]', "mechanism.working_mode"), ('reference.type="circle | line"', "reference.type")):
            self.bad(value, words=[f"'{key}' must be ", "one of: "])

    def test_the_example_of_the_contract_is_accepted_as_it_stands(self):
        path = self.tmp / "contract.toml"
        path.write_text(CONTRACT)
        for command in ("check", "sim", "hil"):
            run = esmc(command, path)
            self.assertEqual((run.returncode, run.stderr), (0, ""))
        path.write_text(CONTRACT.replace("[bus]", "nodes = [3, 4]\n[bus]"))
        self.refused(esmc("sim", path), "'sensors' is only for control.sensors")

    def test_numbers_that_do_not_end(self):
        for step in ("4e-13", "1e-12", "9e-10", "5e-324"):
            self.bad(f"simulation.step={step}", words=["'simulation.step' cuts a control tick of 0.001 s into more than 1e+06 steps"])
        self.assertEqual(esmc("sim", ARM, *sets("simulation.step=1e-7", "simulation.duration=1e-3")).returncode, 0)
        for ratio in ("1e-300", "1e-4", "0", "1e5"):
            self.bad(f"drives.gear_ratio=[{ratio}, 1]", words=["'drives.gear_ratio' must be a number or numbers from 0.001 to 10000"])
        slow = ("reference.type=polyline", "reference.points=[[0, 0.2], [0.01, 0.2]]")
        for value in ("reference.speed=1e-300", "reference.speed=1e-9"):
            self.bad(*slow, value, words=["'reference.speed' is too slow", "1e+06 s"])
        self.bad(*slow, "reference.speed=1e-7", "control.rate_hz=100000", words=["at most 40000 s"])
        self.bad("control.layer=1e400", words=["--set control.layer=1e400"])

    def test_what_a_cia402_drive_cannot_count(self):
        for timeout in ("1e-13", "9e-4"):
            self.bad("drives.protocol=cia402", f"drives.watchdog_timeout={timeout}", words=["'drives.watchdog_timeout' must be at least 0.001 s"])
        for unit in ("1e-300", "2e-8"):
            self.bad("drives.protocol=cia402", f"drives.velocity_unit={unit}", words=["'drives.velocity_unit' makes limits.joint_speed the number"])

    def test_seeds(self):
        for seed in ("-1", "1e23", "18446744073709551616", "", "1.5", "0x10", " 1", "+1"):
            self.refused(esmc("sim", CIRCLE, f"--seed={seed}" if seed else "--seed=", *sets("simulation.duration=0.01")), "--seed")
        for seed in (0, 18446744073709551615):
            self.assertEqual(json.loads(esmc("sim", CIRCLE, "--json", "--seed", seed, *sets("simulation.duration=0.01")).stdout)["seed"], seed)

    def test_a_text_that_is_too_long_or_too_deep(self):
        good = CIRCLE.read_text()
        bad = self.tmp / "deep.toml"
        for text, words in ((".".join(["a"] * 50000) + " = 1\n", ["deep.toml:1: ", "32 deep"]), ("[" + ".".join(["a"] * 50000) + "]\n", ["32 deep"]),
                            ("\n\nx = " + "[" * 50000 + "\n", ["deep.toml:3: "]), ("x = " + "{a=" * 50000 + "\n", ["32 deep"]),
                            ("# " + "long " * 250000 + "\n" + good, ["deep.toml: ", "1048576"])):
            bad.write_text(text)
            for command in ("sim", "check"):
                self.refused(esmc(command, bad), *words)
        self.bad(".".join(["a"] * 40000) + "=1", words=["--set ", "32 deep"])
        # Dots and brackets that nest nothing.
        bad.write_text('# a' + '.a' * 100 + ' [[[[' * 100 + '\n' + good.replace('"five-bar-circle"', '"' + ".[{'" * 100 + '\\""'))
        self.assertEqual(esmc("check", bad).returncode, 0)

    def test_control_characters_do_not_reach_the_terminal(self):
        name = "name=\"a\\u001b[31mb\\u0007\\nc\\u009b\""
        for command in ("sim", "check"):
            out = esmc(command, CIRCLE, *sets(name, "simulation.duration=0.01")).stdout
            self.assertTrue(out.startswith("a\\x1b[31mb\\x07\\nc\\x9b: "), out)
        run = esmc("sim", CIRCLE, *sets('"k\\u001b[31m"=1'))
        self.assertEqual(run.returncode, 2)
        self.assertNotIn("\x1b", run.stderr)
        self.assertEqual(json.loads(esmc("sim", CIRCLE, "--json", *sets(name, "simulation.duration=0.01")).stdout)["scene"], "a\x1b[31mb\x07\nc\x9b")

    def test_legs_are_given_one_way(self):
        for more in ("mechanism.legs=[]", "mechanism.legs=[{}, {}]"):
            self.bad(more, words=["[mechanism] needs either leg"])

    def test_an_override_of_the_step_or_the_accuracy_replaces_the_other(self):
        short = "simulation.duration=0.02"
        for first, second in (("simulation.accuracy=1e-6", None), ("simulation.accuracy=1e-6", "step = 1e-4\nintegrator = \"dopri5\"\n")):
            path = self.tmp / "s.toml"
            path.write_text(CIRCLE.read_text().replace("step = 5e-4\n", second or "step = 5e-4\n"))
            run = esmc("sim", path, *sets(first, short))
            self.assertEqual((run.returncode, run.stderr), (0, ""))
        path.write_text(CIRCLE.read_text().replace("step = 5e-4", "accuracy = 1e-6"))
        for value in ("simulation.step=1e-4", "simulation.integrator=dopri5"):
            run = esmc("hil", path, *sets(value, short))  # which takes no accuracy
            self.assertEqual((run.returncode, run.stderr), (0, ""))
        self.bad("simulation.accuracy=1e-6", "simulation.step=1e-4", words=["leave out integrator and step"])

    # Reference files

    def reference(self, path, csv=None):
        if csv is not None:
            (self.tmp / "p.csv").write_bytes(csv if isinstance(csv, bytes) else csv.encode())
        lines = [a for a in CIRCLE.read_text().splitlines() if not a.startswith(("center", "radius", "speed"))]
        scene = self.tmp / "s.toml"
        scene.write_text("\n".join(lines).replace('type = "circle"', f'type = "file"\npath = {path}'))
        return scene

    def test_reference_files(self):
        good = "t,x,y\n0,0,0.2\n0.02,0.001,0.2\n0.05,0.002,0.201\n"
        short = sets("simulation.duration=0.05")
        for csv in (good, good.replace("\n", "\r\n"), good.replace(",", " , ").replace("t , x , y", "t,x,y"), good.replace("0.02", "+2.0E-2"), "\ufeff" + good):
            run = esmc("sim", self.reference('"p.csv"', csv), *short)
            self.assertEqual((run.returncode, run.stderr), (0, ""))
        for old, new, words in (("t,x,y", "t,x,y,z", "p.csv:1: the header"), ("t,x,y", "t,x,yz", "p.csv:1: "),
                                ("0.02,0.001,0.2\n", "0.02,0.001,0.2 m\n", "p.csv:3: three finite"), ("0.001,0.2\n", "0.001,0.2,7\n", "p.csv:3: "),
                                ("0.001,", "0.001;", "p.csv:3: "), ("0.001", "nan", "p.csv:3: "), ("0.001", "0x1", "p.csv:3: "), ("0.001", "", "p.csv:3: "),
                                ("0.001", "1e400", "p.csv:3: "), ("0.05,", "1e300,", "p.csv:4: t must be at most 1e+06 s"), ("0.05,", "inf,", "p.csv:4: ")):
            self.assertIn(old, good)
            self.refused(esmc("sim", self.reference('"p.csv"', good.replace(old, new, 1)), *short), words)
        for path, words in (('"."', "not a regular file"), ('""', "not a regular file"), ('"p.csv\\u0000x"', "without NUL"), ('"none.csv"', "does not exist"),
                            ('"fifo"', "not a regular file"), ('"/dev/zero"', "not a regular file")):
            if path == '"fifo"':
                os.mkfifo(self.tmp / "fifo")
            self.refused(esmc("sim", self.reference(path, good)), "s.toml:", "'reference.path'", words)

    # What a run does

    def test_a_state_that_is_not_finite_ends_the_run(self):
        blast = ("control.law=open_loop", "control.torque=[{offset=1e6}, {offset=-1e6}]")
        out = self.tmp / "o"
        for json_flag in ([], ["--json"]):
            run = esmc("sim", CIRCLE, *json_flag, "--out", out, *sets(*blast))
            self.refused(run, code=1)
            self.assertRegex(run.stderr, r"the state is not finite from t = \d[\d.e-]* s on")
            self.assertFalse(out.exists())

    def test_an_interrupted_run_says_how_far_it_came(self):
        for scene_sets, final in (([], "disabled"), (["control.law=none"], "off")):
            s = json.loads(self.interrupted("sim", CIRCLE, "--json", *sets("simulation.duration=100000", *scene_sets))[0])
            self.assertEqual((s["interrupted"], s["duration_s"], s["supervisor"]["final_state"]), (True, 100000.0, final))
            self.assertAlmostEqual(s["simulated_s"], s["ticks"] * 1e-3, delta=1e-9)
            self.assertLess(s["simulated_s"], 99999)
        self.assertEqual(json.loads(esmc("sim", CIRCLE, "--json").stdout)["simulated_s"], 2.0)

    def test_commands_that_wait_end_by_the_signal(self):
        os.mkfifo(self.tmp / "fifo")
        ours = os.open(self.tmp / "fifo", os.O_RDWR)
        for args in (["eval", "-"], ["eval", self.tmp / "fifo"]):
            self.interrupted(*args, stdin=subprocess.PIPE)
        os.close(ours)

    def test_the_command_of_a_report_repeats_the_run(self):
        scene = self.tmp / "a&b it's.toml"
        scene.write_text(CIRCLE.read_text())
        args = ["sim", str(scene), "--set", "effects=[{type='encoder', bits=14}]", "--set", "simulation.duration=0.01", "--out", str(self.tmp / "o;x")]
        self.assertEqual(esmc(*args).returncode, 0)
        page = (self.tmp / "o;x/report.html").read_text()
        told = next(c for c in map(json.loads, re.findall(r'"command":("(?:[^"\\]|\\.)*")', page)) if "sim " in c)
        self.assertEqual(shlex.split(told)[1:], args)

    def test_a_record_takes_no_name_of_the_run(self):
        self.refused(esmc("sim", CIRCLE, "--out", self.tmp / "o", "--mcap", self.tmp / "o/log.csv", *sets("simulation.duration=0.01")), "a file of that name")

    def test_output_that_cannot_be_written_is_a_failure(self):
        cases = Path(SCENES, "../../tests/reference/rr_static.json")
        short = sets("simulation.duration=0.01")
        for args in (["sim", CIRCLE, "--json", *short], ["sim", CIRCLE, *short], ["hil", CIRCLE, "--json", *short],
                     ["check", CIRCLE], ["eval", cases], ["keys"], ["init", "rr"], ["--help"], ["--version"]):
            with open("/dev/full", "w", encoding="utf-8") as full:
                run = subprocess.run([ESMC, *map(str, args)], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
            self.assertEqual(run.returncode, 1, args)
            self.assertRegex(run.stderr, r"\Aesmc: [^\n]*No space left on device\n\Z")
            closed = subprocess.run(["/bin/sh", "-c", '"$@" >&-', "sh", ESMC, *map(str, args)], stderr=subprocess.PIPE, text=True, timeout=60)
            self.assertEqual(closed.returncode, 1, args)
            self.assertRegex(closed.stderr, r"\Aesmc: [^\n]*\n\Z")
        # With standard output closed no file of --out may take its place.
        subprocess.run(["/bin/sh", "-c", '"$@" >&-', "sh", ESMC, "sim", CIRCLE, "--json", "--out", self.tmp / "o", *short], stderr=subprocess.DEVNULL)
        self.assertEqual(json.loads((self.tmp / "o/summary.json").read_text())["ticks"], 10)
        self.assertNotIn("{", (self.tmp / "o/log.csv").read_text())

    # --out

    def test_a_name_that_is_empty(self):
        short = sets("simulation.duration=0.01")
        for args in (["sim", CIRCLE, *short, "--out"], ["sim", CIRCLE, *short, "--mcap"], ["bake", CIRCLE, "--out"], ["export", CIRCLE, "--format", "urdf", "--out"],
                     ["identify", self.tmp, "--write"], ["calibrate", self.tmp, "--write"], ["accuracy", ARM, *short, "--write"], ["live", CIRCLE, "--mcap"],
                     ["accuracy"], ["campaign"], ["campaign", "--fault"], ["drive", "--protocol", "odrive", "--bus", "slcan:/dev/null", "--node"]):
            self.refused(esmc(*args, ""), f"{args[-1]}: an empty argument; is a variable of the shell not set?")

    def test_out_changes_everything_or_nothing(self):
        out = self.tmp / "o"
        short = sets("simulation.duration=0.01")
        self.assertEqual(esmc("sim", CIRCLE, "--out", out, *short).returncode, 0)
        before = {p.name: p.read_bytes() for p in out.iterdir()}
        for name in ("summary.json", "report.html", "frames.log", "check.csv"):
            (out / name).unlink(missing_ok=True)
            (out / name).mkdir()
            (out / name / "mine").write_text("x")
            self.refused(esmc("sim", ARM, "--out", out, *short), f"{name} is a directory")
            self.assertEqual({p.name: p.read_bytes() for p in out.iterdir() if p.is_file()}, {k: v for k, v in before.items() if k != name})
            (out / name / "mine").unlink()
            (out / name).rmdir()
            if name in before:
                (out / name).write_bytes(before[name])

    def test_a_study_may_be_made_again_and_leaves_nothing_beside_a_run(self):
        out = self.tmp / "o"
        for args in (["campaign", "--replay", 1], ["campaign", "--replay", 1], ["campaign", "--episodes", 1], ["accuracy", ARM, *sets("simulation.duration=0.02")]):
            self.assertEqual(esmc(*args, "--out", out).returncode, 0, args)
        self.assertEqual(sorted(p.name for p in out.iterdir()), ["accuracy.json", "report.html"])
        self.assertEqual(esmc("sim", CIRCLE, "--out", out, *sets("simulation.duration=0.01")).returncode, 0)
        self.assertEqual(sorted(p.name for p in out.iterdir()), ["log.csv", "report.html", "scene.toml", "summary.json"])

    def test_two_runs_into_one_folder_do_not_mix(self):
        out = self.tmp / "o"
        short = sets("simulation.duration=0.01")
        self.assertEqual(esmc("sim", CIRCLE, "--out", out, *short).returncode, 0)
        before = {p.name: p.read_bytes() for p in out.iterdir()}
        other = os.open(out, os.O_RDONLY)  # as a run that is moving its files there
        fcntl.flock(other, fcntl.LOCK_EX)
        with subprocess.Popen([ESMC, "sim", ARM, "--out", out, *short], stdout=subprocess.DEVNULL) as run:
            with self.assertRaises(subprocess.TimeoutExpired):
                run.wait(2)
            self.assertEqual({p.name: p.read_bytes() for p in out.iterdir() if p.is_file()}, before)
            os.close(other)
            self.assertEqual(run.wait(30), 0)
        self.assertIn("rr-line", (out / "scene.toml").read_text())
        self.assertEqual(esmc("replay", out).returncode, 0)

    def test_files_of_others_stay(self):
        short = sets("simulation.duration=0.01")
        for name in ("scene.toml", "log.csv", "cases.csv"):
            out = self.tmp / f"of_others_{name}"
            out.mkdir()
            (out / name).write_text("mine")
            self.refused(esmc("sim", CIRCLE, "--out", out, *short), f"{name} is there, which no earlier run has left")
            self.assertEqual({p.name: p.read_text() for p in out.iterdir()}, {name: "mine"})
        out = self.tmp / "again"
        for command in (("check", CIRCLE), ("sim", CIRCLE, *short), ("check", CIRCLE), ("sim", ARM, *short)):
            self.assertEqual(esmc(*command, "--out", out).returncode, 0, command)

    def test_no_output_replaces_an_input(self):
        short = sets("simulation.duration=0.01")
        scene, path, model = self.tmp / "s.toml", self.tmp / "p.csv", self.tmp / "m.toml"
        self.reference('"p.csv"', "t,x,y\n0,0,0.2\n0.02,0.001,0.2\n0.05,0.002,0.201\n")
        model.write_bytes(CIRCLE.read_bytes())
        belief = sets("control.model.mechanism=m.toml")
        for kept in (scene, path, model):
            before = kept.read_bytes()
            for args in (["bake", scene, *belief, "--out", kept], ["export", scene, *belief, "--format", "urdf", "--out", kept],
                         ["sim", scene, *belief, *short, "--mcap", kept], ["hil", scene, *belief, *short, "--mcap", kept],
                         ["live", scene, *belief, "--duration", 0.1, "--mcap", kept], ["accuracy", scene, *belief, *short, "--write", kept]):
                self.refused(esmc(*args), args[-2], f"{kept} is an input of this command")
                self.assertEqual(kept.read_bytes(), before)
        runs = [self.tmp / n for n in "ab"]
        for run in runs:
            self.assertEqual(esmc("sim", CIRCLE, "--out", run, *short).returncode, 0)
        for run in runs:
            before = {p.name: p.read_bytes() for p in run.iterdir()}
            for args in (["compare", *runs], ["campaign", run / "scene.toml", "--episodes", 1], ["campaign", run / "scene.toml", "--replay", 1]):
                self.refused(esmc(*args, "--out", run), "scene.toml, which is read; take another directory")
                self.assertEqual({p.name: p.read_bytes() for p in run.iterdir()}, before)

    def test_a_target_that_turns_bad_during_the_run(self):
        out = self.tmp / "o"
        self.assertEqual(esmc("sim", CIRCLE, "--out", out, *sets("simulation.duration=0.01")).returncode, 0)
        before = {p.name: p.read_bytes() for p in out.iterdir()}
        with subprocess.Popen([ESMC, "sim", CIRCLE, "--out", out, *sets("simulation.duration=3000")], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True) as run:
            while not list(out.glob(".partial-*")):
                time.sleep(0.02)
            time.sleep(0.3)
            (out / "summary.json").unlink()
            (out / "summary.json").mkdir()
            run.send_signal(signal.SIGINT)
            _, error = run.communicate()
        self.assertEqual(run.returncode, 1)
        self.assertRegex(error, r"\Aesmc: --out: [^\n]*summary.json cannot be moved: Is a directory; nothing was changed there\n\Z")
        (out / "summary.json").rmdir()
        del before["summary.json"]
        self.assertEqual({p.name: p.read_bytes() for p in out.iterdir()}, before)

    def test_a_signal_during_a_study_leaves_nothing(self):
        run = self.tmp / "run"
        self.assertEqual(esmc("sim", Path(SCENES, "five_bar_identification.toml"), "--out", run).returncode, 0)
        out = self.tmp / "a/b"
        for _ in range(5):
            with subprocess.Popen([ESMC, "identify", run, "--out", out], stdout=subprocess.DEVNULL) as study:
                began = time.monotonic() + 30
                while not list(out.glob(".partial-*")) and study.poll() is None and time.monotonic() < began:
                    time.sleep(0.002)
                study.send_signal(signal.SIGINT)
                if study.wait(30) == 130:
                    break
        self.assertEqual(study.returncode, 130)
        self.assertEqual(list(self.tmp.iterdir()), [run])

    def test_a_signal_ends_a_design(self):
        scene = Path(SCENES, "five_bar_robust.toml")
        for args in (["design", scene, "--workspace"], ["sim", scene, *sets('uncertainty.over="workspace"', 'control.gain="robust"')]):
            _, error = self.interrupted(*args, "--out", self.tmp / "o")
            self.assertEqual(error, "esmc: interrupted while gains were designed\n")
            self.assertFalse((self.tmp / "o").exists())

    def test_folders_made_for_nothing_go_again(self):
        blast = sets("control.law=open_loop", "control.torque=[{offset=1e6}, {offset=-1e6}]")
        for out in ("a", "a/b/c", "a/b/c/", "./a/../a/b"):
            self.assertEqual(esmc("sim", CIRCLE, "--out", out, *blast, cwd=self.tmp).returncode, 1)
            self.assertEqual(list(self.tmp.iterdir()), [])
        (self.tmp / "kept").mkdir()
        self.assertEqual(esmc("sim", CIRCLE, "--out", "kept/b/c", *blast, cwd=self.tmp).returncode, 1)
        self.assertEqual([p.name for p in self.tmp.rglob("*")], ["kept"])
        (self.tmp / "file").write_text("x")
        self.refused(esmc("sim", CIRCLE, "--out", "file/b/c", cwd=self.tmp), "--out file/b/c: ")

    # check

    def test_check_holds_the_start_against_the_limits(self):
        start = "initial.position=[0.0, 0.2]"
        self.assertEqual(self.findings(start), (0, ""))
        for value, words in (("limits.workspace={x=[-0.2, 0.2], y=[0.205, 0.3]}", "error: the start (0, 0.2) m is beyond limits.workspace"),
                             ("limits.joint_angle=[[-3.2, 3.2], [3.0, 3.2]]", "error: base joint 2 starts at"),
                             ("limits.min_abs_sin_type1=0.999", "error: |sin theta_j2| = "), ("limits.min_abs_sin_type2=0.999", "error: |D2| = ")):
            code, text = self.findings(start, value)
            self.assertEqual(code, 1)
            self.assertIn(words, text)
            self.assertEqual(esmc("sim", CIRCLE, *sets(start, value)).returncode, 1)  # a fault
        code, text = self.findings(start, "initial.velocity=[9, 0]")
        self.assertEqual(code, 1)
        self.assertRegex(text, r"error: base joint 1 starts at -?\d+(\.\d+)? rad/s, limits.joint_speed = 50")

    def test_check_weighs_four_motors_as_the_controller_does(self):
        four = ("control.motors=all", "control.sensors=all", "control.torque_limit=[2, 0.5, 2, 0.25]")
        path = self.tmp / "o"
        for weight in ([], ["control.torque_weight=[1, 9, 1, 4]"]):
            run = esmc("check", CIRCLE, "--out", path, "--json", *sets(*four, *weight))
            largest = json.loads(run.stdout)["margins"]["max_torque_nm"]
            sim = esmc("sim", CIRCLE, "--out", path, *sets(*four, *weight, "control.law=ctc", "reference.join=0.5", "control.gain=0"))
            self.assertEqual(sim.returncode, 0, sim.stdout)
            rows = [line.split(",") for line in (path / "log.csv").read_text().splitlines()]
            for i, name in enumerate(("tau11", "tau12", "tau21", "tau22")):
                seen = max(abs(float(r[rows[0].index(name)])) for r in rows[1000:])
                self.assertAlmostEqual(seen, largest[i], delta=0.02 * largest[i] + 1e-4)

    def test_check_looks_at_effects_without_ticks_and_at_steps_for_stiff_springs(self):
        ticked = 'effects=[{type="noise", sigma=1e-4}, {type="viscous_friction", coefficient=[0, 0]}, {type="jitter", sigma=1e-4}]'
        self.assertIn("there are no ticks and no readings: noise, jitter have no effect", self.findings("control.law=none", ticked)[1])
        self.assertNotIn("no ticks", self.findings(ticked)[1])
        gear = 'effects=[{type="joint_flexibility", stiffness=%g, rotor_inertia=1e-4}]'
        omega = (1000 * (1 / 1e-4 + 1 / (2e-4 + 0.1 * 0.06 ** 2))) ** 0.5
        text = self.findings(gear % 1000)[1]
        self.assertIn("warning: joint_flexibility swings at about %.3g rad/s" % omega, text)
        self.assertIn("take at most %.2g s" % (0.5 / omega), text)
        for values in ([gear % 10], [gear % 1000, "simulation.step=1e-4"], [gear % 1000, "simulation.integrator=radau5"], [gear % 1000, "simulation.accuracy=1e-4"]):
            self.assertNotIn("swings", self.findings(*values)[1])
        self.assertIn("the contact of backlash swings", self.findings('effects=[{type="backlash", gap=0.01}]')[1])
        stops = 'effects=[{type="end_stops", lower=[-3, -3], upper=[3, 3]%s}]'
        self.assertIn("a joint at its end_stops swings", self.findings(stops % ", stiffness=1e4")[1])
        self.assertNotIn("swings", self.findings(stops % "")[1])

    def test_what_is_no_file_to_read(self):
        loop, pipe = self.tmp / "loop.toml", self.tmp / "pipe.toml"
        loop.symlink_to(loop)
        os.mkfifo(pipe)
        for scene, words in ((loop, "cannot be read: Too many levels of symbolic links"), (pipe, "is not a regular file"), (self.tmp / ("a" * 300), "cannot be read: File name too long"),
                             (self.tmp, "is a directory"), (self.tmp / "none.toml", "no such scene file")):
            for args in (["sim", scene], ["check", scene], ["bake", scene], ["export", scene, "--format", "mjcf"], ["campaign", scene], ["accuracy", scene], ["spatial", scene]):
                self.refused(esmc(*args), f"esmc: {scene}: {words}")
            value = f'control.model.mechanism="{scene}"'
            self.refused(esmc("sim", CIRCLE, *sets(value)), f"--set {value}: 'control.model.mechanism' must name a scene file", words)
        self.refused(esmc("sweep", loop), f"{loop}: cannot be read")
        self.refused(esmc("compare", loop, self.tmp), "cannot be read: Too many levels")

    def test_files_that_cannot_be_written(self):
        loop = self.tmp / "loop"
        loop.symlink_to(loop)
        for file, words in ((loop / "x", "cannot be written"), (loop, "exists and is not a regular file"), (self.tmp / ("a" * 300), "cannot be written"), (self.tmp / "no/x", "cannot be written")):
            for args in (["bake", CIRCLE], ["export", CIRCLE, "--format", "urdf"]):
                self.refused(esmc(*args, "--out", file), f"{file}: {words}")

    # eval

    def test_eval_cases(self):
        five, rr = (json.loads(Path(SCENES, f"../../tests/reference/{n}_static.json").read_text())["cases"][0] for n in ("fiver", "rr"))

        def tried(case, change, *args):
            c = json.loads(json.dumps(case))
            change(c)
            return esmc("eval", "-", *args, input=json.dumps({"cases": [c]}))
        state, law = (lambda **k: lambda c: c["state"].update(k)), (lambda key, v: lambda c: c["esmc"][key].__setitem__(0, v))
        theta, rates = five["state"]["theta"], five["state"]["thetad"]
        for change, words in ((state(theta=[theta[0] + 1e-3, *theta[1:]]), "'state.theta' of leg 1 does not lead to"), (state(x=five["state"]["x"] + 1e-3), "'state.theta'"),
                              (state(thetad=[*rates[:3], rates[3] + 0.1]), "'state.thetad' of leg 2"),
                              (lambda c: c["state"].pop("theta") and c["state"].update(thetad=[50, -50, 50, -50]), "'state.thetad' of leg 1"),
                              (lambda c: c["mode"].update(assembly=-c["mode"]["assembly"]), "'state.x', 'state.y' is of the other assembly mode"),
                              (law("lambda", -1), "'esmc.lambda' must be >= 0"), (law("k", -1e-9), "'esmc.k' must be >= 0"),
                              (law("eps", 0.0), "'esmc.eps' must be > 0"), (law("eps", -1), "'esmc.eps' must be > 0"),
                              (lambda c: c["params"]["legs"].append(c["params"]["legs"][0]), "'params.legs' must have 2"), (lambda c: c["params"]["legs"].pop(), "'params.legs'")):
            for scalar in ("double", "float"):
                self.refused(tried(five, change, "--scalar", scalar), "stdin:1: case '" + five["id"] + "'", words)
        self.refused(tried(rr, law("k", -1)), "'esmc.k'")
        for change in (lambda c: None, lambda c: c["esmc"].pop("eps"), lambda c: c["state"].pop("theta"), lambda c: c["state"].pop("theta") and c["state"].pop("thetad")):
            self.assertEqual(tried(five, change).returncode, 0)

    def test_eval_documents(self):
        for text in ('{"cases":[],"x":1e400}', '{"cases":[],"x":-1e999}'):
            path = self.tmp / "big.json"
            path.write_text(text)
            self.refused(esmc("eval", path), f"{path}: ", "overflow")
            self.refused(esmc("eval", "-", input=text), "stdin: ")
        self.refused(esmc("eval", self.tmp), "cannot be read")


if __name__ == "__main__":
    main()
