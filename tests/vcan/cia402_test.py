#!/usr/bin/python3
"""CiA 402 over a real vcan0: same digest as on the virtual bus, and logs that tshark dissects as CANopen without a
malformed frame. usage: cia402_test.py ESMC SCENE"""
import math
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import vcan


def dissect(log, fields, wanted=""):
    filtered = ["-Y", wanted] if wanted else []
    columns = [part for field in fields for part in ("-e", field)]
    done = subprocess.run(["tshark", "-r", log, "-d", "can.subdissector,canopen", *filtered, "-T", "fields", *columns],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [line.split("\t") for line in done.stdout.splitlines()]


def check_frames(log):
    """Nothing malformed, nothing that is not CANopen, and of every kind what the protocol needs."""
    lines = sum(1 for _ in open(log, encoding="ascii"))
    protocols = dissect(log, ["frame.protocols", "_ws.malformed", "can.id"])
    assert len(protocols) == lines > 10000, (len(protocols), lines)
    # A frame without data (SYNC) is not handed on to the dissector of its content.
    bad = [p for p in protocols if "malformed" in p[0] or p[1] or ("canopen" not in p[0] and int(p[2], 0) != 0x080)]
    assert not bad, bad[:3]
    kinds = Counter(int(p[2], 0) & 0x780 for p in protocols)
    # SDO requests and replies come in pairs; a command and two reports per SYNC and axis once it runs.
    assert kinds[0x580] == kinds[0x600] > 100, kinds
    assert kinds[0x180] == kinds[0x280] >= 4000 and kinds[0x200] >= 4000, kinds
    aborts = dissect(log, ["canopen.sdo.abort_code"], "canopen.sdo.abort_code")
    assert not aborts, aborts[:3]
    print(f"{log.parent.name}/{log.name}: {lines} frames, kinds", {f"{k:03X}": n for k, n in sorted(kinds.items())})


def check_values(log, table):
    """Bytes of the PDOs, read here, against the log of the run: positions to half a count, torques to half a LSB."""
    rows = [line.split(",") for line in open(table, encoding="ascii").read().splitlines()]
    column = {name: i for i, name in enumerate(rows[0])}
    rows = rows[1:]
    data = [line.split()[2].split("#") for line in open(log, encoding="ascii")]
    data = [(int(head, 16), bytes.fromhex(tail)) for head, tail in data]
    for node, angle, torque in ((1, "theta11", "tau11"), (2, "theta21", "tau21")):
        reports = [d for i, d in data if i == 0x180 + node]
        commands = [d for i, d in data if i == 0x200 + node]
        # t = 0 is the third report that says operation enabled.
        first = [i for i, d in enumerate(reports) if int.from_bytes(d[0:2], "little") & 0x6F == 0x27][2]
        skipped = len(commands) - len(reports)
        for tick, row in enumerate(rows):
            turns = int.from_bytes(reports[first + tick][2:6], "little", signed=True) / 2**20
            assert abs(2 * math.pi * turns - float(row[column[angle]])) < 1.01 * math.pi / 2**20, (node, tick)
        # The commands that follow those reports; what is sent after the run is zero.
        start = next(i for i, c in enumerate(commands) if c[2:4] != b"\0\0")
        sent = [int.from_bytes(c[2:4], "little", signed=True) for c in commands[start:start + len(rows)]]
        told = [float(row[column[torque]]) / 2.0 * 1000 for row in rows]  # rated torque 2 N m, thousandths of it
        assert max(abs(a - b) for a, b in zip(sent, told)) < 1e-6, (node, skipped)


def main():
    esmc, scene = (str(Path(a).resolve()) for a in sys.argv[1:3])
    with tempfile.TemporaryDirectory(dir=Path(esmc).parent) as folder:
        out = Path(folder)
        want = vcan.hil(esmc, scene, "--set", "drives.protocol=cia402", "--out", out / "virtual")
        check_frames(out / "virtual" / "frames.log")
        check_values(out / "virtual" / "frames.log", out / "virtual" / "log.csv")
        vcan.inside(vcan.HERE / "cia402_job", esmc, scene, folder)
        vcan.same_runs(out, ("one", "plant", "late"), want)
        for log in (out / "one" / "frames.log", out / "plant" / "frames.log", out / "candump.log"):
            check_frames(log)
        vcan.against_the_clock(out, "drive_configuration", "foreign_controller")


if __name__ == "__main__":
    main()
