#!/usr/bin/python3
"""A supervisor computer on a CAN interface, from docs/command-interface.md and Python's standard library alone: arms,
goes to the start of a circle, streams it, disarms.

usage: supervisor.py INTERFACE OUT.json [circle | dies]   dies: stops sending in the middle of the circle"""
import json
import math
import select
import socket
import struct
import sys
import time

ORDERS = ["none", "arm", "disarm", "off", "reset", "confirm_zero", "hold", "reference", "stream", "store",
          "forget", "home", *[None] * 7, "override", "resume"]
PROTOCOL_VERSION = 1  # of the command interface
STATES = ["disabled", "enabling", "testing", "running", "halting", "holding", "lowering", "stopping", "fault"]


def crc8(identifier, session, data):
    """CRC-8/SAE-J1850 over identifier, session and bytes 1 to 7."""
    crc = 0xFF
    for byte in bytes([identifier & 0xFF, identifier >> 8, session]) + bytes(data[1:8]):
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


class Desk:
    """What the computer knows, and how it writes it down."""

    def __init__(self, base=0x780):
        self.base, self.session, self.tick, self.parameters = base, 0, 0, None
        self.counter = [0] * 6
        self.state, self.fault, self.source = None, 0, 0
        self.effector, self.error, self.desired, self.records, self.counters = None, None, None, [], None
        self.scene, self.version = None, None

    def seal(self, message, payload, tag=0):
        self.counter[message] = (self.counter[message] + 1) % 16
        data = bytearray([0, self.counter[message] | tag << 4]) + payload
        data[0] = crc8(self.base + message, self.session, data)
        return self.base + message, bytes(data)

    def order(self, name):
        return self.seal(0, struct.pack("<BBHH", ORDERS.index(name), 0, self.tick & 0xFFFF, (self.parameters or 0) & 0xFFFF))

    def pair(self, message, values, unit, tag=0):
        return self.seal(message, b"".join(round(v / unit).to_bytes(3, "little", signed=True) for v in values), tag)

    def sample(self, position, velocity):
        self.counter[3] = self.counter[2]
        return [self.pair(2, position, 1e-6), self.pair(3, velocity, 1e-5)]

    def ask(self, subject, index=0):
        return self.seal(5, bytes([subject, index, 0, 0, 0, 0]))

    def hear(self, identifier, data):
        message = identifier - self.base
        if message == 0x10:
            if crc8(identifier, data[7], data) != data[0]:
                raise RuntimeError(f"Status with a wrong checksum: {data.hex()}")
            self.state, self.fault, self.source = STATES[data[1] >> 4], data[2], (data[3] >> 2) & 3
            self.tick, self.session = int.from_bytes(data[4:7], "little"), data[7]
        elif message == 0x11:
            self.records.append(data[0])
        elif message == 0x14:
            self.parameters = int.from_bytes(data[0:4], "little")
        elif message == 0x15:
            self.counters = struct.unpack("<HHHH", data)
        elif message == 0x16:
            self.effector = struct.unpack("<ff", data)
        elif message == 0x1C:
            self.scene, self.version = int.from_bytes(data[0:4], "little"), data[4]
            if self.version != PROTOCOL_VERSION:
                raise RuntimeError(f"the controller has version {self.version} of the interface, this program {PROTOCOL_VERSION}")
        elif message == 0x17:
            self.error = struct.unpack("<ff", data)
            self.desired = [a + b for a, b in zip(self.effector, self.error)] if self.effector else None


class Bus:
    FRAME = struct.Struct("<IB3x8s")

    def __init__(self, interface):
        self.socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.bind((interface,))
        self.socket.settimeout(10)

    def send(self, frame):
        self.socket.send(self.FRAME.pack(frame[0], 8, frame[1]))

    def hear(self, desk):
        """Until the next Status, and whatever else has come by then."""
        told = False
        while not told or select.select([self.socket], [], [], 0)[0]:
            identifier, size, data = self.FRAME.unpack(self.socket.recv(16))
            if desk.base <= identifier < desk.base + 32 and size == 8:
                desk.hear(identifier, data)
                told = told or identifier == desk.base + 0x10


