#!/usr/bin/python3
"""Runs inside with_vcan: `esmc drive` as a program, spoken to by python3-can, with bytes packed here. What time it is plays
no part: the client counts the drive's own frames. At the end two of them are the drives of a controller, which proves their
watchdogs first. usage: drive_client.py ESMC SCENE"""
import csv
import json
import math
import re
import signal
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import can

NODE, HEARTBEAT, STATE, ENCODER, MODE, TORQUE, CLEAR = 5, 0x01, 0x07, 0x09, 0x0B, 0x0E, 0x18
ESMC, SCENE = sys.argv[1:3]


class Drive:
    """`esmc drive` while the block runs; afterwards `summary` is what it printed."""

    def __init__(self, protocol, *options, node=NODE):
        self.command = [ESMC, "drive", "--protocol", protocol, "--bus", "socketcan:vcan0", "--node", str(node), "--duration", "40",
                        "--json", *options]

    def __enter__(self):
        self.bus = can.Bus(interface="socketcan", channel="vcan0")
        self.process = subprocess.Popen(self.command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        return self

    def __exit__(self, kind, *_):
        self.process.send_signal(signal.SIGINT)
        out, err = self.process.communicate(timeout=20)
        self.bus.shutdown()
        if kind is None:
            assert self.process.returncode == 0 and err == "", (self.process.returncode, err)
            self.summary = json.loads(out)
            assert self.summary["interrupted"]

    def send(self, identifier, data=b"", remote=False, size=None):
        self.bus.send(can.Message(arbitration_id=identifier, data=None if remote else data, is_remote_frame=remote,
                                  dlc=size if remote else None, is_extended_id=False))

    def hear(self, identifier):
        while True:
            m = self.bus.recv(20)
            assert m is not None, f"nothing from {identifier:x}"
            if m.arbitration_id == identifier:
                return bytes(m.data)

    # ODrive
    def tell(self, command, data=b""):
        self.send(NODE << 5 | command, data)

    def torque(self, value):
        self.tell(TORQUE, struct.pack("<ff", value, 0.0))

    def heartbeat(self):
        error, state = struct.unpack("<IB", self.hear(NODE << 5 | HEARTBEAT)[:5])
        return error, state

    def encoder(self):
        return struct.unpack("<ff", self.hear(NODE << 5 | ENCODER))

    def fresh(self, samples=3):
        """Samples that the drive took after what it was told last."""
        while self.bus.recv(0) is not None:
            pass
        return [self.encoder() for _ in range(samples)][-1]

    def arm(self):
        self.encoder()
        self.tell(MODE, struct.pack("<II", 1, 1))
        self.tell(STATE, struct.pack("<II", 8, 0))
        while self.heartbeat() != (0, 8):
            pass


def odrive():
    with Drive("odrive", "--friction", "0.1", "--inertia", "1e-3", "--watchdog", "1") as d:
        assert d.heartbeat() == (0, 1)
        d.arm()
        for _ in range(300):  # 0.5 N m over 0.1 N m s/rad: 5 rad/s, with a time constant of 10 ms
            d.torque(0.5)
            speed = d.encoder()[1] * 2 * math.pi
        assert abs(speed - 5.0) < 1e-3, speed
        while True:  # nothing more is sent
            error, state = d.heartbeat()
            if error or state != 8:
                break
        assert (error, state) == (0x01000000, 1), (hex(error), state)
        d.tell(CLEAR, b"\0")
        d.arm()
        d.torque(math.nan)
        while d.heartbeat()[1] == 8:
            pass
    assert [e["closed_loop"] for e in d.summary["events"]].count(True) == 2, d.summary["events"]
    assert d.summary["max_torque_nm"] == 0.5 and d.summary["frames"]["commands"] > 300, d.summary


def odrive_0_5_is_fed_by_any_message():
    with Drive("odrive_0.5", "--watchdog", "1") as d:
        d.arm()
        for _ in range(200):  # 2 s of the drive's time
            d.tell(MODE, struct.pack("<II", 1, 1))
            assert d.heartbeat() == (0, 8)
        while d.heartbeat()[0] == 0:
            pass
    assert d.summary["state"]["error"] == 0x800


def defects():
    with Drive("odrive", "--watchdog", "0.2", "--defect", "watchdog_off", "--defect", "short_frames_stale") as d:
        d.arm()
        d.torque(1.5)
        for _ in range(50):
            assert d.heartbeat() == (0, 8)
        d.tell(TORQUE, b"\0\0\0")  # and the fourth byte of 1.5, 3F: 0.5
        d.fresh(10)
    assert d.summary["state"]["torque_nm"] == 0.5 and d.summary["defects"] == ["watchdog_off", "short_frames_stale"]
    with Drive("odrive", "--watchdog", "1", "--defect", "watchdog_any_frame") as d:
        d.arm()
        for _ in range(200):
            d.send(NODE << 5 | ENCODER, remote=True, size=8)
            assert d.heartbeat() == (0, 8)
    with Drive("odrive", "--watchdog", "1", "--defect", "timeout_stays_enabled", "--defect", "no_nan_check") as d:
        d.arm()
        d.torque(math.nan)
        for _ in range(200):
            assert d.heartbeat() == (0, 8)
    assert d.summary["max_torque_nm"] == 10.0 and d.summary["state"]["torque_nm"] == 0.0
    with Drive("odrive", "--watchdog", "0.2", "--defect", "latched_timeout") as d:
        d.arm()
        while d.heartbeat()[0] == 0:
            pass
        d.tell(CLEAR, b"\0")
        d.tell(STATE, struct.pack("<II", 8, 0))
        d.fresh(30)
    assert d.summary["state"] | {"closed_loop": False, "error": 0x01000000} == d.summary["state"]


def mit():
    def command(code):
        return struct.pack(">Q", (((0x8000 * 4096 + 0x800) * 4096) * 4096) * 4096 + code)

    special = lambda last: b"\xff" * 7 + bytes([last])
    with Drive("mit", "--friction", "0.5", "--inertia", "1e-3", "--watchdog", "0.5") as d:
        while True:  # it says nothing by itself, so it is called until it is there
            d.send(NODE, command(0x800))
            m = d.bus.recv(0.2)
            if m is not None:
                break
        while d.bus.recv(0.5) is not None:
            pass
        d.send(NODE, special(0xFC))
        reply = d.hear(0)
        assert len(reply) == 6 and reply[0] == NODE
        for _ in range(3000):  # 1.5 N m: code (1.5 + 18) 4095 / 36 = 2218; 3 rad/s, code (3 + 50) 4095 / 100 = 2170
            d.send(NODE, command(2218))
            reply = d.hear(0)
            speed = reply[3] * 16 + reply[4] // 16
            if speed >= 2169:
                break
        assert speed in (2169, 2170), speed
        assert reply[4] % 16 * 256 + reply[5] == 2218, "it gives what it was asked for"
        before = d.bus.recv(1.5)  # three time-outs of silence
        assert before is None, "it speaks when it is spoken to"
    s = d.summary
    assert s["state"]["closed_loop"] and s["state"]["torque_nm"] == 0.0 and abs(s["max_torque_nm"] - 1.49890) < 1e-4, s


def cia402():
    with Drive("cia402", "--rated-torque", "0.5") as d:
        assert d.hear(0x700 + NODE) == b"\0", "boot-up"
        d.send(0x600 + NODE, bytes.fromhex("4076600000000000"))
        assert d.hear(0x580 + NODE) == bytes.fromhex("43766000f4010000"), "500 mN m"


class Controlled:
    """Two drives on the bus and the controller of SCENE against the clock, which starves their watchdogs before it arms them.
    Ages may be seconds, because a machine may stall; 25 Hz, so that the drives have 20 s to be armed. Afterwards: `run`, the
    `drives`, and `frames`, what was on the bus as (identifier, bytes)."""

    def __init__(self, folder, *defects):
        seconds = {"limits.max_age_ticks": 100, "drives.heartbeat_timeout": 2.0, "drives.watchdog_timeout": 1.0, "control.rate_hz": 25,
                   "control.law": "ctc", "control.lambda": 5.0, "reference.speed": 1.0, "mechanism.gravity": 0,
                   "simulation.duration": 2.0, "drives.watchdog_test": "true"}
        told = [part for key, value in seconds.items() for part in ("--set", f"{key}={value}")]
        start = ("--rate", "25", "--watchdog", "1", "--friction", "0.02", "--inertia", "1e-3")
        recorder = subprocess.Popen(["candump", "-r", "4000000", "-L", "vcan0"], stdout=open(folder / "frames", "w"))
        self.drives = [Drive("odrive", *start, "--angle", angle, *more, node=node)
                       for node, angle, more in ((1, "0.339", ()), (2, "1.313", defects))]
        with self.drives[0] as first, self.drives[1]:
            first.hear(1 << 5 | HEARTBEAT)
            self.run = subprocess.run([ESMC, "controller", SCENE, "--realtime", "--bus", "socketcan:vcan0", "--json", "--out",
                                       folder / "out", *told], capture_output=True, text=True, timeout=100)
        recorder.terminate()
        recorder.wait()
        lines = [line.split()[2].split("#") for line in (folder / "frames").read_text().splitlines()]
        self.frames = [(int(head, 16), bytes.fromhex(data)) for head, data in lines]

    def said(self, node):
        """What a drive reported and was told, in order: ("is", error, state) and ("torque", N m)."""
        for identifier, data in self.frames:
            if identifier == (node << 5 | HEARTBEAT):
                yield ("is", *struct.unpack("<IB", data[:5]))
            elif identifier == (node << 5 | TORQUE):
                yield "torque", struct.unpack("<f", data[:4])[0]


def attempted(check):
    """A machine that stalls for longer than the limits gets two more attempts."""
    for attempt in (1, 2, 3):
        try:
            with tempfile.TemporaryDirectory() as folder:
                return check(Path(folder))
        except Exception as error:  # whatever a frame that is missing leads to
            if attempt == 3:
                raise
            print("again:", repr(error)[:300], flush=True)


def watchdog_that_is_starved(folder):
    """Each drive is armed, hears nothing, trips and says so; then it is armed anew, and the run goes to its end."""
    c = Controlled(folder)
    assert c.run.returncode == 0 and json.loads(c.run.stdout)["supervisor"]["faults"] == [], (c.run.stdout, c.run.stderr)
    for node, drive in zip((1, 2), c.drives):
        said = list(c.said(node))
        trip = said.index(("is", 0x01000000, 1))
        before, after = said[:trip], said[trip:]
        assert before.count(("is", 0, 8)) >= 2 and not any(what[0] == "torque" and what[1] != 0 for what in before), before
        armed = after.index(("is", 0, 8))
        first = next(i for i, what in enumerate(after) if what[0] == "torque" and what[1] != 0)
        assert first > armed and ("is", 0x01000000, 1) not in after[armed:], after
        assert not drive.summary["state"]["closed_loop"] and drive.summary["max_torque_nm"] > 0, drive.summary
    log_of_real_time(folder / "out" / "log.csv")


def log_of_real_time(path):
    """What docs/output.md says of a controller against the clock: how old a sample was, and how long until the torque was sent."""
    with open(path, newline="", encoding="utf-8") as f:
        rows = list(csv.DictReader(f))
    assert len(rows) == 50, len(rows)
    columns = {name: [float(row[name]) for row in rows] for name in ("theta11_phase", "theta21_phase", "delay")}
    for name, values in columns.items():
        assert all(math.isfinite(v) and v >= 0 for v in values) and max(values) > 0, (name, values)


def watchdog_that_is_off(folder):
    """One of two is enough: nothing is armed, no torque is ever sent, and both drives are idle in the end."""
    c = Controlled(folder, "--defect", "watchdog_off")
    assert c.run.returncode == 1 and "refused to arm: drive_configuration" in c.run.stderr, (c.run.stdout, c.run.stderr)
    for node, drive in zip((1, 2), c.drives):
        said = list(c.said(node))
        assert ("is", 0, 8) in said and not any(what[0] == "torque" and what[1] != 0 for what in said), said
        assert not drive.summary["state"]["closed_loop"] and drive.summary["max_torque_nm"] == 0, drive.summary
        assert (("is", 0x01000000, 1) in said) == (node == 1), said


def watchdogs():
    attempted(watchdog_that_is_starved)
    attempted(watchdog_that_is_off)


def refusals():
    def says(words, *options):
        run = subprocess.run([ESMC, "drive", "--bus", "socketcan:vcan0", *options], capture_output=True, text=True)
        assert run.returncode == 2 and run.stderr.count("\n") == 1 and words in run.stderr, (run.returncode, run.stderr)

    says("--defect nonsense: unknown, allowed are watchdog_off, ", "--protocol", "odrive", "--defect", "nonsense")
    says("--defect no_nan_check: not with protocol mit", "--protocol", "mit", "--defect", "no_nan_check")
    says("--node 63: must be from 0 to 62", "--protocol", "odrive", "--node", "63")
    says("--inertia 0: must be > 0", "--protocol", "mit", "--inertia", "0")
    says("--load nan: must be", "--protocol", "mit", "--load", "nan")
    says("--protocol", "--protocol", "canopen")


def defects_as_listed():
    """The drives that `--help` and the page name for a defect are those that can be given it."""
    listed = subprocess.run([ESMC, "drive", "--help"], capture_output=True, text=True).stdout.split("Defects for --defect:\n")[1]
    page = (Path(__file__).resolve().parents[2] / "docs/drives.md").read_text(encoding="utf-8")
    lines = listed.strip().splitlines()
    table = page.split("`--defect NAME`")[1].split("\n\n")[1]
    assert len(lines) == len(re.findall(r"^\| `\w+` \|", table, re.M)) > 0, listed
    for line in lines:
        name, drives = re.fullmatch(r" *(\w+) +.* \(([a-z0-9_., ]+)\)", line).groups()
        assert f"\n| `{name}` | {drives} |" in page, line
        for protocol in ("odrive", "odrive_0.5", "mit", "cia402"):
            run = subprocess.run([ESMC, "drive", "--bus", "socketcan:nosuchcan0", "--protocol", protocol, "--defect", name],
                                 capture_output=True, text=True)
            refused = f"--defect {name}: not with protocol {protocol}," in run.stderr
            assert run.returncode == 2 and refused != (protocol in drives.split(", ")), (line, run.stderr)


for case in (refusals, defects_as_listed, odrive, odrive_0_5_is_fed_by_any_message, defects, mit, cia402, watchdogs):
    case()
    print("ok", case.__name__, flush=True)
