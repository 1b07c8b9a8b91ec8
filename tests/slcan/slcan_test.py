#!/usr/bin/python3
"""slcan against the back end of python3-can, over pseudo terminals. usage: ESMC SLCAN_ECHO SCENE"""
import cmath
import json
import math
import os
import random
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import can

from hub import Adapter, Hub

ESMC, ECHO, SCENE = sys.argv.pop(1), sys.argv.pop(1), sys.argv.pop(1)
PATIENCE = 120  # s, for a machine that does other things as well
SHORT = ["--set", "simulation.duration=0.3"]


def end(*programs):
    for p in programs:
        p.kill()
        p.communicate()


class Frames(unittest.TestCase):
    def messages(self):
        """Every kind, length and end of range, and many between."""
        shuffled = random.Random(5)
        for extended, top in ((False, 0x7FF), (True, 0x1FFFFFFF)):
            for identifier in (0, 1, 0x12A, top - 1, top, *(shuffled.randrange(top) for _ in range(8))):
                for length in range(9):
                    data = bytes(shuffled.randrange(256) for _ in range(length))
                    yield can.Message(arbitration_id=identifier, is_extended_id=extended, data=data)
                    if extended or identifier != 0x7FF:
                        yield can.Message(arbitration_id=identifier, is_extended_id=extended, is_remote_frame=True, dlc=length)

    def test_both_ways_byte_for_byte(self):
        adapter = Adapter()
        echo = subprocess.Popen([ECHO, adapter.path, "1000000"])
        self.addCleanup(end, echo)
        # The greeting: its last command is heard before the first frame goes out, or the opening's flush would take it.
        adapter.until_program_said(b"O\r")
        self.assertEqual(adapter.program, b"C\rS8\rO\r")
        for sent in self.messages():
            adapter.bus.send(sent)
            heard = None
            while heard is None:  # the greeting is no frame
                heard = adapter.bus.recv(PATIENCE)
            self.assertTrue(heard.equals(sent, timestamp_delta=None), f"{sent} {heard}")
        echoed = adapter.program[len(b"C\rS8\rO\r"):]
        self.assertEqual(echoed, adapter.python_can.removeprefix(b"C\rS8\rO\rO\r"))
        self.assertEqual(echoed.count(b"\r"), len(list(self.messages())))
        adapter.bus.send(can.Message(arbitration_id=0x7FF, is_extended_id=False, is_remote_frame=True, dlc=0))
        self.assertEqual(echo.wait(PATIENCE), 0)
        adapter.until_program_said(b"\rC\r")
        adapter.close()

    def test_sockets_and_their_end(self):
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder, "line"))
            for kind, where in ((socket.AF_UNIX, path), (socket.AF_INET, ("127.0.0.1", 0))):
                with socket.socket(kind, socket.SOCK_STREAM) as server:
                    server.bind(where)
                    server.listen()
                    endpoint = "unix:" + path if kind == socket.AF_UNIX else "tcp:127.0.0.1:%d" % server.getsockname()[1]
                    echo = subprocess.Popen([ECHO, endpoint, "250000"])
                    self.addCleanup(end, echo)
                    line, _ = server.accept()
                    with line, line.makefile("rb") as heard:
                        self.assertEqual(heard.read(7), b"C\rS5\rO\r")
                        line.sendall(b"\r\r\rt02e41122aabb\rgarbage\rR1FFFFFFF5\r")
                        self.assertEqual(heard.read(25), b"t02E41122AABB\rR1FFFFFFF5\r")
                        line.shutdown(socket.SHUT_WR)
                        self.assertEqual(heard.read(), b"")
                    self.assertEqual(echo.wait(PATIENCE), 0)


