#!/usr/bin/python3
"""`esmc operate` against `esmc controller` and `esmc plant`: three processes on one bus, every frame heard by this program.
usage: operate_test.py ESMC SCENE slcan [--sample COUNT] | slcan BOARD | INTERFACE [BOARD] [unittest args]
BOARD: the program of boards/linux, or an image (.elf) for QEMU, with SCENE in it
Nothing depends on the clock: waits end when what they wait for has come, and reactions are counted in the controller's ticks."""
import json
import math
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / folder) for folder in ("link", "support")]
from buses import Interface, SlcanHub  # noqa: E402
from sample import drawn, take_option  # noqa: E402
from supervisor import STATES, crc8  # noqa: E402

SAMPLE = take_option(sys.argv)
ESMC, SCENE, WHERE = sys.argv.pop(1), sys.argv.pop(1), sys.argv.pop(1)
BOARD = str(Path(sys.argv.pop(1)).resolve()) if len(sys.argv) > 1 and Path(sys.argv[1]).is_file() else None
PATIENCE = 120  # s, of a busy machine
BASE = 0x780
COMMAND_LOST, FOREIGN = 26, 11
SETS = [a for s in ("control.law=esmc", "control.reaching=implicit", "control.lambda=5.0", "control.gain=20.0", "command.lambda=[1.0, 40.0]",
                    "command.gain=[5.0, 100.0]", "command.speed=0.2", "command.acceleration=1.0", "limits.workspace={ x = [-0.15, 0.15], y = [0.05, 0.26] }",
                    "command.timeout=2.0", "reference.speed=1.0", "simulation.duration=900") for a in ("--set", s)]
# Of the drives' joints: without it the mechanism would drift for ever once there is no torque.
FRICTION = ["--set", 'effects=[{type="viscous_friction", coefficient=[0.02, 0.02]}]']
SETS += FRICTION
RATE = 100 if WHERE == "slcan" else 25  # Hz; in a user-mode kernel a call may take a quarter of a millisecond
HOMING_RATE = min(RATE, 50)  # an angle that moves on for more than 4 ticks while a busy machine does not run the loop is a feedback_jump
SETS += ["--set", f"control.rate_hz={RATE}"]
SILENCE = 2 * RATE  # ticks: command.timeout


class Ear:
    """What the controller says, in its order: Status as they come, and the tick of the last frame of a console."""

    def __init__(self):
        self.lock = threading.Condition()
        self.statuses = []  # (tick, state, fault)
        self.console = []   # (index of the Status before, identifier)
        self.session = 0

    def hear(self, identifier, data):
        with self.lock:
            if identifier == BASE + 0x10 and len(data) == 8 and crc8(identifier, data[7], data) == data[0]:
                self.session = data[7]
                self.statuses.append((int.from_bytes(data[4:7], "little"), STATES[data[1] >> 4], data[2]))
                self.lock.notify_all()
            if BASE <= identifier < BASE + 6:
                self.console.append((len(self.statuses) - 1, identifier))
                self.lock.notify_all()

    def wait(self, wanted, what):
        """Until `wanted()`, looked at for every Status."""
        with self.lock:
            if not self.lock.wait_for(wanted, PATIENCE):
                raise AssertionError(f"no {what}: {self.statuses[-3:]}")

    def state(self, state, after=0):
        self.wait(lambda: len(self.statuses) > after and self.statuses[-1][1] == state, state)


