#!/usr/bin/env python3
"""What a run and a check tell the user: faults, chatter, saturation, overload, progress, report; wrong arguments.
usage: runs_test.py ESMC [unittest args]"""
import json
import os
import pty
import re
import signal
import subprocess

from command import ARM, CIRCLE, ESMC, FRICTION, SCENES, Case, esmc, main, read_table, sets


class Told(Case):
    def report(self, out):
        page = (out / "report.html").read_text()
        return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)[1])

    def test_a_fault_has_a_time_and_tracking_ends_with_it(self):
        # Join from rest, and a limit that is crossed when the circle has been followed for a while.
        for command in ("sim", "hil"):
            args = [command, CIRCLE, *sets("reference.join=0.3", "limits.joint_speed=7.5"), "--out", self.tmp / command]
            text = esmc(*args)
            self.assertEqual(text.returncode, 1)
            s = json.loads((self.tmp / command / "summary.json").read_text())
            rows = read_table(self.tmp / command / "log.csv")
            first = next(i for i, r in enumerate(rows) if r["state"] == "fault")
            self.assertGreater(first, 300)
            self.assertEqual((s["supervisor"]["final_state"], s["supervisor"]["fault_t_s"]), ("fault", float(rows[first]["t"])))
            self.assertEqual({float(r[t]) for r in rows if r["state"] == "fault" for t in ("tau11", "tau21")}, {0.0})
            # What the guard saw: the row's measurement, which is beyond the limit, of the joint that is named.
            fault, = s["supervisor"]["faults"]
            joint = fault["where"].split(",")[0]
            self.assertEqual((fault["name"], fault["tick"], fault["t"], fault["limit"]), ("joint_speed", first, float(rows[first]["t"]), 7.5))
            self.assertEqual(fault["measured"], float(rows[first][joint + "_rate_meas"]))
            self.assertGreater(abs(fault["measured"]), 7.5)
            self.assertEqual("node" in fault["where"], command == "hil")
            self.assertIn(f"FAULT: joint_speed at t = {float(rows[first]['t']):.3f} s: {fault['where']}, {fault['measured']:.4g} rad/s, limit 7.5; ",
                          text.stdout.splitlines()[-1])
            distance = [((float(r["x"]) - float(r["x_ref"])) ** 2 + (float(r["y"]) - float(r["y_ref"])) ** 2) ** 0.5 for r in rows]
            self.assertAlmostEqual(s["tracking"]["max_m"], max(distance[:first]), delta=1e-12)
            self.assertAlmostEqual(s["tracking"]["settled_max_m"], max(distance[250:first]), delta=1e-12)
            self.assertLess(s["tracking"]["max_m"], 1e-3)
            self.assertGreater(max(distance), 0.05)
        s = json.loads(esmc("sim", CIRCLE, "--json", *sets("limits.joint_speed=5")).stdout)
        self.assertIsNone(s["tracking"]["settled_max_m"])
        self.assertIsNone(json.loads(esmc("sim", CIRCLE, "--json").stdout)["supervisor"]["fault_t_s"])

    def test_chatter_saturation_and_overload_are_said(self):
        quiet = esmc("hil", CIRCLE).stdout
        for word in ("chatter", "decides", "cannot carry"):
            self.assertNotIn(word, quiet)
        sign = esmc("sim", CIRCLE, "--out", self.tmp, *sets("control.reaching=sign")).stdout
        self.assertRegex(sign, r"\nCHECK: chatter: .* changes by \d+ % of its maximum")
        self.assertRegex(sign, r"; saturated in 19\d\d of 2000 ticks: the torque limit decides")
        self.assertEqual(len(self.report(self.tmp)["summary"]["verdict"]["reasons"]), 4)
        self.assertRegex(esmc("hil", CIRCLE, *sets("bus.bitrate=250000")).stdout, r"\nCHECK: bus load 2\d\d %: a real bus cannot carry")
        free = esmc("sim", CIRCLE, *sets("control.law=none", "simulation.duration=0.001")).stdout
        self.assertNotIn("chatter", free)
        self.assertIn(" 1 tick (", free)
        self.assertIn("saturated in 0 ticks", free)

    def test_the_report_has_every_limit_and_a_command_that_can_be_typed(self):
        run = esmc("hil", ARM, "--out", self.tmp, *sets("simulation.duration=0.05"))
        self.assertEqual(run.returncode, 0)
        data = self.report(self.tmp)
        self.assertEqual(data["torque_limit"], [15.0, 6.0])
        self.assertTrue(data["command"].startswith(ESMC + " hil "))
        page = (self.tmp / "report.html").read_text()
        self.assertNotIn("scene.match", page)

    def check(self, scene, *values, code=0):
        run = esmc("check", scene, "--json", *sets(*values))
        if code is not None:
            self.assertEqual(run.returncode, code, run.stdout + run.stderr)
        j = json.loads(run.stdout)
        return j, " / ".join(f["level"] + ": " + f["text"] for f in j["findings"])

    def test_check_knows_what_rings(self):
        self.assertEqual(self.check(FRICTION)[1], "")
        self.assertIn("warning: sensors and drives of this scene are late by about 2 ticks", self.check(FRICTION, "control.delay_ticks=0")[1])
        noise = 'effects=[{type="noise",sigma=1e-4,bandwidth=500}]'
        self.assertIn("set control.delay_ticks = 4", self.check(CIRCLE, noise, code=1)[1])
        self.assertEqual(self.check(CIRCLE, noise, "control.law=ctc")[1], "")
        self.assertIn("1 / (1 + delay_ticks) + lambda * tick = 0.813, better below 0.53", self.check(FRICTION, "control.lambda=480", code=None)[1])
        steep = self.check(CIRCLE, "control.reaching=saturation", code=1)[1]
        self.assertIn("warning: (gain / layer + lambda) * tick = 3.04, at most 1, half of what makes", steep)
        self.assertIn("error: the sampled loop is unstable at rest", steep)
        layer = ("control.reaching=tanh", "control.layer=0.4")
        self.assertIn("warning: (gain / layer + lambda) * tick = 0.415, better below 0.3", self.check(CIRCLE, *layer)[1])
        self.assertEqual(self.check(CIRCLE, *layer, "control.gain=90")[1], "")
        late = 'effects=[{type="delay",ticks=1},{type="compute_delay",time=1e-3}]'
        self.assertIn("at most 0.31, half of what makes the loop ring by itself with a delay of 2 ticks", self.check(CIRCLE, *layer, late)[1])
        self.assertIn("node 0", self.check(CIRCLE, "drives.nodes=[0, 1]")[1])
        self.assertIn("less than the 10 ms between two heartbeats", self.check(CIRCLE, "drives.heartbeat_timeout=0.009")[1])
        self.assertIn("for so long a drive without heartbeats", self.check(CIRCLE, "drives.heartbeat_timeout=0.11")[1])
        for fine in ("drives.heartbeat_timeout=0.01", "drives.heartbeat_timeout=0.1"):
            self.assertEqual(self.check(CIRCLE, fine)[1], "")

    def test_check_tells_sim_from_a_bus_as_hil_does(self):
        self.assertTrue(self.check(CIRCLE)[0]["runs_on_bus"])
        for values in (["control.law=none"], ["control.sensors=all"], ["control.motors=all", "drives.nodes=[1, 2]", "control.rate_hz=500"]):
            j = self.check(CIRCLE, *values)[0]
            self.assertEqual((j["runs"], j["runs_on_bus"]), (True, False))
            text = esmc("check", CIRCLE, *sets(*values)).stdout
            self.assertIn("fit for sim, not for a bus: ", text)
            self.assertIn(j["not_on_bus_because"], text)
            self.refused(esmc("hil", CIRCLE, *sets(*values)), j["not_on_bus_because"])

    def test_check_writes_the_torques_along_the_reference(self):
        for scene, motors, more in ((CIRCLE, ["tau11", "tau21"], ["abs_D2"]), (ARM, ["tau1", "tau2"], [])):
            out = self.tmp / scene.stem
            j = json.loads(esmc("check", scene, "--out", out, "--json").stdout)
            self.assertEqual({p.name for p in out.iterdir()}, {"check.csv", "check.json", "report.html", "scene.toml"})
            rows = read_table(out / "check.csv")
            base = [m.replace("tau", "theta") + "_ref" for m in motors]
            self.assertEqual(list(rows[0]), ["t", "x_ref", "y_ref", *base, *motors, "min_abs_sin_type1", *more])
            self.assertEqual(len(rows), {"five_bar_circle": 2000, "rr_line": 3200}[scene.stem])
            for i, m in enumerate(motors):
                self.assertEqual(max(abs(float(r[m])) for r in rows), j["margins"]["max_torque_nm"][i])
            self.assertEqual(min(float(r["min_abs_sin_type1"]) for r in rows), j["margins"]["min_abs_sin_type1"])
        # The torques of the reference are those of a run that follows it.
        esmc("sim", ARM, "--out", self.tmp / "run", *sets("simulation.duration=0.8"))
        for a, b in list(zip(read_table(self.tmp / "run/log.csv"), rows))[300:700:50]:
            self.assertAlmostEqual(float(a["tau1"]), float(b["tau1"]), delta=0.02)

    def test_check_tells_how_much_preload_is_left(self):
        scene = SCENES / "five_bar_preload.toml"
        j, text = self.check(scene)
        self.assertNotIn("preload", text)
        self.assertEqual(j["margins"]["least_preload_nm"], [0.05] * 4)
        asked, out = [0.1, -0.1, 0.1, -0.1], self.tmp / "preload"
        j = json.loads(esmc("check", scene, "--out", out, "--json", *sets(f"control.preload={asked}")).stdout)
        text = "\n".join(f["text"] for f in j["findings"])
        rows = read_table(out / "check.csv")
        for i, motor in enumerate(("tau11", "tau12", "tau21", "tau22")):
            towards = asked[i] / abs(asked[i])
            left = min(towards * float(r[motor]) for r in rows)
            self.assertLess(left, 0.1)
            self.assertAlmostEqual(j["margins"]["least_preload_nm"][i], left, delta=1e-9)
            line, = [x for x in text.splitlines() if x.startswith(f"motor {i + 1}: of control.preload")]
            self.assertIn(f" = {asked[i]:g} N m {towards * left:.3g} N m are left", line)
            self.assertEqual("its sign is lost" in line, left <= 0)
        self.assertEqual(text.count("its sign is lost"), 2)  # of the base motors

    def test_check_warns_of_a_prediction_beyond_the_delay(self):
        observer, predict = SCENES / "five_bar_observer.toml", ("control.predictor=true", "control.delay_ticks=2")
        beyond = "what it foresees has happened already"
        self.assertNotIn(beyond, self.check(observer)[1])  # two ticks late, and told so
        self.assertIn(beyond, self.check(observer, "effects=[]", code=1)[1])
        self.assertIn(beyond, self.check(ARM, *predict, code=1)[1])
        ringing, quiet = (json.loads(esmc("sim", ARM, "--json", *sets(*more)).stdout)["torque"]["saturated_ticks"] for more in (predict, predict[1:]))
        self.assertGreater(ringing, 1000)
        self.assertEqual(quiet, 0)

    def test_check_warns_of_an_observer_that_is_too_fast_for_the_delay(self):
        observer, rings = SCENES / "five_bar_observer.toml", "it rings by itself: a smaller bandwidth"
        late = ("effects=[{type='encoder', bits=16}]", "control.delay_ticks=0", "control.predictor=false", "control.sensor_lag_ticks=2")
        self.assertNotIn(rings, self.check(observer)[1])  # its delay is told
        for bandwidth, said in ((300, False), (500, True), (50000, True)):
            self.assertEqual(rings in self.check(observer, *late, f"control.disturbance_observer={bandwidth}", code=None)[1], said, bandwidth)
        quiet, ringing = (json.loads(esmc("sim", observer, "--json", *sets(*late, f"control.disturbance_observer={w}")).stdout)["torque"]["mean_abs_delta_nm"]
                          for w in (300, 1000))
        self.assertLess(quiet, 0.03)
        self.assertGreater(ringing, 0.3)
        twisting = SCENES / "five_bar_super_twisting.toml"
        self.assertNotIn("holds against nothing", self.check(twisting)[1])
        self.assertIn("the law holds against nothing", self.check(twisting, "control.gain=0")[1])

    def test_arguments(self):
        for args, words in ((["simm", "x"], ["unknown subcommand 'simm'", "did you mean sim?"]),
                            (["bogus", "--help"], ["unknown subcommand 'bogus'"]),
                            (["help", "bogus"], ["unknown subcommand 'bogus'"]),
                            (["sim", CIRCLE, "--bus", "virtual"], ["sim has no --bus; see esmc sim --help"]),
                            (["check", CIRCLE, "--seed", "2"], ["check has no --seed"]),
                            (["sim", CIRCLE, "more"], ["'more'"])):
            self.refused(esmc(*args), *words)
        for half in ("plant", "controller"):
            self.assertNotIn("virtual", esmc(half, "--help").stdout)

    def test_progress_only_on_a_terminal(self):
        long = [ESMC, "sim", str(CIRCLE), *sets("simulation.duration=100000")]
        try:
            ours, theirs = pty.openpty()
        except OSError as reason:
            self.skipTest(f"no pseudo-terminal here: {reason}")
        piped = subprocess.Popen(long, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(piped.wait)
        self.addCleanup(piped.kill)
        with subprocess.Popen(long, stdout=subprocess.DEVNULL, stderr=theirs) as run:
            os.close(theirs)
            seen = b""
            try:
                while part := os.read(ours, 4096):
                    seen += part
                    if b"left" in seen:
                        run.send_signal(signal.SIGINT)
            except OSError:  # the other end is gone
                pass
            self.assertEqual(run.wait(), 130)
        os.close(ours)
        self.assertRegex(seen.decode(), r"\[#* *\] +\d+ %, about \d+ s left")
        self.assertTrue(seen.endswith(b"\r\033[K"))
        piped.send_signal(signal.SIGINT)
        self.assertEqual(piped.communicate()[1], "")

    def test_a_halt_of_four_motors_near_the_reach_is_held(self):
        """The effector's straight way to rest would leave the reach: the base joints' does not."""
        four = ("control.motors=all", "control.sensors=all", "drives.nodes=[1, 2, 3, 4]", "control.torque_limit=5", "reference.join=0.3", "simulation.duration=2", "limits.after_halt=hold")
        for x, y, radius, speed, top in ((0.044, 0.153, 0.09, 1.55, 0.187), (-0.016, 0.185, 0.053, 1.55, 0.214), (0.004, 0.194, 0.073, 1.02, 0.25)):
            run = esmc("sim", CIRCLE, "--json", *sets(*four, f"reference.center=[{x}, {y}]", f"reference.radius={radius}", f"reference.speed={speed / radius}",
                                                      f"limits.workspace={{x=[-1, 1], y=[-1, {top}]}}"))
            found = json.loads(run.stdout)["supervisor"]
            self.assertEqual(([f["name"] for f in found["faults"]], found["final_state"]), (["workspace"], "holding"))

    def test_halts_and_lowering_ring_nowhere(self):
        """Torque stays far from its limit, and changes its sign a few times only."""
        box = "limits.workspace={x=[-0.6, 0.6], y=[%g, %g]}"
        low, type2 = box % (0.0, 0.2), ("five_bar_type2.toml", "simulation.duration=3", "reference.duration=0.6")
        slow = ("reference.speed=2", "control.lambda=10", "control.gain=20")
        mit = ("drives.protocol=mit", "drives.master_id=[101, 102]", "reference.speed=0.5")
        for scene, *sets_of in (("five_bar_circle.toml", low, "control.rate_hz=200", "limits.joint_speed=10"), ("five_bar_circle.toml", low, *slow, "control.rate_hz=50"),
                                ("five_bar_circle.toml", low, "reference.speed=1", "limits.joint_speed=1"), ("five_bar_circle.toml", low, *mit, "limits.joint_speed=0.7"),
                                ("five_bar_circle.toml", low, *mit, "limits.joint_speed=0.5", "limits.after_halt=hold"),
                                ("five_bar_observer.toml", box % (0.0, 0.225), "limits.after_halt=hold"),
                                ("five_bar_observer.toml", box % (0.0, 0.225), "limits.after_halt=hold", "control.delay_ticks=6", "effects.compute_delay.time=0.006"),
                                *((*type2, box % (y, 0.3), f"limits.after_halt={end}") for y in (0.035, 0.06) for end in ("hold", "lower"))):
            run = esmc("hil", SCENES / scene, "--json", "--out", self.tmp / "halt", *sets(*sets_of))
            self.assertEqual([f["name"] for f in json.loads(run.stdout)["supervisor"]["faults"]], ["workspace"], (sets_of, run.stderr))
            rows = read_table(self.tmp / "halt" / "log.csv")
            self.assertTrue({r["state"] for r in rows} & {"holding", "lowering"}, sets_of)
            after = [float(r["tau11_cmd"]) for r in rows if r["state"] in ("halting", "holding", "lowering")]
            self.assertLess(max(map(abs, after)), 0.8, sets_of)
            self.assertLess(sum(a * b < 0 for a, b in zip(after, after[1:])), 12, sets_of)

if __name__ == "__main__":
    main()