class Loop(unittest.TestCase):
    def esmc(self, *arguments):
        program = subprocess.Popen([ESMC, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, program)
        return program

    def finished(self, program):
        out, err = program.communicate(timeout=PATIENCE)
        self.assertEqual(program.returncode, 0, err)
        return json.loads(out)

    def reference(self, *options):
        return json.loads(subprocess.run([ESMC, "hil", SCENE, "--json", *SHORT, *options], capture_output=True, text=True, check=True).stdout)

    def joined(self):
        adapters = Adapter(), Adapter()
        return *adapters, Hub(*adapters)

    def test_two_processes_give_the_digest_of_one(self):
        one, other, hub = self.joined()
        plant = self.esmc("plant", SCENE, "--json", *SHORT, "--bus", "slcan:" + one.path)
        controller = self.esmc("controller", SCENE, "--json", *SHORT, "--bus", "slcan:" + other.path)
        summary, seen = self.finished(plant), self.finished(controller)
        wanted = self.reference()
        self.assertEqual(summary["digest"], wanted["digest"])
        self.assertEqual(summary["ticks"], 300)
        self.assertEqual(seen["supervisor"]["faults"], [])
        self.assertGreater(min(hub.frames), 600)  # two motors, 300 ticks

    def swapped(self, scene, *sets, nodes="[2, 1]"):
        """(Ticks of the plant, what the controller complains of), of a controller that takes each node for the other."""
        one, other, _ = self.joined()
        # A pose that is not its own mirror image.
        sets = [a for s in ("drives.sign_test=true", "initial.position=[0.05, 0.17]", "reference.join=0.1", *sets) for a in ("--set", s)]
        plant = self.esmc("plant", scene, "--json", *SHORT, *sets, "--bus", "slcan:" + one.path)
        controller = self.esmc("controller", scene, "--json", *SHORT, *sets, "--set", f"drives.nodes={nodes}", "--bus", "slcan:" + other.path)
        _, said = controller.communicate(timeout=PATIENCE)
        if "refused to arm" in said:
            end(plant)
            return 0, said
        return json.loads(plant.communicate(timeout=PATIENCE)[0])["ticks"], said

    def test_nodes_that_are_swapped_as_a_whole(self):
        """Seen where that makes another mechanism; of two equal legs that turn alike it is the same one, in a mirror."""
        text = Path(SCENE).read_text()
        leg = next(line for line in text.splitlines() if line.startswith("leg = "))[len("leg = "):]
        with tempfile.TemporaryDirectory() as folder:
            unlike = Path(folder, "unlike.toml")
            for number, other in (("m2 = 0.1", "m2 = 0.3"), ("l1 = 0.12", "l1 = 0.15")):
                unlike.write_text(text.replace("leg = " + leg, f"legs = [{leg}, {leg.replace(number, other)}]"))
                ticks, said = self.swapped(str(unlike))
                self.assertEqual((ticks, said), (0, "esmc: the controller refused to arm: sign_test\n"), other)
            for offset in ("[0.0, 0.0]", "[0.5, 0.5]"):
                ticks, said = self.swapped(SCENE, "drives.direction=[1, -1]", f"drives.offset={offset}")
                self.assertRegex(said, "refused to arm: (working_mode|loop_not_closed|sign_test)\n", offset)
        for nodes in ("[1, 2]", "[2, 1]"):
            self.assertEqual(self.swapped(SCENE, nodes=nodes), (300, ""), nodes)
        short = self.swapped(SCENE, "simulation.duration=0.02", nodes="[1, 2]")
        self.assertEqual(short, (20, "esmc: the sign test was not over within simulation.duration\n"), "nothing was shown")

    def test_hil_with_two_adapters_gives_the_same(self):
        one, other, _ = self.joined()
        with tempfile.TemporaryDirectory() as folder:
            hil = self.esmc("hil", SCENE, "--json", *SHORT, "--bus", f"slcan:{one.path},{other.path}", "--out", folder)
            self.assertEqual(self.finished(hil)["digest"], self.reference()["digest"])
            self.assertIn(" slcan ", Path(folder, "frames.log").read_text().splitlines()[0])

    def test_an_adapter_that_goes_ends_the_run(self):
        for command in (["controller", SCENE], ["plant", SCENE], ["drive", "--protocol", "odrive"],
                        ["controller", SCENE, "--observe", "--set", "simulation.duration=100.0"]):
            with self.subTest(command=command[0]), tempfile.TemporaryDirectory() as folder:
                path = str(Path(folder, "line"))
                with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as server:
                    server.bind(path)
                    server.listen()
                    program = self.esmc(*command, "--bus", "slcan:unix:" + path)
                    line, _ = server.accept()
                    with line:
                        self.assertEqual(line.recv(2), b"C\r")
                out, err = program.communicate(timeout=PATIENCE)
                self.assertEqual(program.returncode, 1, out + err)
                self.assertEqual(err, "esmc: the slcan adapter is gone: unplugged, or closed at its other end\n")

    def test_a_drive_answers_and_takes_commands(self):
        adapter = Adapter(bitrate=500000)
        drive = self.esmc("drive", "--protocol", "odrive", "--node", "3", "--watchdog", "10", "--json", "--bitrate", "500000", "--bus", "slcan:" + adapter.path)
        heartbeats = 0
        while heartbeats < 3:
            message = adapter.bus.recv(PATIENCE)
            heartbeats += message is not None and message.arbitration_id == 3 << 5 | 0x01
        self.assertTrue(adapter.program.startswith(b"C\rS6\rO\r"))
        adapter.bus.send(can.Message(arbitration_id=3 << 5 | 0x07, is_extended_id=False, data=(8).to_bytes(4, "little")))
        armed = False
        while not armed:
            message = adapter.bus.recv(PATIENCE)
            armed = message is not None and message.arbitration_id == 3 << 5 | 0x01 and message.data[4] == 8
        drive.send_signal(signal.SIGINT)
        summary = self.finished(drive)
        self.assertEqual(summary["frames"]["commands"], 1)
        self.assertTrue(summary["state"]["closed_loop"])
        adapter.close()


class Observe(unittest.TestCase):
    def observed(self, nodes, *sets):
        adapter = Adapter()
        program = subprocess.Popen([ESMC, "controller", SCENE, "--bus", f"slcan:{adapter.path}", "--observe", "--json",
                                    "--set", "simulation.duration=1.0", *sets], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(end, program)
        adapter.until_program_said(b"O\r")
        while program.poll() is None:
            for node, angle in nodes.items():
                data = struct.pack("<ff", angle / (2 * math.pi), 0.25)
                adapter.bus.send(can.Message(arbitration_id=node << 5 | 0x09, is_extended_id=False, data=data))
            time.sleep(0.002)
        out, error = program.communicate(timeout=PATIENCE)
        adapter.until_program_said(b"O\rC\r")
        self.assertEqual(adapter.program, b"C\rS8\rO\rC\r", "nothing but the adapter's own commands")
        return program.returncode, json.loads(out), error

    def test_it_sees_the_mechanism_and_says_nothing(self):
        status, j, error = self.observed({1: 0.339146, 2: 1.312760})  # at the start of the circle: (0.07, 0.17)
        self.assertEqual((status, error), (0, ""))
        self.assertEqual([(q["name"], q["node"]) for q in j["joints"]], [("theta11", 1), ("theta21", 2)])
        self.assertAlmostEqual(j["joints"][0]["angle"], 0.339146, delta=1e-6)
        self.assertAlmostEqual(j["joints"][1]["rate"], 0.25 * 2 * math.pi, delta=1e-6)
        self.assertAlmostEqual(j["effector"][0], 0.07, delta=1e-5)
        self.assertAlmostEqual(j["effector"][1], 0.17, delta=1e-5)
        # Of the assembly mode base encoders say nothing: it is the scene's.
        self.assertEqual((j["working_mode"], j["assembly_mode"], j["assumed_assembly_mode"]), (["+", "+"], None, "-"))

    def test_passive_encoders_show_the_assembly_mode_that_is_there(self):
        sensors = ["--set", 'control.sensors="all"', "--set", "sensors.nodes=[3,4]"]
        there = {1: 0.339146, 2: 1.312760}
        tip = complex(0.07, 0.17)
        elbows = self.elbows(there)
        along = (elbows[1] - elbows[0]) / abs(elbows[1] - elbows[0])
        mirrored = elbows[0] + along * ((tip - elbows[0]) / along).conjugate()  # across the line between the elbows
        for effector, assembly in ((tip, "-"), (mirrored, "+")):
            bars = (effector - elbows[0], -(effector - elbows[1]).conjugate())  # leg 2 in its mirrored frame
            passive = [cmath.phase(b / cmath.exp(1j * there[i + 1])) for i, b in enumerate(bars)]
            status, j, error = self.observed({**there, 3: passive[0], 4: passive[1]}, *sensors)
            self.assertEqual((status, error), (0, ""))
            self.assertEqual((j["assembly_mode"], j["assumed_assembly_mode"]), (assembly, None))
            self.assertAlmostEqual(j["effector"][0], effector.real, delta=1e-5)
            self.assertAlmostEqual(j["effector"][1], effector.imag, delta=1e-5)

    def elbows(self, base):
        l0, l1 = 0.05, 0.12
        return l0 + l1 * cmath.exp(1j * base[1]), -l0 - (l1 * cmath.exp(1j * base[2])).conjugate()

    def test_without_a_confirmed_zero_there_is_no_pose(self):
        status, j, _ = self.observed({1: 0.1, 2: 0.2}, "--set", 'drives.zero="pose"')
        self.assertEqual((status, j["zero"], j["effector"]), (0, "not confirmed", None))

    def test_a_silent_drive_is_named(self):
        status, j, error = self.observed({1: 0.339146})
        self.assertEqual(status, 1)
        self.assertRegex(error, r"^esmc: not heard on \S+: node 2\n$")
        self.assertIsNone(j["effector"])


class Refused(unittest.TestCase):
    def refused(self, *arguments, words=(), **how):
        run = subprocess.run([how.pop("esmc", ESMC), *arguments], capture_output=True, text=True, timeout=PATIENCE, **how)
        self.assertEqual((run.returncode, run.stdout), (2, ""), run.stderr)
        self.assertEqual(run.stderr.count("\n"), 1, run.stderr)
        for word in words:
            self.assertIn(word, run.stderr)

    def test_endpoints(self):
        with tempfile.TemporaryDirectory() as folder:
            closed = Path(folder, "closed")
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as nobody:
                nobody.bind(str(closed))
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                nobody_listens = "tcp:127.0.0.1:%d" % free.getsockname()[1]
                for endpoint, words in (
                        ("", ["--bus slcan:", "allowed are"]), ("/dev/ttyNoSuch0", ["/dev/ttyNoSuch0", "No such file"]),
                        ("/dev/ttyNoSuch0@115200", ["No such file"]), ("/dev/ttyACM0@1200", ["@1200", "115200"]),
                        ("/dev/null", ["no serial line"]), (SCENE, ["no serial line"]), (folder, ["no serial line"]),
                        (str(closed), ["no serial line", "unix:"]), ("unix:", ["path is missing"]),
                        ("unix:/no/such", ["No such file"]), (f"unix:{closed}", ["refused"]), ("unix:/" + "x" * 200, ["too long"]),
                        ("tcp:", ["HOST:PORT"]), ("tcp:localhost", ["HOST:PORT"]), ("tcp::1", ["HOST:PORT"]),
                        (nobody_listens, ["refused"]), ("tcp:127.0.0.1:nosuchport", ["tcp:"])):
                    for command in (["plant", SCENE], ["controller", SCENE], ["drive", "--protocol", "mit"]):
                        with self.subTest(endpoint=endpoint, command=command[0]):
                            self.refused(*command, "--bus", "slcan:" + endpoint, words=words)

    def test_hil_wants_two_adapters(self):
        for endpoints in ("/dev/ttyACM0", "/dev/ttyACM0,", ",/dev/ttyACM0", "a,b,c"):
            for options in ([], ["--realtime"]):
                self.refused("hil", SCENE, *options, "--bus", "slcan:" + endpoints, words=["slcan:PLANT,CONTROLLER", endpoints])
        self.refused("hil", SCENE, "--bus", "slcan:/dev/ttyNoSuch0,/dev/ttyNoSuch1", words=["/dev/ttyNoSuch0", "No such file"])

    def test_one_adapter_is_for_one_program(self):
        adapter = Adapter()
        holder = subprocess.Popen([ECHO, adapter.path, "1000000"])
        self.addCleanup(end, holder)
        adapter.until_program_said(b"O\r")
        self.refused("plant", SCENE, "--bus", "slcan:" + adapter.path, words=["another program"])
        self.refused("hil", SCENE, "--bus", f"slcan:{adapter.path},{adapter.path}", words=["another program"])

    def test_bit_rates_that_slcan_has_no_command_for(self):
        for rate in ("33333", "83333", "750000"):
            self.refused("plant", SCENE, "--bus", "slcan:/dev/ttyACM0", "--set", f"bus.bitrate={rate}", words=[rate, "bit/s"])
            self.refused("drive", "--protocol", "odrive", "--bus", "slcan:/dev/ttyACM0", "--bitrate", rate, words=[rate])

    def test_no_permission(self):
        adapter = Adapter()
        os.chmod(adapter.path, 0)
        with tempfile.TemporaryDirectory() as folder:
            os.chmod(folder, 0o755)
            program, scene = (shutil.copy(f, folder) for f in (ESMC, SCENE))
            nobody = {"user": 65534} if os.getuid() == 0 else {}
            self.refused("plant", scene, "--bus", "slcan:" + adapter.path, words=["Permission denied", "dialout"], esmc=program, **nobody)
        adapter.close()

    def test_against_the_clock_drives_behind_a_serial_line_are_real_until_confirmed(self):
        adapter = Adapter()
        self.refused("controller", SCENE, "--realtime", "--bus", "slcan:" + adapter.path, words=["drives.confirmed", "drives.nodes moves the joint", "encoders are absolute"])
        adapter.close()


if __name__ == "__main__":
    unittest.main()
