#!/usr/bin/python3
"""Both ends of CiA 402 against a CANopen stack that we did not write (npm canopen, which host_sim/setup tests fetches), over vcan0.
usage: canopen_test.py ESMC SCENE"""
import json
import math
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "vcan"))
import vcan  # noqa: E402

MODULES = HERE / "node_modules"


def base_angles(x, y):
    """Of the scene's five-bar, elbows outwards; leg 2 in its mirrored frame."""
    def leg(x, y):
        second = math.acos((x * x + y * y - 0.12**2 - 0.16**2) / (2 * 0.12 * 0.16))
        return math.atan2(y, x) - math.atan2(0.16 * math.sin(second), 0.12 + 0.16 * math.cos(second))
    return leg(x - 0.05, y), leg(-(x + 0.05), y)


def main():
    esmc, scene = (str(Path(a).resolve()) for a in sys.argv[1:3])
    if not shutil.which("node") or not (MODULES / "canopen").is_dir():
        print("SKIPPED: node or npm's canopen is missing; host_sim/setup tests provides them")
        return vcan.SKIPPED
    counts = [round(a / (2 * math.pi) * 2**20) for a in base_angles(0.0, 0.17)]
    with tempfile.TemporaryDirectory(dir=Path(esmc).parent) as folder:
        out = Path(folder)
        vcan.inside(HERE / "canopen_job", esmc, scene, folder, MODULES, *map(str, counts), VCAN_MEMORY_MB="1024")
        # Our controller on their slaves: set up, enabled, commanded, released.
        largest = {}
        for drive in json.loads((out / "slave.json").read_text()):
            node = drive["node"]
            assert drive["receives"] == [[0x200 + node, 255, 0x6040, 0x6071]], drive
            assert drive["transmits"] == [[0x180 + node, 1, 0x6041, 0x6064, 0x6077], [0x280 + node, 1, 0x606C, 0x6061]], drive
            assert drive["enabled"] and drive["controls"][-4:] == [6, 7, 15, 0], drive
            largest[node] = drive["largest"]
        # What holds the mechanism against gravity, in thousandths of 2 N m.
        run = json.loads((out / "controller.json").read_text())
        assert max(largest.values()) == round(run["torque"]["max_nm"] / 2.0 * 1000) > 10, (largest, run["torque"])
        assert run["supervisor"]["faults"] == [] and run["ticks"] == 20, run["supervisor"]
        # Their master on our emulated drives.
        seen = json.loads((out / "master.json").read_text())
        for node in ("1", "2"):
            assert seen["aborts"][node] == [0x06020000, 0x06090011, 0x06010002, 0x08000022], seen["aborts"]
            assert seen["rated"][node] == [2000, 10, 0x225], seen["rated"]
            assert [s for s in seen["states"][node] if s] == [0x40, 0x21, 0x23, 0x27], seen["states"]
            assert seen["heartbeats"][node][-1] == 5, seen["heartbeats"]
            assert abs(seen["positions"][node] - counts[int(node) - 1]) <= 2**20 // 100, (seen["positions"], counts)
        plant = json.loads((out / "plant.json").read_text())
        assert plant["ticks"] == 100 and plant["supervisor"]["faults"] == [], plant["supervisor"]
        for log in ("slave.log", "master.log"):
            bad = subprocess.run(["tshark", "-r", out / log, "-d", "can.subdissector,canopen", "-Y", "_ws.malformed"],
                                 capture_output=True, text=True)
            assert bad.returncode == 0 and not bad.stdout, bad.stdout[:300]
        print("controller on their slaves, their master on our drives:", run["ticks"], plant["ticks"], "ticks")
    return 0


if __name__ == "__main__":
    sys.exit(main())