class Bench(unittest.TestCase):
    sets, board = SETS, None

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.ear = Ear()
        self.wire = SlcanHub(self.ear.hear) if WHERE == "slcan" else Interface(WHERE, self.ear.hear)
        self.addCleanup(self.wire.close)
        long = self.wire.bus if ":" in self.wire.bus else "socketcan:" + self.wire.bus
        self.plant = self.start("plant", SCENE, "--bus", long, "--realtime", *self.sets)
        if self.board and self.board.endswith(".elf"):
            # An instruction is 8 ns of the image's time, and the emulator waits for nobody.
            self.controller = self.start("-M", "mps2-an386", "-display", "none", "-monitor", "none", "-icount", "shift=3,sleep=off", "-kernel", self.board,
                                         "-serial", self.wire.bus.removeprefix("slcan:"), program="qemu-system-arm")
        elif self.board:
            self.controller = self.start(self.wire.bus, program=self.board)
        else:
            self.controller = self.start("controller", SCENE, "--bus", long, "--realtime", *self.sets,
                                         "--out", Path(self.folder.name, "controller"))
        self.ear.wait(lambda: self.ear.statuses, "Status")

    def start(self, *arguments, program=ESMC):
        log = open(Path(self.folder.name, f"{arguments[0]}{time.monotonic_ns()}"), "w+", encoding="utf-8")
        self.addCleanup(log.close)
        running = subprocess.Popen([program, *map(str, arguments)], stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT)
        running.log = log

        def end():
            running.kill()
            running.wait()
        self.addCleanup(end)
        return running

    def said(self, program):
        program.log.seek(0)
        return program.log.read()

    def console(self, *words, stdin="", scene=True, sets=None, options=()):
        """(exit status, standard output, standard error) of a call."""
        where = [SCENE, *(sets or self.sets)] if scene else []
        r = subprocess.run([ESMC, "operate", self.wire.bus, *where, *options, *words], input=stdin, capture_output=True, text=True, timeout=PATIENCE)
        return r.returncode, r.stdout, r.stderr

    def good(self, *words, **more):
        code, out, err = self.console(*words, **more)
        self.assertEqual(code, 0, (words, out, err))
        return out

    def assertAt(self, out, *points):
        """`out` tells that these points, m, were reached, in this order: within 3e-6, as the console itself judges."""
        told = [tuple(map(float, line.split()[1:])) for line in out.replace("\r", "").splitlines() if line.startswith("at ") and "limit" not in line]
        self.assertEqual(len(told), len(points), out)
        for got, wanted in zip(told, points):
            self.assertTrue(all(abs(a - b) <= 4e-6 for a, b in zip(got, wanted)), (wanted, out))

    def refused(self, name, *words, code=1, **more):
        got, out, err = self.console(*words, **more)
        self.assertEqual((got, err.count("\n")), (code, 1), (words, out, err))
        self.assertTrue(err.startswith("esmc: " + name), (words, err))

    def status(self, **more):
        return json.loads(self.good("status", options=["--json"], **more))

    def places(self):
        """Of the effector, one after the other."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            yield self.status()["effector"]

    def armed(self):
        console = self.start("operate", self.wire.bus, SCENE, *self.sets, "arm")
        self.ear.wait(lambda: self.ear.statuses[-1][1] == "running" or console.poll() is not None, "running")
        self.assertIsNone(console.poll(), self.said(console))
        return console


class Operate(Bench):
    def test_a_day_of_an_operator(self):
        first = self.status()
        self.assertEqual((first["schema"], first["state"], first["fault"], first["faults"]), (1, "disabled", "none", []))
        self.assertEqual(self.status(scene=False)["scene"], first["scene"])
        self.assertIn("disabled, fault none", self.good("status", scene=False))
        self.assertEqual(first["parameters"]["lambda_angle"], {"value": 5.0, "writable": True})
        self.assertAlmostEqual(first["effector"][0], 0.07, 3)

        # Gains, within bounds; both kinds, or one.
        self.good("set", "control.lambda", "7.5")
        self.good("set", "control.gain.angle", "30")
        values = {k: v["value"] for k, v in self.status()["parameters"].items()}
        self.assertEqual([values[k] for k in ("lambda_position", "lambda_angle", "gain_position", "gain_angle")], [7.5, 7.5, 20.0, 30.0])
        self.refused("out_of_bounds", "set", "control.lambda", "41")
        self.refused("read_only", "set", "torque_limit_1", "1")
        self.refused("no_store", "store")

        # What is not allowed here, and what nobody can mean.
        self.refused("not_armed", stdin="hold\n")
        self.refused("not_armed", stdin="goto 0 0.2\n")
        self.refused("other_scene", "status", sets=[*SETS, "--set", "control.lambda=6.0"])
        for words in (["set", "control.lambda", "nan"], ["set", "control.nonsense", "1"], ["set", "control.lambda"], ["goto", "1"], ["goto", "a", "1"],
                      ["jog", "z", "1"], ["jog", "x", "0.1", "-1"], ["fly"], ["override", "101"], ["override", "-1"], ["override", "nan"], ["override", "2.5"], ["status", "now"], ["goto", "inf", "0"]):
            self.assertEqual(self.console(*words)[0], 2, words)
        self.assertEqual(self.status()["state"], "disabled")

        # A script: the console is one process, which keeps the sign of life.
        out = self.good(stdin="# to two points\narm\ngoto 0.05 0.2\ngoto -0.02 0.2\njog y -0.02 1\nhold\nstatus\nhalt\n")
        self.assertAt(out, (0.05, 0.2), (-0.02, 0.2))
        self.assertIn("running, fault none, source stream", out)
        x, y = map(float, out.split("holds near ", 1)[1].split()[:2])
        self.assertTrue(abs(x + 0.02) < 1e-3 and 0.17 < y < 0.195, (x, y))
        self.ear.state("disabled")

        # One call: it arms, moves, brings to rest.
        self.assertAt(self.good("goto", "0.03", "0.18"), (0.03, 0.18))
        self.assertEqual(self.status()["state"], "disabled")
        self.assertAlmostEqual(self.status()["effector"][0], 0.03, 2)
        self.refused("out_of_bounds", "goto", "0.03", "0.27")
        self.refused("out_of_bounds", "goto", "9", "0")
        self.refused("out_of_bounds", "jog", "x", "0.3")
        self.refused("other_space", "jog", "1", "0.1", scene=False)
        self.refused("out_of_bounds", "jog", "1", "9", "0.1")
        self.assertEqual(self.status()["state"], "disabled")
        # Up to the limit of the scene, and no further: no fault.
        self.assertIn("at the scene's limit", self.good("jog", "y", "0.1", "30"))
        self.assertEqual((self.status()["state"], self.status()["fault"]), ("disabled", "none"))

    def file(self, name, reference, scene=None):
        """SCENE with another reference."""
        text = scene or Path(SCENE).read_text(encoding="utf-8")
        begin = text.index("[reference]")
        path = Path(self.folder.name, name)
        path.write_text(text[:begin] + "[reference]\n" + reference + text[text.index("\n[", begin):], encoding="utf-8")
        return path

    def ends_at(self, out, x, y):
        at = [float(v) for v in out.split("end of the path: ", 1)[1].split()[:2]]
        self.assertTrue(abs(at[0] - x) < 5e-6 and abs(at[1] - y) < 5e-6, out)

    def test_streams_that_the_console_converts_and_plans(self):
        """A joint, where the controller takes x and y; a line and a program of another file."""
        before = [j["angle"] for j in self.status()["joints"]]
        self.good("jog", "theta11", "0.2", "1")
        moved = [j["angle"] - a for j, a in zip(self.status()["joints"], before)]
        self.assertTrue(0.05 < moved[0] < 0.4 and abs(moved[-1]) < 0.03, moved)

        line = self.file("line.toml", 'type = "line"\nfrom = [0.05, 0.18]\nto = [-0.02, 0.2]\nduration = 2.0\n')
        out = self.good("run", line)
        self.assertIn("at 0.050000 0.180000", out)
        self.ends_at(out, -0.02, 0.2)
        program = self.file("program.toml", 'type = "program"\nfrom = [0.0, 0.2]\n[[reference.moves]]\nmove = "line"\nto = [0.05, 0.2]\nspeed = 0.1\n'
                            'acceleration = 0.5\njerk = 5.0\n[[reference.moves]]\nmove = "arc"\nvia = [0.06, 0.19]\nto = [0.05, 0.18]\nspeed = 0.1\nacceleration = 0.5\njerk = 5.0\n')
        self.ends_at(self.good("run", program), 0.05, 0.18)
        self.assertEqual((self.status()["state"], self.status()["fault"]), ("disabled", "none"))

        # What the controller would not take is refused before anything moves.
        self.refused("out_of_bounds", "run", self.file("fast.toml", 'type = "line"\nfrom = [0.05, 0.18]\nto = [-0.02, 0.2]\nduration = 0.2\n'))
        self.refused("out_of_bounds", "run", self.file("far.toml", 'type = "line"\nfrom = [0.05, 0.18]\nto = [-0.1, 0.04]\nduration = 9.0\n'))
        other = Path(SCENE).read_text(encoding="utf-8").replace("m1 = 0.1", "m1 = 0.2")
        self.refused("other_scene", "run", self.file("other.toml", 'type = "line"\nfrom = [0.05, 0.18]\nto = [-0.02, 0.2]\nduration = 2.0\n', other))
        for file in (self.file("round.toml", 'type = "circle"\ncenter = [0.0, 0.17]\nradius = 0.02\nspeed = 1.0\n'), "missing.toml"):
            self.assertEqual(self.console("run", file)[0], 2, file)
        self.assertEqual(self.console("run", line, scene=False)[0], 2)
        self.assertEqual(self.status()["state"], "disabled")

        # A console that dies in the middle of it.
        slow = self.file("slow.toml", 'type = "line"\nfrom = [0.05, 0.18]\nto = [-0.02, 0.2]\nduration = 600.0\n')
        begin = len(self.ear.console)
        run = self.start("operate", self.wire.bus, SCENE, *SETS, "run", slow)
        self.ear.wait(lambda: len([1 for c in self.ear.console[begin:] if c[1] == BASE + 3]) > 50 and self.ear.statuses[-1][1] == "running", "samples")
        run.kill()
        run.wait()
        self.lost(min(SILENCE, 100))
        self.good("reset")

    def test_the_last_ticks(self):
        """Of a run that ends in a fault, against what the controller itself has logged."""
        folder = Path(self.folder.name)
        console = self.armed()
        self.refused("not_now", "capture", folder / "early")
        self.good("goto", "0.05", "0.18")
        armed = self.ear.statuses[-1][0]
        self.ear.wait(lambda: self.ear.statuses[-1][0] > armed + 2 * RATE, "Status")  # arming is further back than is kept
        self.good("goto", "0.04", "0.18")
        self.wire.send(BASE + 0x15, bytes(8))
        console.wait(PATIENCE)
        self.ear.state("fault")
        self.good("capture", folder / "ticks")
        self.good("capture", folder / "ticks")  # again, and the same
        self.good("reset")
        self.good("capture", folder / "later")
        text = (folder / "ticks/capture.csv").read_text(encoding="ascii")
        self.assertEqual((folder / "later/capture.csv").read_text(encoding="ascii"), text)
        names = text.splitlines()[0].split(",")
        ticks = [dict(zip(names, line.split(","))) for line in text.splitlines()[1:]]
        self.assertEqual(len(ticks), 2 * RATE)
        self.assertEqual({int(b["tick"]) - int(a["tick"]) for a, b in zip(ticks, ticks[1:])}, {1})
        self.assertEqual((ticks[-1]["state"], ticks[-1]["fault"]), ("fault", "foreign_controller"))
        running = [k for k in ticks if k["state"] == "running"]
        self.assertEqual(len(ticks) - len(running), 2 * RATE // 8 + 1)
        self.assertEqual({k["fault"] for k in running}, {"none"})
        self.assertTrue(any(k["obeyed"] == "1" for k in running))

        # The end of the controller's log, as it leaves it at Ctrl-C.
        self.controller.send_signal(signal.SIGINT)
        self.controller.wait(PATIENCE)
        log = (folder / "controller/log.csv").read_text(encoding="ascii").splitlines()
        columns = log[0].split(",")
        rows = [dict(zip(columns, line.split(","))) for line in log[1:]]
        rows = [r for r in rows if r["state"] == "running"][-len(running):]
        self.assertEqual(len(rows), len(running))
        step = 2.0 / 32767  # control.torque_limit
        half = 0.51e-6 + 0.125e-6  # of a microradian, and of what a float of 2 to 4 million resolves
        for kept, row in zip(running, rows):
            for i, joint in ((1, "theta11"), (2, "theta21")):
                self.assertAlmostEqual(float(kept[f"angle{i}"]), float(row[joint]), delta=half)
            for i in (1, 2):
                self.assertAlmostEqual(float(kept[f"tau{i}"]), float(row[f"tau{i}1"]), delta=0.51 * step)
            for x in "xy":
                self.assertAlmostEqual(float(kept[x + "_error"]), float(row[x + "_ref"]) - float(row[x]), delta=half)
        self.assertGreater(max(abs(float(k["tau1"])) for k in running), 10 * step)

    def test_two_consoles_and_how_they_end(self):
        first = self.armed()
        self.assertAt(self.good("goto", "0.05", "0.18"), (0.05, 0.18))
        self.good("hold")
        self.refused("not_now", "set", "control.lambda", "8")
        self.refused("not_now", "zero")
        self.refused("not_now", "arm")
        self.refused("not_now", "override", "50")
        self.assertEqual(self.status()["state"], "running")
        self.good("halt")
        self.assertEqual(first.wait(PATIENCE), 0, self.said(first))
        self.assertEqual(self.status()["state"], "disabled")

        second = self.armed()
        second.send_signal(signal.SIGINT)
        self.assertEqual(second.wait(PATIENCE), 130, self.said(second))
        self.ear.state("disabled")

        third = self.armed()
        self.good("off", scene=False)
        self.assertEqual(third.wait(PATIENCE), 0, self.said(third))
        self.ear.state("disabled")

        # Its own source of motion, until it is ended.
        fourth = self.start("operate", self.wire.bus, SCENE, *SETS, "run")
        self.ear.state("running")
        self.assertEqual(self.status()["source"], "reference")
        self.refused("not_now", "goto", "0.05", "0.2")
        # Slower, at rest on its path, on from there; a hold ends with the run, the percentage does not.
        self.refused("not_now", "resume")
        self.assertEqual(self.status()["pace"], "full")
        self.good("override", "30")
        self.assertEqual(self.status()["pace"], "reduced")
        self.good("hold")
        self.assertEqual(self.status()["pace"], "held")
        places = self.places()
        here = next(a for a, b in zip(places, places) if math.dist(a, b) < 1e-5)
        self.assertAlmostEqual(math.dist(here, (0.0, 0.17)), 0.07, 3)
        self.good("resume")
        next(p for p in self.places() if math.dist(here, p) > 1e-3)
        self.good("halt")
        self.assertEqual(fourth.wait(PATIENCE), 0, self.said(fourth))
        self.assertEqual(self.status()["pace"], "reduced")
        self.refused("not_now", "override", "0")
        self.good("override", "100")

        # Jog as long as somebody holds it: here, until the input ends.
        jog = subprocess.Popen([ESMC, "operate", self.wire.bus, SCENE, *SETS, "jog", "x", "-0.01"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.addCleanup(jog.kill)
        self.ear.wait(lambda: self.ear.console[-1][1] == BASE + 3 and len([1 for c in self.ear.console if c[1] == BASE + 3]) > 150, "samples")
        out, _ = jog.communicate(timeout=PATIENCE)
        self.assertEqual(jog.returncode, 0, out)
        self.assertEqual((self.status()["state"], self.status()["fault"]), ("disabled", "none"))

    def test_points(self):
        """Taught where it stands, without torque and under it; kept in a file that people may edit."""
        file = Path(self.folder.name, "mine.toml")
        keep = ["--points", str(file)]
        self.assertEqual(self.good("points", options=keep), "")
        self.assertIn("start = 0.07", self.good("teach", "start", options=keep))
        out = self.good(stdin="arm\ngoto 0.05 0.2\nteach over\ngoto start\ngoto over\nhalt\n", options=keep)
        told = [line for line in out.splitlines() if line.startswith("at ")]
        start = [float(v) for v in re.search(r"start = (\S+) (\S+)", self.good("points", options=keep)).groups()]
        self.assertAt("\n".join(told), (0.05, 0.2), start, (0.05, 0.2))
        text = file.read_text(encoding="ascii")
        self.assertRegex(text, """space = ["']effector["']""")
        file.write_text(text + "by-hand = [0.03, 0.18]\n", encoding="ascii")
        self.assertEqual(len(self.good("points", options=keep).splitlines()), 3)
        self.assertAt(self.good("goto", "by-hand", options=keep), (0.03, 0.18))
        self.refused("there is no point 'nowhere'", "goto", "nowhere", code=2, options=keep)
        for name in ("", "1a", "a b", "a\nb", "ä", "x" * 33, "../x"):
            self.assertEqual(self.console("teach", name, options=keep)[0], 2, name)
        for bad in ('space = "effector"\n[points]\nx = [1.0]\n', 'space = "base_joints"\n', 'space = "effector"\n[points]\nx = [nan, 0.0]\n',
                    'space = "effector"\nmore = 1\n', "what", 'space = "effector"\n[points]\n"1a" = [0.0, 0.1]\n'):
            file.write_text(bad, encoding="ascii")
            self.refused(str(file), "points", code=2, options=keep)
        self.good("halt", options=keep)  # whatever the file says
        self.assertEqual(self.status()["state"], "disabled")
        file.unlink()
        self.plant.kill()
        deadline = time.monotonic() + PATIENCE
        while self.status()["effector"] is not None:
            self.assertLess(time.monotonic(), deadline, "a pose without samples")
        self.refused("not_now: the controller has no pose", "teach", "gone", options=keep)
        self.assertFalse(file.exists())
        self.refused("points are kept", "teach", "here", code=2, scene=False)

    def lost(self, ticks):
        """The console has gone silent: rest, by the controller's own count of ticks."""
        begin = len(self.ear.statuses)
        self.ear.state("fault", begin)
        statuses = self.ear.statuses
        last = statuses[self.ear.console[-1][0]][0]
        found = next(s for s in statuses[self.ear.console[-1][0]:] if s[2])
        self.assertEqual(found[2], COMMAND_LOST)
        # One tick for the frame, one for the Status; more where this program may hear a frame later than the controller does.
        slack = 3 if WHERE == "slcan" else 15
        self.assertLessEqual((found[0] - last) % 2**24, ticks + slack, (last, found))
        self.assertGreaterEqual((found[0] - last) % 2**24, ticks - slack, (last, found))
        rest = next(s for s in statuses[self.ear.console[-1][0]:] if s[1] == "fault")
        self.assertLessEqual((rest[0] - found[0]) % 2**24, 2 * RATE, (found, rest))  # limits.halt_time: 2 s

    def test_dead_and_stopped_consoles(self):
        console = self.armed()
        self.good("goto", "0.05", "0.18")
        console.kill()
        console.wait()
        self.lost(SILENCE)
        status = self.status()
        self.assertEqual((status["state"], status["fault"], status["faults"][0]["name"]), ("fault", "command_lost", "command_lost"))
        self.refused("command_lost", "arm")
        self.refused("command_lost", "goto", "0.05", "0.2")
        self.assertIn("acknowledges command_lost", self.good("reset"))
        self.assertIn("no fault", self.good("reset"))

        console = self.armed()
        console.send_signal(signal.SIGSTOP)
        self.lost(SILENCE)
        console.send_signal(signal.SIGCONT)
        self.assertEqual(console.wait(PATIENCE), 1)
        self.assertIn("esmc: command_lost", self.said(console))
        self.good("reset")

        # In the middle of a jog the stream is missed, or the sign of life, whichever is first.
        jog = self.start("operate", self.wire.bus, SCENE, *SETS, "jog", "x", "-0.002", "600")
        self.ear.wait(lambda: len([1 for c in self.ear.console if c[1] == BASE + 3]) > 50 and self.ear.statuses[-1][1] == "running", "samples")
        jog.kill()
        jog.wait()
        self.lost(min(SILENCE, 100))  # command.stream_age_ticks
        self.good("reset")

    def test_a_fault_and_forged_frames(self):
        console = self.armed()
        self.wire.send(BASE + 0x15, bytes(8))  # a second controller
        self.assertEqual(console.wait(PATIENCE), 1)
        self.assertIn("esmc: foreign_controller", self.said(console))
        self.assertEqual(self.status()["fault"], "foreign_controller")
        self.refused("foreign_controller", "run")
        self.assertIn("acknowledges foreign_controller", self.good("reset"))

        # Replays, forged sessions and noise on the way to the controller: counted, and nothing else; the console goes on.
        console = self.armed()
        for n in range(200):
            for identifier in range(BASE, BASE + 6):
                data = bytearray(os.urandom(8))
                if n % 2 == 0:  # the right checksum of another session
                    data[0] = crc8(identifier, self.ear.session % 255 + 1, data)
                elif crc8(identifier, self.ear.session, data) == data[0] or crc8(identifier, 0, data) == data[0]:
                    data[0] ^= 1
                self.wire.send(identifier, bytes(data))
        self.assertAt(self.good("goto", "0.05", "0.19"), (0.05, 0.19))
        self.assertEqual(self.status()["state"], "running")
        self.assertGreater(self.status()["frames"]["bad_crc"], 100)
        self.good("off")
        self.assertEqual(console.wait(PATIENCE), 0, self.said(console))

    def test_several_controllers_need_a_scene(self):
        over = threading.Event()

        def second():
            counter = 0
            while not over.is_set():
                counter = (counter + 1) % 16
                data = bytearray([0, counter, 0, 0, counter, 0, 0, 9])
                data[0] = crc8(0x7B0, 9, data)
                self.wire.send(0x7B0, bytes(data))
                over.wait(0.05)
        thread = threading.Thread(target=second)
        thread.start()
        try:
            self.refused("several controllers", "status", code=2, scene=False)
            self.assertIn("0x780, 0x7a0", self.console("status", scene=False)[2])
            self.assertEqual(self.status()["state"], "disabled")
        finally:
            over.set()
            thread.join()

    def test_record(self):
        console = self.armed()
        out = Path(self.folder.name, "record")
        mcap = Path(self.folder.name, "record.mcap")
        recorder = self.start("operate", self.wire.bus, SCENE, *SETS, "--mcap", mcap, "record", out)
        self.good("goto", "0.05", "0.18")
        self.good("goto", "0.04", "0.18")
        recorder.send_signal(signal.SIGINT)
        self.assertEqual(recorder.wait(PATIENCE), 0, self.said(recorder))
        self.good("halt")
        self.assertEqual(console.wait(PATIENCE), 0)
        rows = [dict(zip(("t,x,y,x_error,y_error,angle1,tau1,angle2,tau2,angle3,tau3,angle4,tau4,fault,state").split(","), line.split(",")))
                for line in (out / "log.csv").read_text(encoding="ascii").splitlines()[1:]]
        self.assertGreater(len(rows), 10)
        self.assertEqual({r["state"] for r in rows}, {"running"})
        self.assertTrue(all(float(a["t"]) <= float(b["t"]) for a, b in zip(rows, rows[1:])))
        self.assertTrue(any(abs(float(r["x"]) - 0.05) < 5e-3 for r in rows))
        self.assertGreater((out / "frames.log").read_text(encoding="ascii").count(" 790#"), 10)
        sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "peers"))
        import mcap_test  # pylint: disable=import-outside-toplevel  # numpy takes seconds in a user-mode kernel
        if mcap_test.HERE.joinpath("node_modules/@mcap/core").exists():
            self.equal_rows(rows, mcap_test.read(mcap)[1])

    def equal_rows(self, rows, by_topic):
        """The same rows in both files: the one with topics begins with the connection."""
        names = {"/effector": ("x", "y", "x_error", "y_error"), "/joints": ("theta11", "theta21"), "/torques": ("tau11", "tau21")}
        told = [tuple(v[n] for topic, list_ in names.items() for v in (by_topic[topic][i][1],) for n in list_) + (state["state"],)
                for i, (_, state) in enumerate(by_topic["/controller"])]
        wanted = [tuple(struct.unpack("f", struct.pack("f", float(r[n])))[0] for n in ("x", "y", "x_error", "y_error", "angle1", "angle2", "tau1", "tau2")) +
                  (r["state"],) for r in rows]
        first = next((i for i in range(len(told)) if told[i:i + len(wanted)] == wanted), None)
        self.assertIsNotNone(first, (told[:2], wanted[:2]))
        self.assertGreater(len(by_topic["/can"]), len(told))

    def test_a_prompt_at_a_terminal(self):
        """With completion and history."""
        if b"libedit" not in Path(ESMC).read_bytes():
            self.skipTest("a build without libedit")
        ours, theirs = pty.openpty()
        console = subprocess.Popen([ESMC, "operate", self.wire.bus, SCENE, *SETS], stdin=theirs, stdout=theirs, stderr=theirs, env={**os.environ, "TERM": "xterm"})
        self.addCleanup(console.kill)
        os.close(theirs)
        heard = ""

        def until(text):
            nonlocal heard
            end = time.monotonic() + PATIENCE
            while text not in heard:
                self.assertLess(time.monotonic(), end, (text, heard))
                if select.select([ours], [], [], 1)[0]:
                    heard += os.read(ours, 4096).decode()
            heard = heard[heard.index(text) + len(text):]
        until("disabled> ")
        os.write(ours, b"stat\t\n")
        until("disabled, fault none")
        os.write(ours, b"fly\n")
        until("there is no command 'fly'")
        os.write(ours, b"arm\n")
        until("running> ")
        os.write(ours, b"\x1b[A\n")  # the line before, again
        until("not_now")
        os.write(ours, b"goto 0.05 0.18\n")
        until("at 0.0")  # 0.05, or 0.049999 in a rounded last digit
        until("running> ")  # between two lines the terminal would take this character for another one
        os.write(ours, b"\x04")  # the end of the input
        self.assertEqual(console.wait(PATIENCE), 0)
        os.close(ours)
        self.ear.state("disabled")


