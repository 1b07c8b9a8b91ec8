#!/usr/bin/python3
"""Tests of decode_log.py and odrive.dbc against frames packed here with struct: a third, independent encoding."""
import contextlib
import csv
import io
import logging
import math
import pathlib
import struct
import subprocess
import tempfile
import unittest

logging.disable(logging.WARNING)  # canmatrix complains at import about formats whose libraries are missing
import canmatrix.formats  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
NODES, DIRECTION, GEAR, OFFSET = (1, 3), (1, -1), (1.0, 6.0), (0.0, -0.7)
TICKS = 20


def float32(x):
    return struct.unpack("<f", struct.pack("<f", x))[0]


def line(identifier, data=b""):
    line.count += 1
    return f"(1700000000.{line.count:06d}) vcan0 {identifier:03X}#{data.hex().upper()}\n"


line.count = 0


def synthetic(heartbeat_after_encoders=False):
    """Frames and rows of a run: enabling, arming with torque 0, TICKS ticks, shutdown."""
    frames, rows, tick, heartbeats = [], [], None, 0
    for node in NODES:
        frames += [line(node << 5 | 0x00B, struct.pack("<II", 1, 1)), line(node << 5 | 0x018, bytes(1)),
                   line(node << 5 | 0x007, struct.pack("<II", 8, 0))]
    for k in range(1000):
        states = []
        if k % 5 == 2:  # every 5 ticks; still idle in the first one
            states = [line(n << 5 | 0x001, struct.pack("<IBBBB", 0, 8 if heartbeats else 1, 0, 1, 0)) for n in NODES]
            heartbeats += 1
        row = {"t": (tick or 0) / 1000}
        encoders, torques = [], []
        for axis, node in enumerate(NODES):
            truth, speed = math.sin(0.1 * k + axis), math.cos(0.1 * k + axis) / 7
            scale = 2 * math.pi * DIRECTION[axis] / GEAR[axis]
            turns, rate = float32((truth - OFFSET[axis]) / scale), float32(speed / scale)
            torque = 0.0 if tick is None else float32(0.3 * math.cos(0.2 * k + axis))
            encoders.append(line(node << 5 | 0x009, struct.pack("<ff", turns, rate)))
            torques.append(line(node << 5 | 0x00E, struct.pack("<fI", torque, 0)))
            row |= {f"q{axis}": truth, f"q{axis}_meas": turns * scale + OFFSET[axis], f"q{axis}_rate_meas": rate * scale,
                    f"tau{axis}": torque * DIRECTION[axis] * GEAR[axis]}
        frames += encoders + states if heartbeat_after_encoders else states + encoders
        frames += torques
        if tick is not None:
            rows.append(row)
            tick += 1
        elif states and heartbeats == 3:
            tick = 0
        if tick == TICKS:
            break
    for node in NODES:
        frames += [line(node << 5 | 0x00E, bytes(8)), line(node << 5 | 0x007, struct.pack("<II", 1, 0))]
    return frames, rows


