#!/usr/bin/env python3
"""esmc replay: recorded runs are equal to the last bit when they are repeated; one bit that is not is found and named; what is
no recording is refused.
usage: replay_test.py ESMC [unittest args]"""
import json
import os
import shutil
import signal
import subprocess
import time

from cable import Cable
from command import ARM, CIRCLE, ESMC, Case, esmc, main

SHORT = ("--set", "simulation.duration=0.05")
NOISY = ('effects=[{type="noise", sigma=1e-4}, {type="viscous_friction", coefficient=[0.01, 0.01]}, {type="encoder", bits=14}]')


class Replay(Case):
    def cable(self, name):
        (self.tmp / name).mkdir()
        cable = Cable(self.tmp / name)
        self.addCleanup(cable.close)
        return cable.paths

    def record(self, *args, status=0):
        out = self.tmp / f"run{len(list(self.tmp.iterdir()))}"
        run = esmc(*args, "--out", out)
        self.assertEqual(run.returncode, status, run.stderr)
        return out

    def equal(self, out, *words):
        before = {p.name: p.read_bytes() for p in out.iterdir()}
        text = esmc("replay", out)
        self.assertEqual((text.returncode, text.stderr), (0, ""), text.stdout)
        self.assertEqual(len(text.stdout.splitlines()), 1)
        for word in ("equal to the last bit", *words):
            self.assertIn(word, text.stdout)
        result = json.loads(esmc("replay", out, "--json").stdout)
        self.assertIs(result["equal"], True)
        self.assertEqual(result["differences"], [])
        self.assertEqual({p.name: p.read_bytes() for p in out.iterdir()}, before, "a replay writes nothing")
        return result

    def differs(self, out, *words):
        text = esmc("replay", out)
        self.assertEqual((text.returncode, text.stderr), (1, ""), text.stdout)
        self.assertTrue(text.stdout.startswith("not equal: "), text.stdout)
        for word in words:
            self.assertIn(word, text.stdout.splitlines()[0])
        document = esmc("replay", out, "--json")
        self.assertEqual(document.returncode, 1)
        result = json.loads(document.stdout)
        self.assertIs(result["equal"], False)
        return result["differences"]

    def bad(self, out, *words):
        self.refused(esmc("replay", out), *words)

    def edited(self, out, name, edit):
        copy = self.tmp / f"copy{len(list(self.tmp.iterdir()))}"
        shutil.copytree(out, copy)
        data = (copy / name).read_bytes()
        (copy / name).write_bytes(edit(data))
        return copy

    def test_runs_of_every_kind_are_equal(self):
        digest = json.loads((self.record("sim", CIRCLE, *SHORT) / "summary.json").read_text())["digest"]
        self.equal(self.record("sim", CIRCLE, *SHORT), digest, "50 ticks")
        result = self.equal(self.record("hil", CIRCLE, *SHORT), "50 ticks", "frames")
        self.assertGreater(result["frames"], 200)
        for args in (("sim", ARM, *SHORT, "--seed", "77", "--set", NOISY),
                     ("hil", CIRCLE, *SHORT, "--seed", "9", "--set", NOISY),
                     ("hil", CIRCLE, *SHORT, "--scalar", "float"),
                     ("hil", ARM, *SHORT, "--set", 'drives.protocol="mit"'),
                     ("hil", CIRCLE, *SHORT, "--set", "drives.protocol=moteus"),
                     ("hil", CIRCLE, *SHORT, "--seed", "3", "--set", 'effects=[{type="bit_timing"}, {type="loss", probability=0.001}]'),
                     ("sim", CIRCLE, *SHORT, "--set", 'control.law="none"'),
                     ("sim", CIRCLE, "--set", "simulation={duration=0.02, accuracy=1e-8}")):
            with self.subTest(args=args):
                self.equal(self.record(*args))

    def test_a_run_that_ended_in_a_fault_is_equal(self):
        self.equal(self.record("hil", CIRCLE, *SHORT, "--set", "limits.joint_speed=3.0", status=1))

    def test_an_interrupted_run_is_equal(self):
        out = self.tmp / "long"
        run = subprocess.Popen([ESMC, "hil", str(CIRCLE), "--set", "simulation.duration=1000.0", "--out", str(out)], stdout=subprocess.DEVNULL)
        while not list(out.glob(".partial-*/log.csv")) or next(out.glob(".partial-*/log.csv")).stat().st_size < 100000:
            time.sleep(0.01)
        run.send_signal(signal.SIGINT)
        self.assertEqual(run.wait(60), 130)
        self.assertTrue(json.loads((out / "summary.json").read_text())["interrupted"])
        self.equal(out)

    def test_one_bit_is_found_and_named(self):
        out = self.record("hil", CIRCLE, *SHORT)
        frames = (out / "frames.log").read_text().splitlines()
        torque = [i for i, line in enumerate(frames) if " 02E#" in line][30]

        def flip(data):
            lines = data.decode().splitlines()
            line = lines[torque]
            lines[torque] = line[:-1] + f"{int(line[-1], 16) ^ 1:X}"
            return ("\n".join(lines) + "\n").encode()

        before = frames[torque].split()[2]
        after = before[:-1] + f"{int(before[-1], 16) ^ 1:X}"
        [found] = self.differs(self.edited(out, "frames.log", flip), f"frames.log:{torque + 1}: tick ", "frame 02E", f"recorded {after}, computed {before}")
        stamp = float(frames[torque].split(")")[0][1:])
        self.assertEqual((found["line"], found["tick"]), (torque + 1, int(stamp * 1000 + 1e-6)))

        row = (out / "log.csv").read_text().splitlines()[21].split(",")
        header = (out / "log.csv").read_text().splitlines()[0].split(",")
        at = header.index("theta11")
        digit = str((int(row[at][-1]) + 1) % 10)

        def other(data):
            lines = data.decode().splitlines()
            lines[21] = ",".join(row[:at] + [row[at][:-1] + digit] + row[at + 1:])
            return ("\n".join(lines) + "\n").encode()

        [found] = self.differs(self.edited(out, "log.csv", other), "log.csv:22: tick 20: theta11: recorded ")
        self.assertEqual((found["computed"], found["tick"]), (row[at], 20))
        digest = json.loads((out / "summary.json").read_text())["digest"]
        wrong = digest[:-1] + f"{int(digest[-1], 16) ^ 1:x}"
        [found] = self.differs(self.edited(out, "summary.json", lambda d: d.replace(digest.encode(), wrong.encode())), "summary.json: digest: ", wrong, digest)
        self.assertIsNone(found["tick"])

    def test_frames_beyond_the_end_and_another_seed_are_found(self):
        out = self.record("hil", CIRCLE, *SHORT, "--seed", "5", "--set", NOISY)
        last = (out / "frames.log").read_bytes().splitlines()[-1]
        self.differs(self.edited(out, "frames.log", lambda d: d + last + b"\n"), "frames.log:", "the repeated run ends")
        found = self.differs(self.edited(out, "summary.json", lambda d: d.replace(b'"seed": 5', b'"seed": 6')), "frames.log:", "frame ")
        self.assertEqual([d["file"] for d in found[:2]], ["frames.log", "log.csv"])
        self.assertIn("digest", [d["what"] for d in found])

    def test_what_is_no_recording_is_refused(self):
        out = self.record("hil", CIRCLE, *SHORT)
        self.bad(self.tmp / "nowhere", "no such directory")
        self.bad(out / "log.csv", "no such directory")
        empty = self.tmp / "empty"
        empty.mkdir()
        self.bad(empty, "summary.json: there is no such file")
        for name in ("summary.json", "scene.toml", "log.csv", "frames.log"):
            copy = self.edited(out, name, lambda d: d)
            (copy / name).unlink()
            self.bad(copy, f"{name}: there is no such file")
            (copy / name).mkdir()
            self.bad(copy, f"{name}: is not a regular file")
            (copy / name).rmdir()
            os.mkfifo(copy / name)  # would wait for ever
            self.bad(copy, f"{name}: is not a regular file")
        for name, edit, words in (
                ("frames.log", lambda d: b"", ["no frames"]),
                ("frames.log", lambda d: d[:-3], ["torn"]),
                ("frames.log", lambda d: d[:len(d) // 2].rsplit(b"\n", 1)[0] + b"\n", ["frames were counted"]),
                ("frames.log", lambda d: d.replace(b"#", b"!", 1), [":1: ", "candump"]),
                ("frames.log", lambda d: b"\0\xff" * 50 + b"\n" + d, [":1: ", "candump"]),
                ("log.csv", lambda d: d[:-3], ["torn"]),
                ("log.csv", lambda d: d.rsplit(b"\n", 2)[0] + b"\n", ["50 ticks"]),
                ("log.csv", lambda d: b"", ["has 0 lines"]),
                ("scene.toml", lambda d: d.replace(b"0.07", b"0.06", 1), ["not the scene that was run"]),
                ("summary.json", lambda d: d[:100], ["no JSON document"]),
                ("summary.json", lambda d: b"[]", ["/run/command is missing"]),
                ("summary.json", lambda d: d.replace(b'"run"', b'"ran"'), ["/run/command is missing"]),
                ("summary.json", lambda d: d.replace(b'"command": "hil"', b'"command": "live"'), ["allowed are sim, hil"]),
                ("summary.json", lambda d: d.replace(b'"seed": 1', b'"seed": -1.5'), ["/seed"]),
                ("summary.json", lambda d: d.replace(b'"version": "', b'"version": "0.0.'), ["recorded by esmc 0.0.", "--any-version"])):
            with self.subTest(name=name, words=words):
                self.bad(self.edited(out, name, edit), *words)
        newer = self.edited(out, "summary.json", lambda d: d.replace(b'"version": "', b'"version": "0.0.'))
        self.assertEqual(esmc("replay", newer, "--any-version").returncode, 0)

        def of_before(document):  # 0.2.0 named faults, and had neither verdict nor schema
            was = json.loads(document)
            del was["verdict"], was["schema"]
            was["supervisor"]["faults"] = [f["name"] for f in was["supervisor"]["faults"]]
            return json.dumps(was).encode()

        for run in (out, self.record("hil", CIRCLE, *SHORT, "--set", "limits.joint_speed=0.1", status=1)):
            again = esmc("replay", self.edited(run, "summary.json", of_before), "--any-version")
            self.assertEqual((again.returncode, again.stderr), (0, ""), again.stdout)
        check = self.tmp / "check"
        esmc("check", CIRCLE, "--out", check)
        self.bad(check, "summary.json: there is no such file")

    def test_the_files_that_a_scene_names_belong_to_the_recording(self):
        (self.tmp / "path.csv").write_text("t,x,y\n0,0.07,0.17\n0.05,0.069,0.172\n0.1,0.07,0.174\n")
        scene = self.tmp / "file.toml"
        scene.write_text(esmc("init", "five_bar").stdout)
        out = self.record("sim", scene, *SHORT, "--set", 'reference={type="file", path="path.csv"}', "--set", "initial={at=\"reference\"}")
        self.equal(out)
        self.bad(self.edited(out, "scene_reference.csv", lambda d: d.replace(b"0.172", b"0.173")), "not the scene that was run")
        believed = self.tmp / "believed.toml"
        believed.write_text(scene.read_text().replace("l1 = 0.12", "l1 = 0.121"))
        self.assertNotEqual(believed.read_text(), scene.read_text())
        out = self.record("hil", scene, *SHORT, "--set", 'control.model.mechanism="believed.toml"')
        self.assertEqual((out / "scene_model.toml").read_text(), believed.read_text())
        believed.unlink()
        self.equal(out)
        for name, edit in (("scene_model.toml", lambda d: d.replace(b"0.121", b"0.122")), ("scene.toml", lambda d: d + b"\n")):
            self.bad(self.edited(out, name, edit), "not the scene that was run")
        (out / "scene_model.toml").unlink()
        self.bad(out, "not the scene that was run")

    def test_two_processes(self):
        paths = self.cable("cable")
        outs = [self.tmp / "plant", self.tmp / "controller"]
        runs = [subprocess.Popen([ESMC, name, str(CIRCLE), *SHORT, "--set", NOISY, "--bus", f"slcan:unix:{path}", "--out", str(out)],
                                 stdout=subprocess.DEVNULL) for name, path, out in zip(("plant", "controller"), paths, outs)]
        for run in runs:
            self.assertEqual(run.wait(120), 0)
        plant, controller = outs
        self.equal(plant, "plant", json.loads((plant / "summary.json").read_text())["digest"])
        self.assertIsNone(self.equal(controller, "controller, 50 ticks")["digest"])
        self.bad(self.edited(controller, "frames.csv", lambda d: d.rsplit(b"\n", 2)[0] + b"\n"), "frames.csv: has")
        self.bad(self.edited(controller, "frames.csv", lambda d: d.replace(b",1,0", b",2,0", 1)), "frames.csv:", "allowed is")
        self.bad(self.edited(controller, "summary.json", lambda d: d.replace(b'"lost": 0', b'"lost": 1')), "/bus/lost")
        # A torque that the controller has not computed; a sample that it would have answered otherwise.
        lines = (controller / "frames.log").read_bytes().splitlines()
        torque = [i for i, line in enumerate(lines) if b" 02E#" in line][40]
        sample = [i for i, line in enumerate(lines) if b" 029#" in line and i < torque][-1]
        answer = next(i for i, line in enumerate(lines) if b" 02E#" in line and i > sample)

        def flip(at, digit):
            def edit(data):
                line = lines[at]
                place = line.index(b"#") + 1 + digit
                changed = line[:place] + b"%X" % (int(line[place:place + 1], 16) ^ 1) + line[place + 1:]
                return b"\n".join(lines[:at] + [changed] + lines[at + 1:]) + b"\n"
            return edit

        [found] = self.differs(self.edited(controller, "frames.log", flip(torque, 1)), f"frames.log:{torque + 1}: tick", "frame 02E")
        self.assertEqual(found["computed"], lines[torque].split()[2].decode())
        found = self.differs(self.edited(controller, "frames.log", flip(sample, 4)), "frames.log:", ": tick", "frame 0")
        self.assertIn(found[0]["line"] - 1, (answer, answer + 1))  # one of the motors may be at its limit
        self.assertIn("log.csv", [d["file"] for d in found])

    def in_real_time(self, turn):
        """One run in two processes and one in one; the folders they left."""
        place = self.tmp / f"turn{turn}"
        place.mkdir()
        paths = self.cable(f"turn{turn}/cable")
        outs = [place / "plant", place / "controller", place / "both"]
        patient = [a for v in ("drives.heartbeat_timeout=2.0", "drives.watchdog_timeout=2.0", "limits.max_age_ticks=100", "control.rate_hz=200",
                               "simulation.duration=0.2", "drives.confirmed=true", "drives.watchdog_test=false", "drives.sign_test=false",
                               'reference={type="hold", position=[0.07, 0.17]}') for a in ("--set", v)]
        # Drives that end first leave the controller's last orders on the cable.
        runs = [subprocess.Popen([ESMC, name, str(CIRCLE), *patient, "--set", f"simulation.duration={seconds}", "--realtime", "--bus", f"slcan:unix:{path}",
                                  "--out", str(out)], stdout=subprocess.DEVNULL)
                for name, seconds, path, out in zip(("plant", "controller"), (0.5, 0.2), paths, outs)]
        for run in runs:
            run.wait(120)
        esmc("hil", CIRCLE, *patient, "--realtime", "--bus", "slcan:unix:" + ",unix:".join(self.cable(f"turn{turn}/other")), "--out", outs[-1])
        return outs

    def test_real_time(self):
        left = {"plant", "controller", "both"}
        for turn in range(24):
            for out in self.in_real_time(turn):
                self.assertTrue((out / "summary.json").is_file(), "the run itself has failed")
                if json.loads((out / "summary.json").read_text())["bus"]["lost"]:  # a cable that had no turn on this machine
                    if out.name != "both":
                        self.assertIn("/bus/lost", esmc("replay", out).stderr)
                elif out.name in left:
                    self.equal(out)
                    left.discard(out.name)
            if not left:
                return
        self.fail(f"no run without lost frames: {left}")

    def test_ctrl_c_and_help(self):
        out = self.record("sim", CIRCLE, "--set", "simulation.duration=30.0")
        for patience in (0.2, 0.8, 3.2):  # a loaded machine has not always begun by then
            run = subprocess.Popen([ESMC, "replay", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            time.sleep(patience)
            run.send_signal(signal.SIGINT)
            stdout, stderr = run.communicate(timeout=60)
            if run.returncode != -signal.SIGINT:
                break
        if run.returncode != 0:  # else it was the faster one
            self.assertEqual((run.returncode, stdout), (130, ""))
            self.assertIn("not compared to the end", stderr)
        self.assertIn("DIR", esmc("replay", "--help").stdout)
        self.assertEqual(esmc("replay").returncode, 2)


if __name__ == "__main__":
    main()