class BaseJoints(Bench):
    """Where the scene's reference is of base joints, so are set points and samples."""
    sets = [*SETS, "--set", "limits.workspace={ x = [-0.2, 0.2], y = [0.1, 0.3] }", "--set",
            'reference={type="joint_sine", offset=[1.6, 1.6], amplitude=[0.05, 0.05], omega=[1.0, 1.0], join=1.0}']

    def test_goto_and_jog(self):
        out = self.good(stdin="arm\ngoto 1.7 1.5\njog theta11 -0.1 1\njog 2 0.1 1\nhalt\n")
        a, b = map(float, out.split("at ", 1)[1].split()[:2])
        self.assertTrue(abs(a - 1.7) < 0.02 and abs(b - 1.5) < 0.02, out)
        a, b = map(float, out.rsplit("holds near ", 1)[1].split()[:2])
        self.assertTrue(abs(a - 1.6) < 0.06 and abs(b - 1.6) < 0.06, out)
        x, y = self.status()["effector"]
        self.good("jog", "x", "-0.005", "1")
        after = self.status()["effector"]
        self.assertTrue(-0.01 < after[0] - x < -0.002 and abs(after[1] - y) < 1e-3, (x, y, after))
        self.refused("not_now", stdin="run\ngoto 1.7 1.5\n")
        self.assertEqual((self.status()["state"], self.status()["fault"]), ("disabled", "none"))