def until(bus, desk, done, what, seconds=60):
    end = time.monotonic() + seconds
    while not done():
        bus.hear(desk)
        bus.send(desk.order("none"))
        if time.monotonic() > end or desk.fault:
            raise RuntimeError(f"no {what} within {seconds} s; state {desk.state}, fault {desk.fault}, "
                               f"obeyed, bad CRC, bad counter, refused: {desk.counters}")


def main():
    bus, desk, report = Bus(sys.argv[1]), Desk(), {"errors": [], "radii": []}
    dies = sys.argv[3:] == ["dies"]
    bus.hear(desk)
    bus.send(desk.ask(2))
    until(bus, desk, lambda: desk.parameters is not None, "the parameters")
    # Frames that must not move anything: another session, a damaged one, an old tick.
    wrong = bytearray(desk.order("arm")[1])
    wrong[4] ^= 1
    if crc8(desk.base, 0, wrong) == wrong[0]:  # of 255 sessions one: it would be an order without one, and refused as such
        wrong[4] ^= 3
    bus.send((desk.base, bytes(wrong)))
    before, desk.session = desk.session, desk.session % 255 + 1
    bus.send(desk.order("arm"))
    desk.session, tick = before, desk.tick
    desk.tick += 20000
    bus.send(desk.order("arm"))
    desk.tick = tick
    for _ in range(5):
        bus.hear(desk)
    report["after_wrong_frames"] = desk.state
    bus.send(desk.order("stream"))
    until(bus, desk, lambda: desk.source == 2, "the source")
    bus.hear(desk)
    bus.send(desk.order("arm"))
    until(bus, desk, lambda: desk.state == "running", "running")
    until(bus, desk, lambda: desk.effector is not None, "telemetry")
    x0, y0 = desk.effector
    report["start"] = [x0, y0]
    # A small one: a process that is not scheduled for some seconds goes straight on for so long.
    radius, centre, speed = 0.005, (x0 - 0.005, y0), 3.0
    target = (centre[0], centre[1] + radius)
    bus.send(desk.pair(1, target, 1e-6))
    until(bus, desk, lambda: desk.desired and math.dist(desk.desired, target) < 3e-6, "the way to the circle")
    report["at_set_point"] = [desk.desired[0] - centre[0], desk.desired[1] - centre[1] - radius]
    bus.hear(desk)
    first = last = desk.tick
    while desk.state == "running":
        t = (desk.tick - first) % 2**24 * 0.04  # 25 Hz
        if t > 2 * math.pi / speed or (dies and t > 1.0):
            break
        # The circle turns faster and faster in its first half second: a stream need not begin at rest, this one does.
        angle, rate = (math.pi / 2 + speed * (t * t if t < 0.5 else t - 0.25), speed * min(1.0, 2 * t))
        position = (centre[0] + radius * math.cos(angle), centre[1] + radius * math.sin(angle))
        velocity = (-radius * rate * math.sin(angle), radius * rate * math.cos(angle))
        for frame in desk.sample(position, velocity):
            bus.send(frame)
        if desk.error is not None:
            report["errors"].append(math.hypot(*desk.error))
            report["radii"].append(math.hypot(desk.desired[0] - centre[0], desk.desired[1] - centre[1]) - radius)
        last = desk.tick
        while desk.tick == last:
            bus.hear(desk)
    report["streamed_ticks"], report["state_after_stream"] = (last - first) % 2**24, desk.state
    if dies:
        until_silent(bus, desk)
    else:
        bus.send(desk.order("hold"))
        bus.hear(desk)
        bus.send(desk.order("disarm"))
        until(bus, desk, lambda: desk.state in ("disabled", "fault"), "disabled")
    bus.send(desk.ask(2))
    for _ in range(3):
        bus.hear(desk)
    report.update(state=desk.state, fault=desk.fault, records=desk.records, counters=desk.counters, protocol_version=desk.version)
    with open(sys.argv[2], "w", encoding="utf-8") as out:
        json.dump(report, out)
    return 0


def until_silent(bus, desk):
    """Says nothing and listens until the controller has noticed."""
    for _ in range(1000):
        if desk.state not in ("running", "halting", "holding", "lowering"):
            return
        bus.hear(desk)


if __name__ == "__main__":
    sys.exit(main())
