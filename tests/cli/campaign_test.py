#!/usr/bin/env python3
"""esmc campaign from outside: the contract of its document, the same result whatever the number of threads, replay,
and as many episodes as fit into a test run, without a violation. Usage: campaign_test.py ESMC EPISODES [--sample COUNT]"""

import json

from command import ARM, CIRCLE, MORE, SAMPLE, Case, esmc, main, sample, sets

EPISODES = int(MORE.pop(0))
FAULTS = """nothing frame_loss burst_loss scattered_loss duplication delay reordering corruption not_finite denormal huge end_of_range
 wrong_length remote_frame fd_frame extended_frame frozen_sensor sensor_jump sensor_step sensor_flipped swapped_nodes
 drive_error drive_disarm drive_reset drive_silent heartbeat_lost drive_bus_off watchdog_off controller_death
 controller_late controller_bus_off commands_lost torque_lost queue_full babbling_node flood foreign_controller
 emergency_stop enable_open late_power zero_until_closed_loop computer_gone""".split()
PROTOCOLS = ("odrive", "odrive_0.5", "cia402", "mit", "moteus")
PHASES = ["arming", "joining", "running", "halting", "stopping"]


class Campaign(Case):
    def campaign(self, *arguments, code=0):
        return self.document("campaign", *arguments, code=code)

    def test_main_run(self):
        j = self.campaign("--episodes", str(EPISODES))
        self.assertTrue(j["episodes"] == EPISODES and j["violations"] == [] and not j["interrupted"], "episodes and violations")
        r = j["reaction_ms"]
        self.assertTrue(0 < r["stale_max"] <= 2.0 + 1e-9, f"stale feedback noticed in {r['stale_max']} ms")
        self.assertTrue(r["stale_max"] < r["safe_max"] <= 3.0, f"safe torque in {r['safe_max']} ms")
        self.assertTrue(9.0 < r["host_death_max"] <= 12.0, f"host death: {r['host_death_max']} ms")
        self.assertTrue(j["simulated_s"] > 0.05 * EPISODES, "simulated time")
        self.assertTrue(sorted(j["faults"]) == sorted(FAULTS), "every fault occurs, and no other")
        self.assertTrue(sum(f["episodes"] for f in j["faults"].values()) == EPISODES, "the faults' counts add up")
        phases = [sum(f["phases"][p] for f in j["faults"].values()) for p in PHASES]
        self.assertTrue(sum(phases) == EPISODES and min(phases) > EPISODES / 20, f"phases {phases}")
        self.assertTrue(sum(j["protocols"].values()) == EPISODES and min(j["protocols"][p] for p in PROTOCOLS) > EPISODES / 20, f"protocols {j['protocols']}")
        for name, f in j["faults"].items():
            self.assertTrue(sum(f["drives"]) == f["episodes"] and min(f["drives"][:2]) > f["episodes"] / 4, f"{name}: drives {f['drives']}")
            self.assertTrue(sum(f["latched"].values()) == f["episodes"], f"{name}: names add up")
        for name in ("stale", "safe", "host_death"):
            bins = j["histograms"][name]
            top = {"stale": "stale_max", "safe": "safe_max", "host_death": "host_death_max"}[name]
            self.assertTrue(sum(b["count"] for b in bins) > EPISODES / 200 and bins[-1]["up_to_ms"] >= r[top] - 1e-9, f"histogram {name}")
        for fault, name in (("not_finite", "feedback_not_finite"), ("torque_lost", "torque_mismatch")):
            self.assertTrue(j["faults"][fault]["latched"].get(name, 0) > EPISODES / 400, f"{fault} is seldom latched as {name}")

    def test_threads(self):
        one, three = (self.campaign("--episodes", "1000", "--seed", "77", "--jobs", n) for n in ("1", "3"))
        self.assertTrue(one == three, "the result depends on --jobs")

    def test_seeds_and_protocols(self):
        one, other = (self.campaign("--episodes", "1000", "--seed", n) for n in ("77", "78"))
        self.assertTrue(one["digest"] != other["digest"], "the result does not depend on --seed")
        digests = {p: self.campaign("--episodes", "300", "--protocol", p) for p in PROTOCOLS}
        self.assertTrue(all(j["violations"] == [] for j in digests.values()), "one protocol alone")
        self.assertTrue(len({j["digest"] for j in digests.values()}) >= 3, "protocols differ")

    def test_watchdogs_are_read_back(self):
        j = self.campaign("--episodes", "3000", "--protocol", "odrive")  # every other variant of its drives reads them back
        off = j["faults"]["watchdog_off"]["latched"]
        self.assertTrue(j["violations"] == [] and off["drive_configuration"] > off["none"] / 4, f"a watchdog that is off: {off}")

    def test_scenes_of_ones_own(self):
        for scene in (ARM, CIRCLE):
            j = self.campaign(scene, "--set", "simulation.step=1e-3", "--episodes", "300")
            self.assertTrue(j["violations"] == [], f"{scene}: {j['violations'][:3]}")

    def test_a_reference_that_goes_on_without_its_console(self):
        led = 'command={arm="link", source="reference", speed=0.3, acceleration=3.0, timeout=0.2}'
        for scene in ((led, "reference.unattended=true"), (led,)):
            j = self.campaign(CIRCLE, "--fault", "computer_gone", "--episodes", "120", *sets(*scene))
            self.assertEqual(j["violations"], [], scene)

    def test_a_torque_is_judged_to_the_step_of_its_frame(self):
        j = self.campaign(CIRCLE, "--protocol", "mit", "--fault", "swapped_nodes", "--episodes", "150",
                          *sets("drives.gear_ratio=[9,9]", "drives.position_range=[100,100]", "drives.velocity_range=[2000,2000]"))
        self.assertEqual(j["violations"], [])

    def test_slow_loop(self):
        slow = self.campaign(CIRCLE, "--set", "control.rate_hz=100", "--episodes", "250")["reaction_ms"]
        self.assertTrue(30.0 < slow["host_death_max"] <= 50.0, f"host death at 100 Hz: {slow['host_death_max']} ms")
        self.assertTrue(slow["stale_max"] <= 20.0 + 1e-9 and slow["safe_max"] <= 21.0, f"stale feedback at 100 Hz: {slow}")

    def test_four_motors(self):
        """Sensors of the base only: a distal drive that vanishes takes no sample away that anybody needs."""
        for protocol in PROTOCOLS:
            j = self.campaign(CIRCLE, "--protocol", protocol, "--episodes", "500", *sets('control.motors="all"', "drives.nodes=[1, 2, 3, 4]"))
            self.assertTrue(j["violations"] == [], f"four motors, {protocol}: {j['violations'][:3]}")

    def test_what_no_campaign_can_judge(self):
        disturbed = self.tmp / "disturbed.toml"
        disturbed.write_text(CIRCLE.read_text() + '\n[[effects]]\ntype = "bit_timing"\n[[effects]]\ntype = "loss"\nprobability = 0.9\n')
        self.refused(esmc("campaign", disturbed), "'bit_timing'", "campaign")
        # A beat of the drives is 10 ms: this loop ends without anybody doing anything to it.
        self.refused(esmc("campaign", CIRCLE, "--set", "drives.heartbeat_timeout=0.005"), "heartbeat_lost", code=1)

    def test_replay(self):
        runs = [self.campaign("--replay", str(2**64 - 1)) for _ in range(2)]
        self.assertTrue(runs[0] == runs[1] and runs[0]["bit_equal"] and runs[0]["seed"] == 2**64 - 1, "replay")
        text = esmc("campaign", "--replay", "5").stdout
        self.assertTrue("bit-equal" in text and text.count("\n") > 30, "replay prints its ticks")
        esmc("campaign", "--replay", "5", "--out", self.tmp / "r")
        lines = (self.tmp / "r/episode.txt").read_text().splitlines()
        self.assertTrue(len(lines) == json.loads((self.tmp / "r/episode.json").read_text())["ticks"], "a line per tick")

    def test_violations_are_told(self):
        # Drives as delivered: their watchdog is off, and they push against a speed that they find too high.
        off = ["--episodes", "400", "--protocol", "odrive", "--set", "drives.confirmed=false"]
        # Where they say their torque, what they do not give is noticed.
        self.refused(esmc("campaign", *off), "torque_mismatch before anything is done to the loop", code=1)
        off += ["--set", "drives.torque_mismatch=0"]
        j = self.campaign(*off, "--out", self.tmp / "c", code=1)
        self.assertTrue(len(j["violations"]) > 3, "a watchdog that is off is no violation")
        names = [v["invariant"] for v in j["violations"]]
        self.assertTrue(names.count("watchdog") > 0.8 * len(names) and set(names) <= {"watchdog", "safe_time", "torque_without_power", "torque_limit"}, names)
        self.assertTrue(json.loads((self.tmp / "c/campaign.json").read_text()) == j, "campaign.json")
        self.assertTrue("controller_death" in (self.tmp / "c/campaign.md").read_text(), "campaign.md")
        first = j["violations"][0]
        again = self.campaign(*off[2:], "--replay", str(first["seed"]), code=1)
        self.assertEqual([again[k] for k in ("digest", "violation_tick", "invariant", "fault")], [first[k] for k in ("digest", "tick", "invariant", "fault")])
        self.assertIn(f"--replay {first['seed']}", esmc("campaign", *off).stdout)

    def test_bad_input(self):
        for arguments in (["--episodes", "-1"], ["--episodes", "many"], ["--jobs", "0"], ["--replay", "x"], ["--seed", "1.5"],
                          ["--protocol", "canopen"], ["no_such.toml"], ["--set", "control.law=\"open_loop\""], ["--fast"]):
            self.refused(esmc("campaign", *arguments))


if __name__ == "__main__":
    main(testLoader=sample.SampledLoader(SAMPLE))
