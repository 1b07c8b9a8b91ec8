#!/usr/bin/python3
"""The loop over a real vcan0: same digest as on the virtual bus, and a candump log that an independent decoder reads
back to the values of log.csv, and to what was read of the drives' configuration. usage: loop_test.py ESMC SCENE"""
import csv
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import vcan

HERE = Path(__file__).resolve().parent
# What is read back before arming, and what the plant's drives of this scene answer: 50 rad/s are rev/s there, and 2 N m are A.
ENDPOINTS = {"config.enable_watchdog": ("bool", 1), "config.watchdog_timeout": ("float", 0.01),
             "controller.config.control_mode": ("uint8", 1), "controller.config.input_mode": ("uint8", 1),
             "controller.config.enable_torque_mode_vel_limit": ("bool", 0),
             "controller.config.vel_limit": ("float", 50 / (2 * math.pi)), "controller.config.enable_overspeed_error": ("bool", 1),
             "config.motor.torque_constant": ("float", 0.08), "config.motor.current_soft_max": ("float", 25.0)}


def decode(log, table, *more):
    check = subprocess.run(
        [HERE / "decode_log.py", "--dbc", HERE / "odrive.dbc", "--frames", log, "--csv", table,
         "--nodes", "1,2", "--angles", "theta11,theta21", "--torques", "tau11,tau21", *more], capture_output=True, text=True)
    print(log.relative_to(log.parent.parent), check.stdout.strip(), check.stderr.strip())
    return check


def read_back(esmc, scene, out):
    """Every question and answer about the configuration, decoded. A scene of its own: the table lies beside it."""
    (out / "asks.toml").write_text(Path(scene).read_text())
    numbered = [(f"axis0.{path}", 300 + 7 * i, kind, value) for i, (path, (kind, value)) in enumerate(ENDPOINTS.items())]
    (out / "flat.json").write_text(json.dumps(
        {"fw_version": "0.6.10", "endpoints": {path: {"id": number, "type": kind} for path, number, kind, _ in numbered}}))
    run = subprocess.run([esmc, "hil", out / "asks.toml", "--set", "drives.endpoints=flat.json", "--set", "drives.torque_constant=0.08",
                          "--set", "simulation.duration=0.1", "--out", out / "asks"], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    told = ",".join(f"{number}:{'f' if kind == 'float' else 'B'}:{value!r}" for _, number, kind, value in numbered)
    check = decode(out / "asks" / "frames.log", out / "asks" / "log.csv", "--endpoints", told)
    return check.returncode == 0 and f", {2 * len(ENDPOINTS)} endpoints" in check.stdout


def main():
    esmc, scene = (str(Path(a).resolve()) for a in sys.argv[1:3])
    with tempfile.TemporaryDirectory(dir=Path(esmc).parent) as folder:
        out = Path(folder)
        want = vcan.hil(esmc, scene, "--out", out / "virtual")
        if not read_back(esmc, scene, out):
            return 1
        vcan.inside(HERE / "loop_job", esmc, scene, folder)
        vcan.same_runs(out, ("one", "plant", "late"), want)
        with open(out / "controller" / "log.csv", newline="", encoding="utf-8") as f:
            ages = list(csv.DictReader(f))
        for row in ages:  # lockstep: every sample is of its own tick, every torque acts at once
            for column in ("theta11_age_ticks", "theta21_age_ticks", "theta11_phase", "theta21_phase", "delay"):
                assert float(row[column]) == 0.0, (column, row[column])
        assert len(ages) == want["ticks"]
        vcan.against_the_clock(out)
        logs = [out / "virtual" / "frames.log", out / "one" / "frames.log", out / "plant" / "frames.log", out / "candump.log"]
        for log in logs:
            if decode(log, out / "virtual" / "log.csv").returncode != 0:
                return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
