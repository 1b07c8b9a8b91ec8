#!/usr/bin/python3
"""--mcap and --log npy against log.csv of the same run, value by value: read by @mcap/core, and by numpy.
usage: mcap_test.py ESMC SCENES_DIR"""
import csv
import json
import math
import struct
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

import numpy

HERE = Path(__file__).resolve().parent
SKIPPED = 77


def rows_of(file):
    with open(file, newline="", encoding="ascii") as f:
        return list(csv.DictReader(f))


def same(text, value):
    """A field of log.csv, and a number of a JSON message: the same double; null for what is not finite."""
    number = float(text)
    return value is None if not math.isfinite(number) else number == value


def checksums(file):
    """CRC of the data section and of the summary, as the specification has them, from the end of the file."""
    data = file.read_bytes()
    assert data[:8] == data[-8:] == b"\x89MCAP0\r\n"
    footer = len(data) - 8 - 29
    op, length, summary, offsets, crc = struct.unpack_from("<BQQQI", data, footer)
    assert (op, length) == (2, 20) and summary <= offsets <= footer, (op, length)
    assert zlib.crc32(data[summary:footer + 25]) == crc, "summary"
    order, at, starts = [], summary, {}
    while at < offsets:
        op, length = struct.unpack_from("<BQ", data, at)
        if op not in order[-1:]:
            order.append(op)
            starts[op] = at
        at += 9 + length
    assert at == offsets and order == sorted(set(order), key=order.index) and set(order) == {3, 4, 8, 11}, order
    while at < footer:
        op, length, group, start, size = struct.unpack_from("<BQBQQ", data, at)
        assert (op, length, start) == (14, 17, starts[group]) and size > 0, group
        at += 9 + length
    end = summary - 13
    assert struct.unpack_from("<BQ", data, end) == (15, 4)
    assert zlib.crc32(data[:end]) == struct.unpack_from("<I", data, end + 9)[0], "data"


def read(mcap):
    """(what its index says, by topic its messages as (ns, values)) of a sound file."""
    checksums(mcap)
    lines = subprocess.run(["node", HERE / "mcap_dump.js", mcap], check=True, capture_output=True, text=True).stdout.splitlines()
    head, *messages, tail = map(json.loads, lines)
    assert tail["done"] and tail["found"]["Footer"] == 1 and tail["found"]["Chunk"] == head["chunks"] > 0, tail
    assert head["messages"] == len(messages), head
    assert all(t["encoding"] == "json" and t["of"] == "jsonschema" for t in head["topics"].values()), head["topics"]
    by_topic = {t: [] for t in head["topics"]}
    for m in messages:
        assert m["sequence"] == len(by_topic[m["topic"]]), m
        values = json.loads(m["text"])
        assert set(values) == set(head["topics"][m["topic"]]["schema"]["properties"]), m
        by_topic[m["topic"]].append((int(m["ns"]), values))
    return head, by_topic


def live(esmc, scene, folder):
    """The bench: a row for each tick, from its start on."""
    mcap = Path(folder, "live.mcap")
    r = subprocess.run([esmc, "live", scene, "--duration", "1.5", "--mcap", mcap, "--json"], check=True, capture_output=True, text=True)
    summary, (_, by_topic) = json.loads(r.stdout), read(mcap)
    rows = by_topic["/effector"]
    assert summary["samples_dropped"] == 0 and len(rows) == summary["ticks"] > 1000, (len(rows), summary)
    assert all(round(v["t"] * 1e9) - round(rows[0][1]["t"] * 1e9) == ns - rows[0][0] for ns, v in rows)
    states = [v["state"] for _, v in by_topic["/controller"]]
    assert "running" in states and set(by_topic) >= {"/joints", "/torques", "/sliding"}, set(by_topic)
    # The effector of the drawing is that of the joints: leg 1 from its base.
    scene_legs = (0.05, 0.12, 0.16)
    for (_, e), (_, j) in list(zip(rows, by_topic["/joints"]))[::100]:
        outer = j["theta11"] + j["theta12"]
        x = scene_legs[0] + scene_legs[1] * math.cos(j["theta11"]) + scene_legs[2] * math.cos(outer)
        assert abs(x - e["x"]) < 1e-9, (x, e)
    print(f"live: {len(rows)} rows")


