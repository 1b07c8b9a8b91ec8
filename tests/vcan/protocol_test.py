#!/usr/bin/python3
"""The comparison circle over a real vcan0 with the drives of one protocol: same digest as on the virtual bus, in one process
and in two, no fault, and either half notices the death of the other, in lockstep and against the clock. usage: protocol_test.py ESMC SCENE PROTOCOL"""
import sys
import tempfile
from pathlib import Path

import vcan


def main():
    esmc, scene = (str(Path(a).resolve()) for a in sys.argv[1:3])
    protocol = sys.argv[3]
    with tempfile.TemporaryDirectory(dir=Path(esmc).parent) as folder:
        want = vcan.hil(esmc, scene, "--set", f"drives.protocol={protocol}")
        assert want["tracking"]["settled_max_rad"] < 2e-3, want["tracking"]
        print(vcan.inside(vcan.HERE / "protocol_job", esmc, scene, folder, protocol).strip())
        vcan.same_runs(Path(folder), ("one", "plant"), want)
        print(f"{protocol}: digest {want['digest']}, {want['ticks']} ticks")


if __name__ == "__main__":
    main()
