#!/usr/bin/python3
"""Reads the frames of a lockstep run with canmatrix and odrive.dbc, which know nothing of this project's own
encoding, and checks frame by frame that they carry what log.csv says was measured and commanded.

In lockstep every tick is one set: per axis one Get_Encoder_Estimates, then per axis one Set_Input_Torque. Row 0 of
log.csv is t = 0: the set after the one in which the last axis had its second Heartbeat with axis_state 8 (a heartbeat
between two sets belongs to the later one: a drive sends it in the tick that begins). Before t = 0 and after the last
row torque must be 0.

With --endpoints: before an axis is asked into closed-loop control, each of them was read (RxSdo) and answered (TxSdo) with that
value; nothing is written, and no answer is to another question.

Exit status 0 and one line of counts, or 1 and the first thing that is wrong.
"""
import argparse
import csv
import logging
import math
import re
import struct
import sys

logging.disable(logging.WARNING)  # canmatrix complains at import about formats whose libraries are missing
import canmatrix.formats  # noqa: E402

LINE = re.compile(r"\(\d+\.\d+\) \S+ ([0-9A-F]{3}|[0-9A-F]{8})#(R\d?|(?:[0-9A-F]{2}){0,8})(?: [TR])?\n")
CLOSED_LOOP = 8


class Wrong(Exception):
    pass


def numbers(convert):
    return lambda text: [convert(item) for item in text.split(",")]


def ulp32(x):
    """Distance between neighbouring float32 values at x."""
    return 2.0 ** max(math.frexp(x)[1] - 24, -149)


def read_frames(path, dbc):
    """Yields (line number, node, message name, {signal: value} or None for a remote request) of every frame."""
    with open(path, encoding="ascii") as log:
        for number, line in enumerate(log, 1):
            match = LINE.fullmatch(line)
            if not match:
                raise Wrong(f"{path}:{number}: not a classic CAN frame as candump -L writes it: {line.rstrip()}")
            identifier = int(match[1], 16)
            if len(match[1]) != 3 or identifier > 0x7FF:  # 8 digits: 29 bits, or an error frame
                raise Wrong(f"{path}:{number}: {match[1]} is not an 11-bit identifier")
            frame = dbc.frame_by_id(canmatrix.ArbitrationId(identifier, extended=False))
            if frame is None:
                raise Wrong(f"{path}:{number}: identifier {match[1]} is not in the DBC")
            values = None
            if not match[2].startswith("R"):
                try:
                    decoded = frame.decode(bytes.fromhex(match[2]))
                except canmatrix.DecodingFrameLength as error:
                    raise Wrong(f"{path}:{number}: {frame.name}: {error}") from error
                values = {name: signal.raw_value for name, signal in decoded.items()}
            axis, name = frame.name.split("_", 1)
            yield number, int(axis.removeprefix("Axis")), name, values


class Checker:
    """Finds the sets in the stream of frames and holds those of the run against the rows."""

    def __init__(self, args, rows):
        self.args, self.rows = args, rows
        self.nodes = args.nodes
        self.first_row = len(rows) - args.last_ticks if args.last_ticks else 0
        self.heartbeats = dict.fromkeys(self.nodes, 0)
        self.start = None       # index of the set at t = 0, once known
        self.index = -1         # of the current set: the last one that began
        self.answered = True    # the current set is complete
        self.measured, self.commanded = set(), set()  # nodes heard in the current set
        self.counts = {"positions": 0, "velocities": 0, "torques": 0}
        self.endpoints = {}     # what each must answer, four bytes as one number
        for text in args.endpoints:
            number, layout, value = text.split(":")
            packed = struct.pack("<" + layout, float(value) if layout == "f" else int(value))
            self.endpoints[int(number)] = int.from_bytes(packed, "little")
        if self.endpoints:
            self.counts["endpoints"] = 0
        self.asked = {}         # node: endpoint of the question that was not answered yet
        self.unread = {node: set(self.endpoints) for node in self.nodes}

    def tick(self):
        """Row of the current set; negative before t = 0, >= len(rows) after the run."""
        if self.start is None:
            return -1
        tick = self.index - self.start
        return tick + 1 if self.answered and tick == len(self.rows) - 1 else tick

    def running(self):
        return 0 <= self.tick() < len(self.rows)

    def column(self, *names):
        for name in names:
            if name in self.rows[0]:
                return name
        raise Wrong(f"{self.args.csv}: no column {' or '.join(names)}")

    def compare(self, kind, node, column, value, part):
        """part: the larger of value's summands, which limits its float32 resolution."""
        if self.tick() < self.first_row:
            return
        expected = float(self.rows[self.tick()][column])
        # 1e-12: double rounding of the conversions where float32 resolves more, near 0
        if not abs(value - expected) <= 2 * ulp32(max(abs(value), abs(expected), abs(part))) + 1e-12:
            raise Wrong(f"tick {self.tick()}, node {node}: frame says {column} = {value!r}, log says {expected!r}")
        self.counts[kind] += 1

    def heartbeat(self, node, values):
        if values["Axis_State"] != CLOSED_LOOP:
            return
        self.heartbeats[node] += 1
        if self.start is None and min(self.heartbeats.values()) >= 2:
            self.start = self.index + (2 if self.answered else 1)

    def encoder(self, node, values):
        if self.answered:
            self.index += 1
        elif node in self.measured or self.commanded:
            if self.running():
                raise Wrong(f"tick {self.tick()}, node {node}: a new encoder frame, but the set before has "
                            f"{len(self.measured)} encoder and {len(self.commanded)} torque frames")
        if self.answered or node in self.measured or self.commanded:
            # While arming, a plant may repeat a set that nobody answered yet.
            self.answered, self.measured, self.commanded = False, set(), set()
        self.measured.add(node)
        if self.running():
            axis = self.nodes.index(node)
            angle, offset = self.args.angles[axis], self.args.offset[axis]
            scale = 2 * math.pi * self.args.direction[axis] / self.args.gear[axis]
            turn = values["Pos_Estimate"] * scale
            self.compare("positions", node, self.column(f"{angle}_meas", angle), turn + offset, turn)
            speed = values["Vel_Estimate"] * scale
            self.compare("velocities", node, self.column(f"{angle}_rate_meas", f"{angle}_rate"), speed, speed)

    def torque(self, node, values):
        command = values["Input_Torque"]
        if not self.running():
            if command != 0:
                when = "before t = 0" if self.tick() < 0 else "after the last row"
                raise Wrong(f"node {node}: torque {command!r} {when}")
        else:
            if self.answered or len(self.measured) < len(self.nodes) or node in self.commanded:
                raise Wrong(f"tick {self.tick()}, node {node}: torque frame where none is due")
            axis = self.nodes.index(node)
            torque = command * self.args.direction[axis] * self.args.gear[axis]
            name = self.args.torques[axis]
            self.compare("torques", node, self.column(f"{name}_cmd", name), torque, torque)
        if len(self.measured) == len(self.nodes):
            self.commanded.add(node)
            self.answered = len(self.commanded) == len(self.nodes)

    def read(self, node, values):
        if values["Opcode"] != 0:
            raise Wrong(f"node {node}: writes endpoint {values['Endpoint_ID']}")
        self.asked[node] = values["Endpoint_ID"]

    def answer(self, node, values):
        endpoint = values["Endpoint_ID"]
        if self.asked.pop(node, None) != endpoint:
            raise Wrong(f"node {node}: endpoint {endpoint} was not asked for")
        if self.endpoints.get(endpoint) != values["Value"]:
            raise Wrong(f"node {node}: endpoint {endpoint} is {values['Value']:#x}, expected {self.endpoints.get(endpoint)}")
        self.unread[node].discard(endpoint)
        self.counts["endpoints"] += 1

    def state(self, node, values):
        if values["Axis_Requested_State"] == CLOSED_LOOP and self.unread[node]:
            raise Wrong(f"node {node}: armed before endpoints were read: {sorted(self.unread[node])}")


