#!/usr/bin/python3
"""The loop over a real vcan0: same digest as on the virtual bus, and a candump log that an independent decoder reads
back to the values of log.csv. usage: loop_test.py ESMC SCENE"""
import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
SKIPPED = 77
# A stall of the machine can end a run by wall clock in many ways (old samples, a joint that ran away meanwhile); it
# cannot make these.
NOT_BY_STALLING = {"malformed_frame", "feedback_not_finite", "torque_not_finite", "bus_off", "loop_not_closed"}


def main():
    esmc, scene = (str(Path(a).resolve()) for a in sys.argv[1:3])
    with tempfile.TemporaryDirectory(dir=Path(esmc).parent) as folder:
        out = Path(folder)
        virtual = subprocess.run([esmc, "hil", scene, "--json", "--out", out / "virtual"], capture_output=True, text=True)
        assert virtual.returncode == 0, virtual.stderr
        job = subprocess.run([HERE / "with_vcan", "--timeout", "300", "--", HERE / "loop_job", esmc, scene, folder],
                             capture_output=True, text=True)
        if job.returncode == SKIPPED:
            print(job.stdout.strip())
            return SKIPPED
        if job.returncode != 0:
            print(job.stdout, job.stderr)
            return 1
        want = json.loads(virtual.stdout)
        for name in ("one", "plant", "late"):
            got = json.loads((out / name / "summary.json").read_text())
            for key in ("digest", "final_state", "ticks"):
                assert got[key] == want[key], f"{name}: {key} is {got[key]}, on the virtual bus {want[key]}"
        assert json.loads((out / "controller" / "summary.json").read_text())["supervisor"]["faults"] == []
        with open(out / "controller" / "log.csv", newline="", encoding="utf-8") as f:
            ages = list(csv.DictReader(f))
        for row in ages:  # lockstep: every sample is of its own tick, every torque acts at once
            for column in ("theta11_age_ticks", "theta21_age_ticks", "theta11_phase", "theta21_phase", "delay"):
                assert float(row[column]) == 0.0, (column, row[column])
        assert len(ages) == want["ticks"]
        realtime = json.loads((out / "realtime.json").read_text())
        faults = set(realtime["supervisor"]["faults"])
        print("realtime:", realtime["ticks"], "ticks, faults:", sorted(faults))
        assert realtime["late_ticks"] >= 0  # how many is the machine's business
        assert realtime["ticks"] == 50 and not faults & NOT_BY_STALLING, realtime["supervisor"]
        logs = [out / "virtual" / "frames.log", out / "one" / "frames.log", out / "plant" / "frames.log", out / "candump.log"]
        for log in logs:
            check = subprocess.run(
                [HERE / "decode_log.py", "--dbc", HERE / "odrive.dbc", "--frames", log, "--csv", out / "virtual" / "log.csv",
                 "--nodes", "1,2", "--angles", "theta11,theta21", "--torques", "tau11,tau21"], capture_output=True, text=True)
            print(log.relative_to(out), check.stdout.strip(), check.stderr.strip())
            if check.returncode != 0:
                return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
