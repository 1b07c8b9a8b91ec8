#!/usr/bin/python3
"""Effects of the bus from outside: what a run with them does, says and refuses.

usage: bus_test.py ESMC"""
import json
import re
import tempfile
from pathlib import Path

from command import CIRCLE, Case, esmc, main, read_table, sets

TIMED = '{type="bit_timing"}'


def hil(*effects, values=(), seed=1, out=None):
    done = esmc("hil", CIRCLE, "--json", "--seed", seed, *sets(f"effects=[{', '.join(effects)}]", "simulation.duration=0.6", *values), *(["--out", out] if out else []))
    return json.loads(done.stdout), done.returncode


def checked(*values):
    return json.loads(esmc("check", CIRCLE, "--json", *sets(*values)).stdout)


def latest(*values):
    """By identifier, what `esmc check` says."""
    return {m["id"]: m["response_s"] for m in checked(*values)["bus"]["messages"]}


def recorded(*effects):
    """Summary, rows of log.csv, frames of frames.log: (s, identifier, bytes)."""
    with tempfile.TemporaryDirectory() as folder:
        summary, _ = hil(*effects, out=folder)
        rows = read_table(Path(folder, "log.csv"))
        lines = Path(folder, "frames.log").read_text(encoding="ascii").splitlines()
    frames = []
    for line in lines:
        t, identifier, data = re.fullmatch(r"\((\d+\.\d+)\) virtual ([0-9A-F]{3})#([0-9A-F]*)", line).groups()
        frames.append((float(t), int(identifier, 16), bytes.fromhex(data)))
    return summary, rows, frames


def length(identifier, data):
    """Bits of a base frame with data up to its last bit: written from the standard, not from the program."""
    bits = f"0{identifier:011b}000{len(data):04b}" + "".join(f"{b:08b}" for b in data)
    crc = 0
    for b in bits:
        crc = (crc << 1) ^ (0x4599 if (crc >> 14) ^ int(b) else 0)
        crc &= 0x7FFF
    bits += f"{crc:015b}"
    n = run = 0
    last = ""
    for b in bits:
        n += 1
        run = run + 1 if b == last else 1
        last = b
        if run == 5:
            n += 1
            last, run = "10"[int(b)], 1
    return n + 10