def check(args):
    dbc = canmatrix.formats.loadp_flat(args.dbc)
    with open(args.csv, encoding="ascii", newline="") as table:
        rows = list(csv.DictReader(table))
    if len(rows) < max(1, args.last_ticks):
        raise Wrong(f"{args.csv}: {len(rows)} rows")
    checker = Checker(args, rows)
    handlers = {"Heartbeat": checker.heartbeat, "Get_Encoder_Estimates": checker.encoder,
                "Set_Input_Torque": checker.torque, "RxSdo": checker.read, "TxSdo": checker.answer, "Set_Axis_State": checker.state}
    frames = 0
    for number, node, name, values in read_frames(args.frames, dbc):
        frames += 1
        if values is not None and node in args.nodes and name in handlers:
            try:
                handlers[name](node, values)
            except Wrong as error:
                raise Wrong(f"{args.frames}:{number}: {error}") from error
    if checker.start is None:
        raise Wrong(f"{args.frames}: t = 0 not found, heartbeats with axis_state 8 per node: {checker.heartbeats}")
    if checker.tick() < len(rows):
        raise Wrong(f"{args.frames}: ends in tick {checker.tick()} of {len(rows)}")
    counts = ", ".join(f"{count} {kind}" for kind, count in checker.counts.items())
    print(f"{frames} frames decoded, {len(rows)} ticks, equal: {counts}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dbc", required=True)
    parser.add_argument("--frames", required=True, help="log as candump -L writes it")
    parser.add_argument("--csv", required=True, help="log.csv of the same run")
    parser.add_argument("--nodes", type=numbers(int), required=True, help="one per axis, as in the scene; also below")
    parser.add_argument("--direction", type=numbers(float))
    parser.add_argument("--gear", type=numbers(float), help="motor turns per joint turn")
    parser.add_argument("--offset", type=numbers(float), help="joint angle at encoder zero, rad")
    parser.add_argument("--angles", type=numbers(str), required=True, help="columns; NAME_meas is preferred")
    parser.add_argument("--torques", type=numbers(str), required=True, help="columns; NAME_cmd is preferred")
    parser.add_argument("--endpoints", type=numbers(str), default=[], help="NUMBER:B:VALUE or NUMBER:f:VALUE, of every axis")
    parser.add_argument("--last-ticks", type=int, default=0, help="compare values in the last N rows only (0: all)")
    # argparse takes the value in "--direction -1,1" for an option
    args = parser.parse_args(re.sub(r"\0(?=-[\d.])", "=", "\0".join(sys.argv[1:])).split("\0"))
    for name, default in (("direction", 1.0), ("gear", 1.0), ("offset", 0.0), ("angles", None), ("torques", None)):
        if getattr(args, name) is None:
            setattr(args, name, [default] * len(args.nodes))
        if len(getattr(args, name)) != len(args.nodes):
            parser.error(f"--{name}: one value per node")
    try:
        check(args)
    except (Wrong, OSError, ValueError, TypeError) as error:  # the latter two: cells that are no numbers
        print(f"decode_log: {error}")
        sys.exit(1)


if __name__ == "__main__":
    main()
