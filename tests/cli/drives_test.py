#!/usr/bin/env python3
"""What is read back from ODrives before they are armed, and what must be confirmed. usage: drives_test.py ESMC SCENE"""
import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

ESMC = SCENE = ""
TYPES = {"axis0.config.enable_watchdog": "bool", "axis0.config.watchdog_timeout": "float",
         "axis0.controller.config.control_mode": "uint8", "axis0.controller.config.input_mode": "uint8",
         "axis0.controller.config.enable_torque_mode_vel_limit": "bool", "axis0.controller.config.vel_limit": "float",
         "axis0.controller.config.enable_overspeed_error": "bool", "axis0.config.motor.torque_constant": "float",
         "axis0.config.motor.current_soft_max": "float", "axis0.config.can.heartbeat_msg_rate_ms": "uint32"}


def esmc(*args):
    return subprocess.run([ESMC, *map(str, args)], capture_output=True, text=True, timeout=120)


class Drives(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.scene = Path(self.folder.name, "s.toml")
        self.scene.write_text(Path(SCENE).read_text())
        self.table = {"fw_version": "0.6.10", "endpoints": {p: {"id": 300 + 7 * i, "type": t} for i, (p, t) in enumerate(TYPES.items())}}
        self.write()

    def tearDown(self):
        self.folder.cleanup()

    def write(self):
        Path(self.folder.name, "flat.json").write_text(json.dumps(self.table))

    def hil(self, *sets, status=0, words=()):
        args = [a for s in sets for a in ("--set", s)]
        run = esmc("hil", self.scene, "--json", "--set", "simulation.duration=0.1", *args)
        self.assertEqual(run.returncode, status, run.stderr)
        for w in words:
            self.assertIn(w, run.stderr)
        if status == 0:
            return json.loads(run.stdout)
        self.assertEqual(run.stderr.count("\n"), 1, run.stderr)

    def test_configured_drives_are_read_back_and_armed(self):
        plain = self.hil()
        read = self.hil("drives.endpoints=flat.json", "drives.torque_constant=0.08")
        self.assertEqual(read["digest"], plain["digest"], "nothing but the time of arming")
        self.assertEqual(read["bus"]["frames"] > plain["bus"]["frames"] + 2 * 2 * 11 - 1, True, "eleven questions to each of two")

    def test_tracking_begins_after_the_sign_test(self):
        duration = "simulation.duration=0.6"
        plain, tested = self.hil(duration), self.hil(duration, "drives.sign_test=true")
        self.assertLess(tested["tracking"]["settled_max_m"], 2 * plain["tracking"]["settled_max_m"])
        self.assertIsNone(self.hil("drives.sign_test=true", "simulation.duration=0.02")["tracking"], "nothing but the test")

    def test_drives_that_say_their_torque(self):
        plain, said = self.hil(), self.hil("drives.torque_mismatch=0.05", "drives.torque_time=0")
        self.assertEqual(said["digest"], plain["digest"], "they only say more")
        self.assertGreaterEqual(said["bus"]["frames"], plain["bus"]["frames"] + 2 * 10, "one of each in ten ticks")
        self.hil("drives.torque_mismatch=0.05", 'drives.protocol="odrive_0.5"', status=2, words=["'drives.torque_mismatch' must be 0"])

    def test_the_scene_as_run_finds_its_endpoints(self):
        out = Path(self.folder.name, "out")
        run = esmc("hil", self.scene, "--set", "drives.endpoints=flat.json", "--set", "simulation.duration=0.1", "--out", out)
        self.assertEqual(run.returncode, 0, run.stderr)
        (Path(self.folder.name) / "flat.json").rename(Path(self.folder.name) / "away.json")
        self.assertEqual(esmc("hil", out / "scene.toml").returncode, 0)
        again = esmc("replay", out)
        self.assertEqual(again.returncode, 0, again.stdout + again.stderr)

    def test_what_is_wrong_with_the_table(self):
        self.hil("drives.endpoints=none.json", status=2, words=["'drives.endpoints' names no regular file: "])
        self.hil("drives.endpoints=flat.json", "drives.protocol=odrive_0.5", status=2, words=["is for firmware 0.6"])
        good = json.dumps(self.table)
        for old, new, words in (('"fw_version"', '"version"', "without fw_version"), ('0.6.10', '0.6', "without fw_version"),
                                ('0.6.10', '0.6.300', "without fw_version"),
                                ('"id": 300', '"id": 65536', "enable_watchdog has no id"), ('"id": 300', '"id": -1', "has no id"),
                                ('"type": "float"', '"type": "int32"', "has another type"),
                                ('"endpoints"', '"points"', "not the vendor's flat_endpoints.json"), ('}', '', "not the vendor's"),
                                ('{', '[', "not the vendor's")):
            self.assertIn(old, good)
            Path(self.folder.name, "flat.json").write_text(good.replace(old, new))
            self.hil("drives.endpoints=flat.json", status=2, words=[words])

    def test_what_must_be_confirmed(self):
        no = "drives.confirmed=false"
        self.hil(no, status=2, words=["s.toml:", "'drives.confirmed' must be true", "enable_torque_mode_vel_limit is off", "torque_constant"])
        self.hil(no, "drives.protocol=mit", status=2, words=["torque_range are the drives'"])
        self.hil(no, "drives.protocol=cia402", status=2, words=["object 6076", "6064 counts"])
        self.hil("drives.confirmed=true")
        self.hil(no, "drives.endpoints=flat.json", status=2, words=["torque_constant is the motor's", "current limit"])
        del self.table["endpoints"]["axis0.controller.config.vel_limit"]
        self.write()
        self.hil(no, "drives.endpoints=flat.json", "drives.torque_constant=0.1", status=2, words=["vel_limit above"])
        del self.table["endpoints"]["axis0.config.can.heartbeat_msg_rate_ms"]
        self.write()
        self.hil(no, "drives.endpoints=flat.json", "drives.torque_constant=0.1", status=2, words=["heartbeats come every 10 ms at most"])

    def test_drives_as_delivered_are_refused_by_what_was_read_back(self):
        """All of it can be read back, so that nothing is left to confirm; and confirmed = false also makes them as delivered."""
        self.hil("drives.confirmed=false", "drives.endpoints=flat.json", "drives.torque_constant=0.1", status=1,
                 words=["refused to arm: drive_configuration", "(node 1, axis0.config.enable_watchdog)"])


if __name__ == "__main__":
    ESMC, SCENE = sys.argv[1:3]
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