class Unattended(Bench):
    """The scene's own reference goes on without a console, and nothing else does."""
    sets = [*SETS, "--set", "reference.unattended=true", "--set", "reference.speed=0.2"]

    def test_unattended_reference(self):
        self.assertIn("running unattended", self.good("run"))
        begin = len(self.ear.statuses)
        self.ear.wait(lambda: len(self.ear.statuses) > begin + 3 * SILENCE, "Status")
        self.assertEqual(self.ear.statuses[-1][1:], ("running", 0))
        self.good("halt")
        self.ear.state("disabled")
        console = self.armed()  # for set points
        console.kill()
        console.wait()
        begin = len(self.ear.statuses)
        self.ear.state("fault", begin)
        self.assertEqual(self.status()["fault"], "command_lost")
        self.good("reset")
        self.refused("other_scene", "status", sets=SETS)


class Homing(Bench):
    """Drives that count from where they were switched on, and base joints with end stops."""
    stops = (0.631942, 1.155262)  # rad: joint 1 moves up to its stop, joint 2 down

    @staticmethod
    def with_stops(stops, *more, met=True):
        upper, lower = (stops[0], stops[1]) if met else (9.0, -9.0)
        effects = ('effects=[{type="viscous_friction", coefficient=[0.02, 0.02]}, '
                   f'{{type="end_stops", lower=[-9.0, {lower}], upper=[{upper}, 9.0]}}]')
        return [*SETS, *[a for v in (effects, 'drives.zero="end_stop"', f"drives.zero_pose=[{stops[0]}, {stops[1]}]", "drives.homing_speed=[0.2, -0.2]",
                                     "drives.homing_torque=[0.1, 0.1]",
                                     f"control.rate_hz={HOMING_RATE}", *more) for a in ("--set", v)]]
    sets = with_stops(stops)

    def homing(self):
        """A console in the midst of it."""
        console = self.start("operate", self.wire.bus, SCENE, *self.sets, "home")
        self.ear.wait(lambda: self.ear.statuses[-1][1] == "testing" or console.poll() is not None, "homing")
        begin = len(self.ear.statuses)
        self.ear.wait(lambda: len(self.ear.statuses) > begin + 10, "Status")
        return console

    def test_before_and_after(self):
        first = self.status()
        self.assertFalse(first["zero_known"])
        self.assertIn("zero not confirmed", self.good("status"))
        self.assertTrue(all(abs(j["angle"]) < 1e-5 for j in first["joints"]), first)
        self.refused("not_now: the controller has no pose", "teach", "nowhere", options=["--points", str(Path(self.folder.name, "mine.toml"))])
        self.refused("zero_not_confirmed", "arm")
        self.good("reset")

        # Ended from elsewhere; by Ctrl-C; by death.
        console = self.homing()
        self.good("halt")
        self.assertEqual(console.wait(PATIENCE), 1)
        self.assertIn("esmc: not_homed", self.said(console))
        console = self.homing()
        self.refused("not_now", "home")
        console.send_signal(signal.SIGINT)
        self.assertEqual(console.wait(PATIENCE), 130, self.said(console))
        self.ear.state("disabled")
        console = self.homing()
        console.kill()
        console.wait()
        Operate.lost(self, 2 * HOMING_RATE)
        self.refused("command_lost", "home")
        self.good("reset")
        self.refused("zero_not_confirmed", "arm")
        self.good("reset")

        self.assertIn("homed", self.good("home"))
        status = self.status()
        self.assertEqual((status["state"], status["fault"], status["zero_known"]), ("disabled", "none", True))
        self.left_stops(status)
        self.assertAt(self.good("goto", "0.05", "0.18"), (0.05, 0.18))
        self.assertIn("homed", self.good("home"))  # again, from elsewhere
        self.left_stops(self.status())

    def left_stops(self, status):
        """By the back-off, 0.05 rad, and what a loop of 50 or 25 Hz needs to stop."""
        for joint, stop, way in zip(status["joints"], self.stops, (1, -1)):
            self.assertAlmostEqual((stop - joint["angle"]) * way, 0.125, delta=0.075)


