#!/usr/bin/env python3
"""Two moteus in a loop, judged by a second reading of their protocol: what is told and said is what the log of the run has, nothing
is later than `check` says at 2 kHz, and each defect is refused by name. usage: moteus_test.py ESMC"""
import json
import math
import sys
from pathlib import Path

import moteus_decode

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "cli"))
import command  # noqa: E402

MODE, POSITION, SPEED, TORQUE, HOME, FAULT, COMMAND, FEEDFORWARD, MOST, WATCHDOG = 0, 1, 2, 3, 0xC, 0xF, 0x20, 0x22, 0x25, 0x27
MOTEUS = "drives.protocol=moteus"
TIMED = 'effects=[{type="bit_timing"}]'
FAST = "control.rate_hz=2000"


def esmc(name, *sets, more=()):
    return command.esmc(name, command.CIRCLE, *more, *command.sets(MOTEUS, *sets))


def recorded(folder, *sets):
    run = esmc("hil", *sets, more=["--out", folder])
    assert run.returncode == 0, run.stderr
    summary = json.loads((folder / "summary.json").read_text())
    return summary, command.read_table(folder / "log.csv"), list(moteus_decode.log(folder / "frames.log"))


def us_on_the_wire(identifier, data, data_rate):
    """Time of a CAN FD frame up to its last bit, written from the standard: arbitration and end at 1 Mbit/s, the rest faster."""
    extended = identifier > 0x7FF
    head = "0" + (f"{identifier >> 18:011b}11{identifier & 0x3FFFF:018b}0" if extended else f"{identifier:011b}00") + "101"
    code = len(data) if len(data) <= 8 else {12: 9, 16: 10, 20: 11, 24: 12, 32: 13, 48: 14, 64: 15}[len(data)]
    body = f"0{code:04b}" + "".join(f"{b:08b}" for b in data)
    slow = fast = run = 0
    last = ""
    for i, b in enumerate(head + body):
        for bit in (b, None):
            if bit is None:
                if run < 5 or i + 1 == len(head + body):  # there the first fixed stuff bit follows anyway
                    break
                bit = "10"[int(last)]
            run = run + 1 if bit == last else 1
            last = bit
            slow, fast = (slow + 1, fast) if i < len(head) else (slow, fast + 1)
    check = 4 + (17 if len(data) <= 16 else 21)  # stuff count and CRC
    fast += check + 1 + check // 4
    return slow + fast / data_rate + 1 + 2 + 7  # CRC delimiter, acknowledge, end of frame