class DecodeLog(unittest.TestCase):
    def run_on(self, frames, rows, *more):
        with tempfile.TemporaryDirectory() as folder:
            log, table = pathlib.Path(folder, "frames.log"), pathlib.Path(folder, "log.csv")
            log.write_text("".join(frames), encoding="ascii")
            with open(table, "w", encoding="ascii", newline="") as file:
                writer = csv.DictWriter(file, rows[0])
                writer.writeheader()
                writer.writerows(rows)
            done = subprocess.run(
                [HERE / "decode_log.py", "--dbc", HERE / "odrive.dbc", "--frames", log, "--csv", table, "--nodes", "1,3",
                 "--direction", "1,-1", "--gear", "1,6", "--offset", "0,-0.7", "--angles", "q0,q1",
                 "--torques", "tau0,tau1", *more], stdout=subprocess.PIPE, text=True, check=False)
        self.assertEqual(done.stdout.count("\n"), 1, done.stdout)
        return done.returncode, done.stdout

    def assert_fails(self, frames, rows, text):
        status, output = self.run_on(frames, rows)
        self.assertEqual(status, 1)
        self.assertRegex(output, text)

    def place(self, frames, command, node, nth):
        """Index in frames of the nth frame (may be negative) with this command of this node."""
        return [i for i, f in enumerate(frames) if f" {node << 5 | command:03X}#" in f][nth]

    def test_run_passes(self):
        for order in (False, True):
            frames, rows = synthetic(order)
            status, output = self.run_on(frames, rows)
            self.assertEqual((status, output), (0, f"{len(frames)} frames decoded, 20 ticks, equal: 40 positions, "
                                                   "40 velocities, 40 torques\n"))

    def test_endpoints(self):
        def sdo(node, command, endpoint, value, opcode=0):
            return line(node << 5 | command, struct.pack("<BHB", opcode, endpoint, 0) + value)

        told = "--endpoints", "300:B:1,307:f:0.01"
        table = {300: b"\1\0\0\0", 307: struct.pack("<f", 0.01)}
        talk = [sdo(n, *what) for n in NODES for e, v in table.items() for what in ((0x004, e, bytes(4)), (0x005, e, v))]
        frames, rows = synthetic()
        status, output = self.run_on(talk + frames, rows, *told)
        self.assertEqual(status, 0, output)
        self.assertRegex(output, ", 4 endpoints$")
        for bad, text in ((talk[2:], r"node 1: armed before endpoints were read: \[300\]"), (talk[1:], "node 1: endpoint 300 was not asked"),
                          ([*talk[:6], sdo(3, 0x004, 307, table[307], 1)], "node 3: writes endpoint 307"),
                          ([talk[0], sdo(1, 0x005, 307, table[307])], "node 1: endpoint 307 was not asked"),
                          ([talk[0], sdo(1, 0x005, 300, bytes(4))], "node 1: endpoint 300 is 0x0"),
                          ([talk[2], sdo(1, 0x005, 307, struct.pack("<f", 0.010001))], "node 1: endpoint 307 is 0x3c23d")):
            status, output = self.run_on(bad + frames, rows, *told)
            self.assertEqual(status, 1)
            self.assertRegex(output, text)

    def test_last_ticks(self):
        frames, rows = synthetic()
        self.assertIn("10 positions, 10 velocities, 10 torques", self.run_on(frames, rows, "--last-ticks", "5")[1])

    def test_true_angle_without_measured_column(self):
        frames, rows = synthetic()
        for row in rows:
            del row["q0_meas"], row["q1_meas"]
        self.assertEqual(self.run_on(frames, rows)[0], 0)

    def test_flipped_byte(self):
        for command, byte in ((0x009, 0), (0x009, 3), (0x009, 5), (0x00E, 1), (0x00E, 3)):
            frames, rows = synthetic()
            i = self.place(frames, command, 3, -5)
            head, data = frames[i].split("#")
            flipped = bytearray.fromhex(data)
            flipped[byte] ^= 0x55
            frames[i] = f"{head}#{flipped.hex().upper()}\n"
            self.assert_fails(frames, rows, rf"frames.log:{i + 1}: tick 1\d, node 3: frame says")

    def test_missing_frame(self):
        for command, text in ((0x009, "torque frame where none is due"), (0x00E, "1 torque frames")):
            for node in NODES:
                frames, rows = synthetic()
                del frames[self.place(frames, command, node, -4)]
                self.assert_fails(frames, rows, text)

    def test_missing_last_set(self):
        frames, rows = synthetic()
        self.assert_fails(frames[:self.place(frames, 0x009, 1, -1)], rows, "ends in tick 18 of 20")

    def test_swapped_nodes(self):
        frames, rows = synthetic()
        i, j = self.place(frames, 0x009, 1, -3), self.place(frames, 0x009, 3, -3)
        frames[i], frames[j] = frames[i].replace(" 029#", " 069#"), frames[j].replace(" 069#", " 029#")
        self.assert_fails(frames, rows, rf"frames.log:{i + 1}: tick 17, node 3: frame says")

    def test_one_tick_off(self):
        frames, rows = synthetic()
        self.assert_fails(frames, rows[1:], "tick 0, node 1: frame says q0_meas")

    def test_torque_outside_the_run(self):
        for nth, text in ((0, "before t = 0"), (-1, "after the last row")):
            frames, rows = synthetic()
            i = self.place(frames, 0x00E, 1, nth)
            frames[i] = line(0x02E, struct.pack("<fI", 0.1, 0))
            self.assert_fails(frames, rows, text)

    def test_undecodable_frames(self):
        for bad in (line(0x7FF), line(0x02E, bytes(3)), line(0x20000004, bytes(8)), "(1.0) vcan0 02E##100\n", "(1.0) vcan0 02\n"):
            frames, rows = synthetic()
            self.assert_fails([bad] + frames, rows, "frames.log:1: ")

    def test_never_armed(self):
        frames, rows = synthetic()
        frames = [f.replace(" 061#0000000008", " 061#0000000001") for f in frames]
        self.assert_fails(frames, rows, r"(torque .* before t = 0)|(t = 0 not found)")


