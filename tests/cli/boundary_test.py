#!/usr/bin/python3
"""Every working mode up to the workspace boundary, where leg 1 is nearly stretched: tracked as well as anywhere while the
guard allows it, and named where it does not. usage: boundary_test.py ESMC"""
import math

from command import CIRCLE, Case, main, sets

L1, L2, HALF_BASE, LIMIT = 0.12, 0.16, 0.05, 0.02  # of the scene; the last one is limits.min_abs_sin_type1


def near_boundary(sine):
    """A point at which |sin theta_12| = sine, 110 degrees up from the base of leg 1."""
    reach = math.sqrt(L1**2 + L2**2 + 2 * L1 * L2 * math.sqrt(1 - sine**2))
    angle = math.radians(110)
    return HALF_BASE + reach * math.cos(angle), reach * math.sin(angle)


class Boundary(Case):
    def run_to(self, sine, mode, code=0):
        x, y = near_boundary(sine)
        free = self.tmp / "free.toml"  # the assembly mode follows from the start in each working mode
        free.write_text("\n".join(line for line in CIRCLE.read_text().splitlines() if not line.startswith("assembly_mode")))
        line = f'reference={{type="line", from=[-0.03, 0.2], to=[{x!r}, {y!r}], duration=1.0}}'
        return self.document("sim", free, *sets(f"mechanism.working_mode={mode}", line, "simulation.duration=1.2", "mechanism.gravity=0"), code=code)

    def fault(self, sine, mode):
        return [f["name"] for f in self.run_to(sine, mode, code=1)["supervisor"]["faults"]]

    def test_every_mode_up_to_the_boundary(self):
        for mode in ('["+","+"]', '["+","-"]', '["-","+"]'):
            for sine in (0.1, 0.05, 0.03):
                d = self.run_to(sine, mode)
                self.assertEqual(d["supervisor"]["faults"], [], (mode, sine))
                self.assertLess(d["tracking"]["settled_max_m"], 1e-7, (mode, sine))
            self.assertEqual(self.fault(LIMIT / 2, mode), ["type1_singularity"], mode)
        # With both elbows inwards this line crosses type 2 first: refused by name, too.
        self.assertEqual(self.fault(0.1, '["-","-"]'), ["type2_singularity"])


if __name__ == "__main__":
    main()