class Bus(Case):
    def test_a_scene_without_them_is_what_it_was(self):
        plain = json.loads(esmc("hil", CIRCLE, "--json").stdout)
        self.assertEqual(plain["digest"], "f63c5900ff4b4e2b")
        self.assertEqual(sorted(plain["bus"]), ["frames", "load", "lost"])

    def test_frames_follow_each_other_by_their_bits(self):
        summary, _, frames = recorded(TIMED)
        self.assertTrue(summary["bus"]["timed"])
        bits = gaps = 0
        before = -1.0
        for t, identifier, data in frames:
            n = length(identifier, data)
            bits += n + 3
            self.assertGreaterEqual(t - before, (n + 3) * 1e-6 - 1.5e-6)  # the log has whole microseconds
            gaps += abs(t - before - (n + 3) * 1e-6) < 1.5e-6
            before = t
        self.assertGreater(gaps, len(frames) // 2)  # most come at once after the one before
        # Over the run and the arming before it; frames that part drives and controller after it are in the log alone.
        self.assertAlmostEqual(summary["bus"]["load"], bits * 1e-6 / before, delta=0.01)

    def test_torque_acts_as_late_as_its_frame(self):
        """Between two fixed delays: that of the first torque frame of a tick and that of the last."""
        _, _, frames = recorded(TIMED)
        late = [t % 1e-3 for t, identifier, _ in frames if identifier in (0x2E, 0x4E) and 0.1 < t < 0.5]
        self.assertGreater(min(late), 2e-4)
        error = {}
        for name, effects in (("early", f'{{type="compute_delay", time={min(late)}}}'),
                              ("late", f'{{type="compute_delay", time={max(late)}}}'), ("bus", TIMED)):
            error[name] = hil(effects)[0]["tracking"]["settled_rms_rad"]
        self.assertLess(error["early"], error["bus"])
        self.assertLess(error["bus"], error["late"])

    def test_nothing_is_later_than_check_says(self):
        for effects in (TIMED, f'{TIMED}, {{type="babbling_node", identifier=2000, rate_hz=900}}'):
            bound = latest(f"effects=[{effects}]")
            seen = {m["id"]: m for m in hil(effects)[0]["bus"]["messages"]}
            for identifier, limit in bound.items():
                self.assertLessEqual(seen[identifier]["latency_max_s"], limit)
                self.assertLessEqual(seen[identifier]["latency_mean_s"], seen[identifier]["latency_max_s"])

    def test_every_protocol_runs_on_a_bus_that_takes_time(self):
        for protocol in ("odrive_0.5", "cia402", "mit", "moteus"):
            values = [f"drives.protocol={protocol}"] + (["drives.master_id=[16, 17]"] if protocol == "mit" else [])
            summary, status = hil(TIMED, values=values)
            self.assertEqual((status, summary["bus"]["errors"], summary["bus"]["lost"]), (0, 0, 0), protocol)
            bound = latest(*values)
            for m in summary["bus"]["messages"]:
                if m["id"] in bound:  # not what arming takes
                    self.assertLessEqual(m["latency_max_s"], bound[m["id"]], (protocol, hex(m["id"])))

    def test_two_drives_that_answer_alike_collide(self):
        summary, status = hil(TIMED, values=["drives.protocol=mit"])
        self.assertNotEqual(status, 0)
        self.assertGreaterEqual(summary["bus"]["errors"], 16)

    def test_a_few_losses_are_bridged(self):
        summary, status = hil('{type="loss", probability=0.01}')
        self.assertEqual((status, [f["name"] for f in summary["supervisor"]["faults"]]), (0, []))
        self.assertGreater(summary["bus"]["missed"], 10)

    def test_everything_lost_ends_in_the_named_fault(self):
        summary, status = hil('{type="loss", probability=1.0, at="controller", from=0.3}')
        self.assertEqual((status, [f["name"] for f in summary["supervisor"]["faults"]]), (1, ["stale_feedback"]))
        # Two ticks are bridged: 0.300 and 0.301 have no sample, 0.302 is the third.
        self.assertAlmostEqual(summary["supervisor"]["fault_t_s"], 0.302, places=9)

    def test_drives_that_hear_nothing_stop_by_their_watchdog(self):
        summary, rows, _ = recorded('{type="loss", probability=1.0, at="drives", from=0.3}')
        self.assertIn([f["name"] for f in summary["supervisor"]["faults"]], (["drive_error"], ["drive_disarmed"]))
        if summary["supervisor"]["faults"][0]["name"] == "drive_error":
            self.assertRegex(summary["verdict"]["reasons"][0], "0x[0-9A-F]+, error code")
        torque = [(float(r["t"]), float(r["tau11"])) for r in rows]
        held = {tau for t, tau in torque if 0.3 <= t < 0.3095}
        self.assertEqual(len(held), 1)  # the last torque goes on
        self.assertNotEqual(held, {0.0})
        self.assertEqual({tau for t, tau in torque if t > 0.3105}, {0.0})  # watchdog_timeout = 0.01

    def test_a_flood_is_stale_feedback(self):
        summary, _ = hil(TIMED, '{type="babbling_node", identifier=0, rate_hz=1e5, from=0.3}')
        self.assertEqual([f["name"] for f in summary["supervisor"]["faults"]], ["stale_feedback"])
        self.assertLessEqual(summary["supervisor"]["fault_t_s"], 0.303)

    def test_the_loop_survives_a_short_flood_and_finds_its_rhythm_again(self):
        calm = hil(TIMED)[0]["tracking"]["settled_max_rad"]
        summary, rows, _ = recorded(TIMED, '{type="babbling_node", identifier=0, rate_hz=1e5, from=0.3, to=0.3015}')
        self.assertEqual([f["name"] for f in summary["supervisor"]["faults"]], [])
        after = max(abs(float(r["theta11"]) - float(r["theta11_ref"])) for r in rows if float(r["t"]) > 0.5)
        self.assertLess(after, 2 * calm)

    def test_foreign_command_is_a_fault(self):
        summary, _ = hil(TIMED, '{type="babbling_node", identifier=0x2E, rate_hz=500, from=0.3}')
        self.assertEqual([f["name"] for f in summary["supervisor"]["faults"]], ["foreign_controller"])

    def test_bus_off_is_a_fault_and_torque_does_not_come_back_with_the_bus(self):
        for restart in ("false", "true"):
            summary, rows, frames = recorded(f'{{type="bus_off", at=0.3, restart={restart}}}')
            self.assertEqual([f["name"] for f in summary["supervisor"]["faults"]], ["bus_off"])
            state = summary["bus"]["nodes"][0]["error_state"]
            self.assertEqual(state, "active" if restart == "true" else "off")
            self.assertEqual({float(r["tau11"]) for r in rows if float(r["t"]) > 0.312}, {0.0})
            zero = [data for t, identifier, data in frames if identifier == 0x2E and t > frames[-1][0] - 0.2]
            self.assertEqual(len(zero) > 0, restart == "true")  # it speaks again
            self.assertEqual(set(zero) | {bytes(8)}, {bytes(8)})  # and asks for nothing

    def test_a_drive_that_is_cut_off(self):
        for to, faults in ((0.302, []), (0.304, ["stale_feedback"])):
            summary, _ = hil(f'{{type="drive_dropout", drive=2, from=0.3, to={to}}}')
            self.assertEqual([f["name"] for f in summary["supervisor"]["faults"]], faults)

    def test_disturbed_frames_are_repeated(self):
        summary, status = hil(TIMED, '{type="corruption", detected=0.02, from=-1}')
        self.assertEqual((status, summary["bus"]["missed"], summary["bus"]["corrupted"]), (0, 0, 0))
        self.assertGreater(summary["bus"]["errors"], 10)

    def test_one_seed_one_run(self):
        effects = (TIMED, '{type="loss", probability=0.02}', '{type="duplication", probability=0.02}',
                   '{type="corruption", detected=0.02}', '{type="babbling_node", identifier=100, rate_hz=700}')
        first, again, other = (hil(*effects, seed=s)[0] for s in (3, 3, 4))
        for run in (first, again, other):
            run.pop("wall_s"), run.pop("real_time_factor")
        self.assertEqual(first, again)
        self.assertNotEqual(first["digest"], other["digest"])

    def test_where_they_cannot_act_they_are_refused(self):
        for command in (["sim"], ["hil", "--bus", "socketcan:vcan0"], ["plant", "--bus", "socketcan:vcan0"],
                        ["controller", "--bus", "socketcan:vcan0"], ["hil", "--bus", "socketcan:vcan0", "--realtime"]):
            self.refused(esmc(command[0], CIRCLE, *command[1:], "--set", f"effects=[{TIMED}]"), "effect 'bit_timing' cannot act")

    def test_wrong_parameters(self):
        for effects, words in (('{type="loss"}', "probability"), ('{type="loss", probability=1.5}', "probability"),
                               ('{type="loss", probability=0.1, at="nobody"}', "controller"),
                               ('{type="corruption"}', "detected > 0 or undetected > 0"),
                               ('{type="babbling_node", identifier=1, rate_hz=10}', "bit_timing"),
                               (f'{TIMED}, {{type="babbling_node", identifier=2048, rate_hz=10}}', "extended"),
                               ('{type="drive_dropout", drive=3}', "2 entries"), ('{type="drive_dropout", drive=0}', "drive"),
                               ('{type="bus_off", at=0.1, drive=4}', "2 entries"),
                               ('{type="loss", probability=0.1, from=2, to=1}', "later than from"),
                               ('{type="bit_timing", speed=2}', "speed")):
            self.refused(esmc("hil", CIRCLE, "--set", f"effects=[{effects}]"), words)

    def test_check_warns_of_orders_that_go_before_the_drives(self):
        def warned(base, nodes):
            found = checked("command={base_id=%d, speed=0.5, acceleration=5.0}" % base, "drives.nodes=%s" % nodes)["findings"]
            return [f["text"] for f in found if "command.base_id" in f["text"]]
        self.assertEqual(len(warned(0x20, [5, 6])), 1)
        self.assertIn("0x20 comes before drive frames", warned(0x20, [5, 6])[0])
        self.assertEqual(warned(0x700, [5, 6]), [])

    def test_check_warns_where_a_message_is_later_than_a_tick(self):
        def findings(*values):
            return [f["text"] for f in checked(*values)["findings"]]
        self.assertEqual(findings(), [])
        self.assertTrue(any("identifier 0x4E" in f and "due after 1000 us" in f for f in findings("bus.bitrate=800000")))
        self.assertFalse(any("0x21" in f for f in findings("bus.bitrate=800000")))  # heartbeats have ten ticks
        self.assertTrue(any("share the identifier 0x0" in f for f in findings("drives.protocol=mit")))
        self.assertEqual(findings("drives.protocol=mit", "drives.master_id=[16, 17]"), [])
        self.assertTrue(any("above 80 %" in f for f in findings("bus.bitrate=700000")))
        # SYNC 55 bits with all its stuffing, two drives with 135 and 105 each.
        late = [f for f in findings("drives.protocol=cia402") if "answers to SYNC" in f]
        self.assertEqual(len(late), 1)
        self.assertRegex(late[0], r"up to 535 us, .* waits 400 us .* one tick old; .* up to 747 Hz")
        compared = findings("drives.protocol=cia402", "drives.torque_mismatch=0.5", "drives.torque_time=0")
        self.assertTrue(any("compared a tick late" in f for f in compared))
        self.assertEqual(findings("drives.protocol=cia402", "control.rate_hz=747"), [])


if __name__ == "__main__":
    main()
