#!/usr/bin/python3
"""Every working mode up to the workspace boundary, where leg 1 is nearly stretched: tracked as well as anywhere while the
guard allows it, and named where it does not. usage: boundary_test.py ESMC SCENE"""
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

L1, L2, HALF_BASE, LIMIT = 0.12, 0.16, 0.05, 0.02  # of the scene; the last one is limits.min_abs_sin_type1


def near_boundary(sine):
    """A point at which |sin theta_12| = sine, 110 degrees up from the base of leg 1."""
    reach = math.sqrt(L1**2 + L2**2 + 2 * L1 * L2 * math.sqrt(1 - sine**2))
    angle = math.radians(110)
    return HALF_BASE + reach * math.cos(angle), reach * math.sin(angle)


def run(esmc, scene, mode, sine):
    x, y = near_boundary(sine)
    line = f'reference={{type="line", from=[-0.03, 0.2], to=[{x!r}, {y!r}], duration=1.0}}'
    done = subprocess.run([esmc, "sim", scene, "--json", "--set", f"mechanism.working_mode={mode}", "--set", line,
                           "--set", "simulation.duration=1.2", "--set", "mechanism.gravity=0"], capture_output=True, text=True)
    assert done.stdout, done.stderr
    return json.loads(done.stdout)


def main():
    esmc, scene = sys.argv[1:3]
    with tempfile.TemporaryDirectory() as folder:
        free = Path(folder) / "free.toml"  # the assembly mode follows from the start in each working mode
        free.write_text("\n".join(line for line in Path(scene).read_text().splitlines() if not line.startswith("assembly_mode")))
        for mode in ('["+","+"]', '["+","-"]', '["-","+"]'):
            for sine in (0.1, 0.05, 0.03):
                d = run(esmc, free, mode, sine)
                assert d["supervisor"]["faults"] == [], (mode, sine, d["supervisor"])
                assert d["tracking"]["settled_max_m"] < 1e-7, (mode, sine, d["tracking"])
            assert [f["name"] for f in run(esmc, free, mode, LIMIT / 2)["supervisor"]["faults"]] == ["type1_singularity"], mode
        # With both elbows inwards this line crosses type 2 first: refused by name, too.
        assert [f["name"] for f in run(esmc, free, '["-","-"]', 0.1)["supervisor"]["faults"]] == ["type2_singularity"]


if __name__ == "__main__":
    main()