class HomingArm(Homing):
    stops = (0.75, 1.5)
    arm = 'mechanism={type="rr", gravity=0.0, working_mode=["+"], leg={l1=0.12, l2=0.16, lg1=0.06, lg2=0.068, m1=0.1, m2=0.1, J1=2e-4, J2=7e-4}}'
    sets = Homing.with_stops(stops, arm)


class HomingNowhere(Homing):
    """An arm without stops."""
    sets = Homing.with_stops(HomingArm.stops, HomingArm.arm, "limits.joint_angle=[[0.0, 1.0], [1.0, 2.0]]", met=False)

    def test_before_and_after(self):
        self.refused("home_no_stop", "home")
        self.assertEqual(self.status()["fault"], "home_no_stop")
        self.good("reset")
        self.assertFalse(self.status()["zero_known"])


@unittest.skipUnless(BOARD, "no board")
class Board(Bench):
    """The program of boards/linux, or an image for a Cortex-M4F, with the scene in it, as the controller."""
    sets, board = [*FRICTION, "--set", "simulation.duration=900"], BOARD

    def test_from_arming_to_a_dead_console(self):
        first = self.status()
        self.assertEqual((first["state"], first["fault"], first["faults"]), ("disabled", "none", []))
        self.assertEqual(self.status(scene=False)["scene"], first["scene"])
        self.assertAlmostEqual(first["effector"][0], 0.07, 3)
        self.refused("no_store", "store")
        self.refused("read_only", "set", "control.lambda", "11")
        self.assertAt(self.good(stdin="arm\ngoto 0.065 0.17\njog x 0.005 1\nhold\nhalt\n"), (0.065, 0.17))
        self.ear.state("disabled")
        console = self.armed()
        console.kill()
        console.wait()
        self.ear.state("fault")
        folder = Path(self.folder.name, "ticks")
        self.good("capture", folder)
        ticks = (folder / "capture.csv").read_text(encoding="ascii").splitlines()
        self.assertEqual(len(ticks) - 1, 32 if self.board.endswith(".elf") else 64)  # ESMC_CAPTURE_TICKS of the image
        self.assertTrue(ticks[-1].endswith(",command_lost,halting") or ticks[-1].endswith(",command_lost,fault"), ticks[-1])
        self.refused("command_lost", "arm")
        self.assertIn("acknowledges command_lost", self.good("reset"))
        self.assertEqual(self.status()["state"], "disabled")

    def test_program_halt_fault_off(self):
        """The scene's reference, and every way in which it ends."""
        running = self.start("operate", self.wire.bus, SCENE, *self.sets, "run")
        self.ear.state("running")
        self.assertEqual(self.status()["source"], "reference")
        self.refused("not_now", "goto", "0.065", "0.17")
        self.good("halt")
        self.assertEqual(running.wait(PATIENCE), 0, self.said(running))
        self.assertEqual(self.status()["state"], "disabled")

        running = self.armed()
        self.wire.send(BASE + 0x15, bytes(8))  # a second controller
        self.assertEqual(running.wait(PATIENCE), 1)
        self.assertIn("esmc: foreign_controller", self.said(running))
        status = self.status()
        self.assertEqual((status["state"], status["faults"][0]["name"]), ("fault", "foreign_controller"))
        self.assertIn("acknowledges foreign_controller", self.good("reset"))

        running = self.armed()
        self.good("off")
        self.assertEqual(running.wait(PATIENCE), 0, self.said(running))
        self.assertEqual((self.status()["state"], self.status()["fault"]), ("disabled", "none"))


def cases(suite):
    return [suite.id()] if isinstance(suite, unittest.TestCase) else [name for part in suite for name in cases(part)]


def two_at_a_time(arguments):
    """Every case in a process and on a bus of its own: they mostly wait."""
    every = cases(unittest.defaultTestLoader.loadTestsFromModule(sys.modules["__main__"]))
    names = drawn([n.removeprefix("__main__.") for n in every], SAMPLE)
    with ThreadPoolExecutor(2) as pool:
        ended = list(pool.map(lambda name: subprocess.run([sys.executable, __file__, *arguments, name], text=True, stdout=subprocess.PIPE,
                                                          stderr=subprocess.STDOUT, check=False), names))
    failed = [name for name, done in zip(names, ended) if done.returncode]
    ended.sort(key=lambda done: done.returncode != 0)  # tests/run shows the last lines
    print(*(done.stdout for done in ended), f"{len(names)} cases, {len(failed)} failed: {failed}", sep="\n")
    return 1 if failed or not names else 0


if __name__ == "__main__":
    if WHERE == "slcan" and len(sys.argv) == 1 and not BOARD:
        sys.exit(two_at_a_time([ESMC, SCENE, WHERE]))
    unittest.main(verbosity=2)
