#!/usr/bin/python3
"""The comparison circle over a real vcan0 with the drives of one protocol: same digest as on the virtual bus, in one process
and in two, no fault, and either half notices the death of the other, in lockstep and against the clock. usage: protocol_test.py ESMC SCENE PROTOCOL"""
import json
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
SKIPPED = 77


def main():
    esmc, scene = (str(Path(a).resolve()) for a in sys.argv[1:3])
    protocol = sys.argv[3]
    with tempfile.TemporaryDirectory(dir=Path(esmc).parent) as folder:
        virtual = subprocess.run([esmc, "hil", scene, "--json", "--set", f"drives.protocol={protocol}"], capture_output=True, text=True)
        assert virtual.returncode == 0, virtual.stderr
        want = json.loads(virtual.stdout)
        assert want["tracking"]["settled_max_rad"] < 2e-3, want["tracking"]
        job = subprocess.run([HERE / "with_vcan", "--timeout", "300", "--", HERE / "protocol_job", esmc, scene, folder, protocol],
                             capture_output=True, text=True)
        if job.returncode == SKIPPED:
            print(job.stdout.strip())
            return SKIPPED
        if job.returncode != 0:
            print(job.stdout, job.stderr)
            return 1
        print(job.stdout.strip())
        for name in ("one", "plant"):
            got = json.loads((Path(folder) / name / "summary.json").read_text())
            for key in ("digest", "final_state", "ticks"):
                assert got[key] == want[key], f"{name}: {key} is {got[key]}, on the virtual bus {want[key]}"
        assert json.loads((Path(folder) / "controller" / "summary.json").read_text())["supervisor"]["faults"] == []
        print(f"{protocol}: digest {want['digest']}, {want['ticks']} ticks")
    return 0


if __name__ == "__main__":
    sys.exit(main())