def compare(esmc, command, scene, folder, every=1):
    out, mcap = Path(folder, "out"), Path(folder, "run.mcap")
    subprocess.run([esmc, command, scene, "--out", out, "--mcap", mcap, "--log-every", str(every), "--json"], check=True, capture_output=True)
    head, by_topic = read(mcap)
    assert head["chunks"] > 1, head
    rows = rows_of(out / "log.csv")
    columns = set()
    for topic in set(by_topic) - {"/can"}:
        found = by_topic[topic]
        assert len(found) == len(rows) > 0, (topic, len(found), len(rows))
        begin = found[0][0]
        for row, (ns, values) in zip(rows, found):
            columns |= set(values)
            assert ns - begin == round(float(row["t"]) * 1e9), (topic, row["t"], ns)
            for name, value in values.items():
                assert value == row[name] if name == "state" else same(row[name], value), (topic, name, row[name], value)
    assert columns == set(rows[0]), columns ^ set(rows[0])
    if command == "hil":
        frames = (out / "frames.log").read_text(encoding="ascii").splitlines()
        assert len(frames) == len(by_topic["/can"]) > 8000
        for line, (_, f) in zip(frames, by_topic["/can"]):
            identifier = f"{f['id']:08X}" if f["kind"].startswith("extended") else f"{f['id']:03X}"
            assert line.split()[2] == f"{identifier}#{f['data']}", (line, f)
    print(f"{command}, every {every}: {len(rows)} rows, {head['messages']} messages on {len(by_topic)} topics, {head['chunks']} chunks, "
          f"{mcap.stat().st_size} bytes")


def npy(esmc, command, scene, folder, *options):
    text, binary = Path(folder, "text"), Path(folder, "binary")
    for out, form in ((text, "csv"), (binary, "npy")):
        subprocess.run([esmc, command, scene, "--out", out, "--log", form, "--json", *options], check=True, capture_output=True)
    assert not (binary / "log.csv").exists()
    rows, log = rows_of(text / "log.csv"), numpy.load(binary / "log.npy", allow_pickle=False)
    assert log.dtype.names == tuple(rows[0]) and log.shape == (len(rows),), (log.dtype, log.shape)
    for name in log.dtype.names:
        if name == "state":
            assert [s.decode() for s in log[name]] == [r[name] for r in rows]
        else:
            wanted = numpy.array([float(r[name]) for r in rows])
            assert numpy.array_equal(log[name], wanted, equal_nan=True), name
    size, per_row = (binary / "log.npy").stat().st_size, log.dtype.itemsize
    print(f"{command} {' '.join(options)}: log.npy is log.csv, {len(rows)} rows of {per_row} bytes; 200 s of it would be {per_row * 2e5 / 1e6:.1f} MB")
    assert per_row * 2e5 < 75e6 and size < per_row * len(rows) + 4096
    for reader, needs in (("compare", "log.csv is needed"), ("replay", "log.csv is needed"), ("identify", "log.csv is needed"), ("calibrate", "log.csv is needed")):
        r = subprocess.run([esmc, reader, binary, *([text] if reader == "compare" else [])], capture_output=True, text=True)
        assert r.returncode == 2 and needs in r.stderr and r.stderr.count("\n") == 1, (reader, r)


def refusals(esmc, scene, folder):
    for options, why in ((["--mcap", folder], "not a regular file"), (["--mcap", folder + "/none/x"], "cannot be written"),
                         (["--log", "npy"], "no --out"), (["--log-every", "0"], "--log-every"), (["--log", "xml"], "--log")):
        r = subprocess.run([esmc, "sim", scene, *options], capture_output=True, text=True)
        assert r.returncode == 2 and why in r.stderr and r.stderr.count("\n") == 1 and not r.stdout, (options, r)
    # What fails leaves no file.
    r = subprocess.run([esmc, "sim", scene, "--set", 'effects=[{type="viscous_friction", coefficient=[50.0, 50.0]}]', "--mcap", folder + "/failed.mcap"], capture_output=True, text=True)
    assert r.returncode != 0 and not list(Path(folder).glob("failed*")), (r, list(Path(folder).iterdir()))
    out = folder + "/every"
    subprocess.run([esmc, "sim", scene, "--out", out, "--log-every", "7", "--json"], check=True, capture_output=True)
    r = subprocess.run([esmc, "replay", out], capture_output=True, text=True)
    assert r.returncode == 2 and "--log-every 1" in r.stderr, r


def main():
    esmc, scenes = (str(Path(a).resolve()) for a in sys.argv[1:])
    circle, line = scenes + "/five_bar_circle.toml", scenes + "/rr_line.toml"
    with tempfile.TemporaryDirectory() as folder:
        npy(esmc, "hil", circle, folder)
    with tempfile.TemporaryDirectory() as folder:
        npy(esmc, "sim", line, folder, "--log-every", "3")
    with tempfile.TemporaryDirectory() as folder:
        refusals(esmc, circle, folder)
    if not (HERE / "node_modules/@mcap/core").exists():
        print("SKIPPED: no @mcap/core (host_sim/setup tests fetches it)")
        return SKIPPED
    for command, scene, every in (("hil", circle, 1), ("sim", line, 1), ("sim", circle, 5)):
        with tempfile.TemporaryDirectory() as folder:
            compare(esmc, command, scene, folder, every)
    with tempfile.TemporaryDirectory() as folder:
        live(esmc, circle, folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
