#!/usr/bin/env python3
"""What is read back from ODrives before they are armed, and what must be confirmed. usage: drives_test.py ESMC"""
import json

from command import CIRCLE, Case, esmc, main, sets

TYPES = {"axis0.config.enable_watchdog": "bool", "axis0.config.watchdog_timeout": "float",
         "axis0.controller.config.control_mode": "uint8", "axis0.controller.config.input_mode": "uint8",
         "axis0.controller.config.enable_torque_mode_vel_limit": "bool", "axis0.controller.config.vel_limit": "float",
         "axis0.controller.config.enable_overspeed_error": "bool", "axis0.config.motor.torque_constant": "float",
         "axis0.config.motor.current_soft_max": "float", "axis0.config.can.heartbeat_msg_rate_ms": "uint32"}


class Drives(Case):
    def setUp(self):
        super().setUp()
        self.scene = self.tmp / "s.toml"
        self.scene.write_text(CIRCLE.read_text())
        self.table = {"fw_version": "0.6.10", "endpoints": {p: {"id": 300 + 7 * i, "type": t} for i, (p, t) in enumerate(TYPES.items())}}
        self.write()

    def write(self):
        (self.tmp / "flat.json").write_text(json.dumps(self.table))

    def hil(self, *values):
        return self.document("hil", self.scene, *sets("simulation.duration=0.1", *values))

    def bad(self, *values, words, code=2):
        self.refused(esmc("hil", self.scene, *sets("simulation.duration=0.1", *values)), *words, code=code)

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
        self.bad("drives.torque_mismatch=0.05", 'drives.protocol="odrive_0.5"', words=["'drives.torque_mismatch' must be 0"])

    def test_the_scene_as_run_finds_its_endpoints(self):
        out = self.tmp / "out"
        run = esmc("hil", self.scene, "--set", "drives.endpoints=flat.json", "--set", "simulation.duration=0.1", "--out", out)
        self.assertEqual(run.returncode, 0, run.stderr)
        (self.tmp / "flat.json").rename(self.tmp / "away.json")
        self.assertEqual(esmc("hil", out / "scene.toml").returncode, 0)
        again = esmc("replay", out)
        self.assertEqual(again.returncode, 0, again.stdout + again.stderr)

    def test_what_is_wrong_with_the_table(self):
        self.bad("drives.endpoints=none.json", words=["'drives.endpoints' names no regular file: "])
        self.bad("drives.endpoints=flat.json", "drives.protocol=odrive_0.5", words=["is for firmware 0.6"])
        good = json.dumps(self.table)
        for old, new, words in (('"fw_version"', '"version"', "without fw_version"), ('0.6.10', '0.6', "without fw_version"),
                                ('0.6.10', '0.6.300', "without fw_version"),
                                ('"id": 300', '"id": 65536', "enable_watchdog has no id"), ('"id": 300', '"id": -1', "has no id"),
                                ('"type": "float"', '"type": "int32"', "has another type"),
                                ('"endpoints"', '"points"', "not the vendor's flat_endpoints.json"), ('}', '', "not the vendor's"),
                                ('{', '[', "not the vendor's")):
            self.assertIn(old, good)
            (self.tmp / "flat.json").write_text(good.replace(old, new))
            self.bad("drives.endpoints=flat.json", words=[words])

    def test_what_must_be_confirmed(self):
        no = "drives.confirmed=false"
        self.bad(no, words=["s.toml:", "'drives.confirmed' must be true", "enable_torque_mode_vel_limit is off", "torque_constant"])
        self.bad(no, "drives.protocol=mit", words=["torque_range are the drives'"])
        self.bad(no, "drives.protocol=cia402", words=["object 6076", "6064 counts"])
        self.hil("drives.confirmed=true")
        self.bad(no, "drives.endpoints=flat.json", words=["torque_constant is the motor's", "current limit"])
        del self.table["endpoints"]["axis0.controller.config.vel_limit"]
        self.write()
        self.bad(no, "drives.endpoints=flat.json", "drives.torque_constant=0.1", words=["vel_limit above"])
        del self.table["endpoints"]["axis0.config.can.heartbeat_msg_rate_ms"]
        self.write()
        self.bad(no, "drives.endpoints=flat.json", "drives.torque_constant=0.1", words=["heartbeats come every 10 ms at most"])

    def test_drives_as_delivered_are_refused_by_what_was_read_back(self):
        """All of it can be read back, so that nothing is left to confirm; and confirmed = false also makes them as delivered."""
        self.bad("drives.confirmed=false", "drives.endpoints=flat.json", "drives.torque_constant=0.1", code=1,
                 words=["refused to arm: drive_configuration", "(node 1, axis0.config.enable_watchdog)"])


if __name__ == "__main__":
    main()