class Moteus(command.Case):
    def test_the_decoder_reads_the_vendors_examples(self):
        sent = moteus_decode.subframes(bytes.fromhex("01000a0f200000c07f000000000000c03f022300000d250000404011001f01130d"))
        self.assertEqual([k for k, _ in sent], ["write"] * 4 + ["read"] * 3)
        written = moteus_decode.merged(bytes.fromhex("01000a07206000200150ff140400130d"), "write")
        for register, want in ((MODE, 10), (COMMAND, 0.0096), (COMMAND + 1, 0.072), (FEEDFORWARD, -1.76)):
            self.assertAlmostEqual(written[register], want)
        said = moteus_decode.merged(bytes.fromhex("2404000a005000000170ff230d181400"), "reply")
        for register, want in ((MODE, 10), (POSITION, 0.008), (SPEED, 0.064), (TORQUE, -1.44), (0xD, 24), (0xE, 20), (FAULT, 0)):
            self.assertAlmostEqual(said[register], want)

    def test_frames_say_what_the_log_has(self):
        gear, direction, offset = (2.0, 3.0), (1, -1), (0.1, -0.2)
        summary, rows, frames = recorded(self.tmp, "simulation.duration=0.3", "drives.nodes=[9,2]", f"drives.gear_ratio={list(gear)}",
                                         f"drives.direction={list(direction)}", f"drives.offset={list(offset)}")
        self.assertEqual(summary["supervisor"]["faults"], [])
        told, said, last, checked = ([], []), ([], []), [None, None], 0
        for _, source, destination, reply, data in frames:
            if destination == 0:
                i = (9, 2).index(source)
                last[i] = moteus_decode.merged(data, "reply")
                self.assertFalse(reply)
                self.assertEqual(last[i][FAULT], 0)
                continue
            i = (9, 2).index(destination)
            self.assertTrue(reply and source == 0)
            written = moteus_decode.merged(data, "write")
            asked = moteus_decode.merged(data, "read")
            self.assertLessEqual({MODE, POSITION, SPEED, TORQUE, FAULT}, asked.keys())
            if written[MODE] == 0:
                self.assertEqual(written, {MODE: 0})
                continue
            self.assertEqual(written[MODE], 10)
            self.assertTrue(math.isnan(written[COMMAND]), "here")
            self.assertEqual((written[COMMAND + 1], written[0x23], written[0x24]), (0, 0, 0))
            self.assertAlmostEqual(written[MOST], math.ceil(100 * 2.0 / gear[i]) / 100)
            self.assertAlmostEqual(written[WATCHDOG], 0.01)
            if MOST in asked:  # arming
                self.assertEqual(written[FEEDFORWARD], 0)
                checked += 1
                continue
            self.assertEqual(len(data), 32)
            told[i].append(written[FEEDFORWARD])
            said[i].append(last[i])
        self.assertEqual(checked, 4, "two ticks of read-back")
        self.assertEqual((len(rows), len(told[0]), len(told[1])), (300, 301, 301), "one more: ready, and not yet running")
        for i, name in enumerate(("11", "21")):
            self.assertEqual(told[i][0], 0)
            for row, torque, reply in zip(rows, told[i][1:], said[i][1:]):
                want = float(row[f"tau{name}_cmd"]) * direction[i] / gear[i]
                self.assertAlmostEqual(torque, want, delta=1.2e-7 * abs(want), msg="two roundings to float")
                joint = 2 * math.pi * direction[i] / gear[i]
                self.assertAlmostEqual(reply[POSITION] * joint + offset[i], float(row[f"theta{name}_meas"]), delta=1e-6)
                self.assertAlmostEqual(reply[SPEED] * joint, float(row[f"theta{name}_rate_meas"]), delta=1e-5)

    def test_the_default_data_rate_and_a_stated_one(self):
        plain = json.loads(esmc("hil", "simulation.duration=0.1", more=["--json"]).stdout)
        stated = json.loads(esmc("hil", "simulation.duration=0.1", "bus.data_bitrate=5000000", more=["--json"]).stdout)
        self.assertEqual(stated["digest"], plain["digest"])
        self.assertEqual(stated["bus"], plain["bus"])
        slow = json.loads(esmc("hil", "simulation.duration=0.1", "bus.data_bitrate=1000000", more=["--json"]).stdout)
        self.assertGreater(slow["bus"]["load"], 1.5 * plain["bus"]["load"])

    def test_two_at_2_khz_are_within_the_bounds_of_check(self):
        check = json.loads(esmc("check", FAST, more=["--json"]).stdout)
        self.assertNotEqual(check["verdict"], "unfit")
        self.assertGreaterEqual(check["bus"]["rate_max_hz"], 2000)
        self.assertLessEqual(check["bus"]["tick_frames_s"], 1 / 2000)
        bound = {m["id"]: m["response_s"] for m in check["bus"]["messages"]}
        self.assertEqual(set(bound), {0x8001, 0x8002, 0x100, 0x200})
        summary, _, frames = recorded(self.tmp, FAST, TIMED, "simulation.duration=0.5")
        self.assertEqual((summary["supervisor"]["faults"], summary["bus"]["errors"], summary["bus"]["lost"]), ([], 0, 0))
        for m in summary["bus"]["messages"]:
            self.assertLessEqual(m["latency_max_s"], bound[m["id"]], hex(m["id"]))
            self.assertLessEqual(m["latency_max_s"], 1 / 2000)
        before, together, bits = -1.0, 0, 0
        for t, source, destination, reply, data in frames:
            us = us_on_the_wire((0x8000 if reply else 0) | source << 8 | destination, data, 5)
            self.assertGreaterEqual((t - before) * 1e6, us + 3 - 1.5)  # the log has whole microseconds
            together += (t - before) * 1e6 <= us + 3 + 2.5  # and the bus whole bits
            before = t
            bits += us + 3
        self.assertGreater(together, len(frames) // 2, "most follow at once")
        self.assertAlmostEqual(summary["bus"]["load"], bits * 1e-6 / before, delta=0.015)

    def test_the_largest_rate_is_where_a_tick_is_full(self):
        rate = json.loads(esmc("check", more=["--json"]).stdout)["bus"]["rate_max_hz"]
        for factor, fits in ((0.99, True), (1.01, False)):
            bus = json.loads(esmc("check", f"control.rate_hz={rate * factor}", more=["--json"]).stdout)["bus"]
            self.assertEqual(bus["load"] <= 1, fits)
            self.assertEqual(bus["worst_latency_s"] is not None, fits)
        self.assertIn(f"control.rate_hz up to {rate:.0f}", esmc("check").stdout)

    def test_each_defect_is_named(self):
        torque = ("drives.torque_mismatch=0.3", "drives.torque_time=0")
        for defect, words, sets in (("position_invalid", "refused to arm: feedback_not_finite", ()),
                                    ("relative_position", "refused to arm: drive_configuration (node 1, register 00C)", ()),
                                    ("other_registers", "refused to arm: drive_configuration (node 1, register 102)", ()),
                                    ("refuses_watchdog", "refused to arm: drive_configuration (node 1, register 027)", ()),
                                    ("low_max_torque", "FAULT: torque_mismatch", torque),
                                    ("classic_replies", "frames that are not of their protocol", ())):
            run = esmc("hil", f"drives.defect={defect}", "simulation.duration=0.1", *sets)
            self.assertEqual(run.returncode, 1, defect)
            self.assertIn(words, run.stdout + run.stderr, defect)
        relative = esmc("hil", "drives.defect=relative_position", "drives.zero=pose", "simulation.duration=0.1")
        self.assertEqual(relative.returncode, 0, "the zero is confirmed by hand")

    def test_a_recorded_run_repeats(self):
        recorded(self.tmp, "simulation.duration=0.1")
        again = command.esmc("replay", self.tmp)
        self.assertEqual(again.returncode, 0, again.stdout + again.stderr)

    def test_what_is_refused(self):
        def refused(words, *sets, name="hil", more=()):
            self.refused(esmc(name, *sets, more=more), words)
        refused("'bus.data_bitrate' is for CAN FD", "drives.protocol=odrive", "bus.data_bitrate=5000000")
        refused("'bus.data_bitrate' must be at least bus.bitrate", "bus.data_bitrate=500000")
        refused("'bus.data_bitrate' must be", "bus.data_bitrate=9000000")
        refused("names node 0: 1 to 126", "drives.nodes=[0,1]")
        refused("names node 127: 1 to 126", "drives.nodes=[1,127]")
        refused("at most 320 can be told to a moteus", "control.torque_limit=400.0")
        refused("the drives of this scene have 0x700", "command={base_id=1792, speed=0.5, acceleration=5.0}")
        refused("slcan carries classic frames only", more=["--bus", "slcan:/dev/null,/dev/null"])
        refused("slcan carries classic frames only", name="plant", more=["--bus", "slcan:/dev/null"])
        refused("a moteus speaks only when it is commanded", "control.sensors=all", "sensors={nodes=[5,6]}")
        refused("servopos.position_min", "drives.confirmed=false")


if __name__ == "__main__":
    command.main()