class Dbc(unittest.TestCase):
    """Identifier, length and layout of every message, from the description of the protocol."""
    MESSAGES = {
        "Get_Version": (0x000, "<BBBBBBBB", (2, 4, 4, 58, 0, 6, 10, 1)), "Heartbeat": (0x001, "<IBBBx", (1 << 24, 8, 3, 1)),
        "Estop": (0x002, "", ()), "Get_Error": (0x003, "<II", (0x01000000, 0x2000000)), "RxSdo": (0x004, "<BHBI", (1, 0x1234, 0, 0x3C23D70A)),
        "TxSdo": (0x005, "<BHBI", (0, 0xFEDC, 0, 0x3C23D70A)), "Set_Axis_State": (0x007, "<I4x", (8,)),
        "Get_Encoder_Estimates": (0x009, "<ff", (-0.25, 12.5)), "Set_Controller_Mode": (0x00B, "<II", (1, 6)),
        "Set_Input_Torque": (0x00E, "<f4x", (-1.5,)), "Set_Limits": (0x00F, "<ff", (20.0, 10.5)), "Clear_Errors": (0x018, "<B", (0,)),
        "Get_Torques": (0x01C, "<ff", (0.75, -0.125))}

    def test_every_message(self):
        with contextlib.redirect_stdout(io.StringIO()):
            dbc = canmatrix.formats.loadp_flat(str(HERE / "odrive.dbc"))
        self.assertEqual(len(dbc.frames), 4 * len(self.MESSAGES))
        for node in (1, 2, 3, 4):
            for name, (command, layout, values) in self.MESSAGES.items():
                frame = dbc.frame_by_id(canmatrix.ArbitrationId(node << 5 | command, extended=False))
                data = struct.pack(layout, *values)
                self.assertEqual((frame.name, frame.size), (f"Axis{node}_{name}", len(data)))
                self.assertEqual(tuple(s.raw_value for s in frame.decode(data).values()), values)
                self.assertEqual(frame.encode({s.name: v for s, v in zip(frame.signals, values)}), data)
        torque = dbc.frame_by_name("Axis2_Set_Input_Torque")
        self.assertEqual(torque.encode({"Input_Torque": 1.5}).hex(), "0000c03f00000000")
        units = {s.name: s.unit for f in dbc.frames for s in f.signals if s.unit}
        self.assertEqual(units, {"Pos_Estimate": "rev", "Vel_Estimate": "rev/s", "Input_Torque": "Nm", "Velocity_Limit": "rev/s",
                                 "Current_Limit": "A", "Torque_Target": "Nm", "Torque_Estimate": "Nm"})


if __name__ == "__main__":
    unittest.main()
