#!/usr/bin/env python3
"""`esmc identify` on random scenes. usage: identify.py ESMC write|misfits|clean [COUNT [SEED]]

write    A run whose controller believes masses and inertias that are wrong and knows neither friction, one that depends on the direction in some, nor the
         rotor at the elbow of some arms; identify --write; the scene written, on this and on another motion, against a controller that knows the truth
         and against the one that was wrong. Where exact knowledge itself is worse than what was wrong, what was written may be, too.
misfits  Logs with two random defects: how many intervals hold the truth or belong to a log that names a misfit or is refused.
clean    Logs without a defect: how many name one.

The truth is that of the scene. Two defects have no key and change the log, which they explain exactly: a torque constant and an eccentric encoder."""
import json
import math
import random
import statistics
import sys
import tempfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "cli"))
from command import ARM, MORE, esmc, read_table, sets  # noqa: E402
from identify_test import NOMINAL, leg_text, standard, true_values_of  # noqa: E402
from log_bench import write_table  # noqa: E402

DEFECTS = ("direction", "cogging", "torque_constant", "eccentric", "gear_spring", "rotor")


class Draw:
    """A random mechanism with its friction, sensors and motion."""

    def __init__(self, seed):
        self.random = r = random.Random(seed)
        u = r.uniform
        self.seed, self.rr = seed, r.random() < 0.4
        around = lambda **usual: {k: v * u(0.85, 1.15) for k, v in usual.items()}
        one = around(l1=0.30, l2=0.25, lg1=0.15, lg2=0.11, m1=1.2, m2=0.8, J1=1e-2, J2=4.5e-3) if self.rr else \
            around(l1=0.12, l2=0.16, lg1=0.06, lg2=0.068, m1=0.1, m2=0.1, J1=2e-4, J2=7e-4)
        self.legs = [one] if self.rr else [one, {k: v * u(0.95, 1.05) for k, v in one.items()}]
        scale = 10 if self.rr else 1
        self.viscous = [x * scale * u(0.3, 1.5) for x in (0.01, 0.002)] if self.rr else [x * u(0.3, 1.5) for x in (0.01, 0.002, 0.01, 0.002)]
        self.coulomb = [x * scale * u(0.0, 1.5) for x in (0.02, 0.006)] if self.rr else [x * u(0.0, 1.5) for x in (0.02, 0.004, 0.02, 0.004)]
        self.delay = u(0.1, 1.5)
        self.bits, self.noise = r.choice((14, 15, 16, 17, 18)), u(0, 4e-5)
        self.asymmetry, self.rotor, self.gear, self.more_effects, self.edits = [0.0] * len(self.viscous), [0.0, 0.0], 0.0, [], []
        self.belief = {k: u(0.8, 1.25) for k in ("m1", "m2", "J1", "J2")}
        self.motions = [self.motion(), self.motion()]

    def motion(self):
        u = self.random.uniform
        if self.rr:
            offset, amplitude, omega = [u(0.0, 0.6), u(1.3, 1.7)], [u(0.4, 0.6), u(0.5, 0.8)], [u(4, 6), u(7, 10)]
        else:
            offset, amplitude, omega = [u(0.85, 1.05), u(0.85, 1.05)], [u(0.3, 0.45), u(0.3, 0.45)], [u(7, 11), u(12, 16)]
        return f'reference={{type="joint_sine", offset={offset}, amplitude={amplitude}, omega={omega}, phase=[0.0, {u(0.5, 1.5)}], join=0.3}}'

    def scene(self, folder):
        """The scene file: that of the arm or of the five-bar with these bars."""
        bars = "leg = " + leg_text(self.legs[0]) if self.rr else f"legs = [{leg_text(self.legs[0])}, {leg_text(self.legs[1])}]"
        lines = []
        for line in (ARM if self.rr else NOMINAL).read_text(encoding="utf-8").split("[[effects]]")[0].splitlines():
            if line.startswith("leg = "):
                line = bars + (f"\nrotor_inertia = {self.rotor}" if any(self.rotor) else "")
            lines.append(line)
        path = folder / "scene.toml"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    def sets(self, model, motion=0):
        dry = f', asymmetry={self.asymmetry}' if any(self.asymmetry) else ""
        effects = [f'{{type="viscous_friction", coefficient={self.viscous}}}', f'{{type="coulomb_friction", torque={self.coulomb}{dry}}}',
                   f'{{type="compute_delay", time={self.delay * 1e-3}}}', f'{{type="encoder", bits={self.bits}}}', f'{{type="noise", sigma={self.noise}}}']
        values = ["effects=[" + ", ".join([*effects, *self.more_effects]) + "]", self.motions[motion], "control.delay_ticks=3", "simulation.duration=4.0"]
        if self.rr:
            values.append("control.gain=60")
        if self.gear:
            values += ["simulation.step=5e-5", "control.lambda=20", "control.gain=25", "limits.feedback_jump=0"]  # springs are stiff to integrate, soft to control
        return [*sets(*values, *([model] if model else [])), "--seed", self.seed]

    def wrong(self):
        """Masses and inertias that are wrong, no rotor and no friction."""
        leg = lambda p: "{" + ", ".join(f"{k}={v * self.belief.get(k, 1)!r}" for k, v in p.items()) + "}"
        bars = f"leg={leg(self.legs[0])}" if self.rr else f"half_base=0.05, legs=[{leg(self.legs[0])}, {leg(self.legs[1])}]"
        kind = 'type="rr", working_mode=["+"]' if self.rr else 'type="five_bar", working_mode=["+", "+"]'
        return f"control.model={{mechanism={{{kind}, gravity=9.8, {bars}}}}}"

    def truth(self):
        out = {"m0": 0.0} | (standard(*self.legs) if self.rr else true_values_of(*self.legs))
        for i, n in enumerate(("1", "2") if self.rr else ("11", "12", "21", "22")):
            out |= {f"viscous theta{n}": self.viscous[i], f"coulomb theta{n}": self.coulomb[i]}
        for n in ("",) if self.rr else ("1", "2"):
            out["a" + n] += self.gear  # a rotor turns with bar 1
        return out

    # ---- defects

    def defects(self, count, of=DEFECTS):
        chosen = [d for d in self.random.sample(of, len(of)) if d != "rotor" or self.rr][:count]  # the five-bar's elbows have no motors
        for d in chosen:
            self.add(d)
        return chosen

    def add(self, defect):
        u, scale = self.random.uniform, 10 if self.rr else 1
        joints = len(self.viscous)
        if defect == "direction":
            joint = self.random.randrange(joints)
            self.coulomb[joint] = max(self.coulomb[joint], 0.2 * scale * (0.02, 0.004)[joint % 2])
            self.asymmetry[joint] = self.random.choice((-1, 1)) * u(0.15, 0.5) * self.coulomb[joint]
        elif defect == "cogging":
            self.more_effects.append(f'{{type="torque_ripple", amplitude={u(0.004, 0.03) * scale}, per_turn={self.random.randint(3, 60)}}}')
        elif defect == "torque_constant":
            self.edits.append(("constant", self.random.choice((-1, 1)) * u(0.02, 0.1)))
        elif defect == "eccentric":
            self.edits.append(("eccentric", self.random.randrange(2), u(1e-3, 5e-3), u(0, 2 * math.pi)))
        elif defect == "gear_spring":
            k, J = 10 ** u(2.0, 3.3) * scale, 1e-4 * scale * u(0.5, 2)
            self.more_effects.append(f'{{type="joint_flexibility", stiffness={k}, damping={0.1 * math.sqrt(k * J)}, rotor_inertia={J}}}')
            self.gear = J
        else:
            self.rotor[1] = u(2, 20) * 1e-3


def edit(draw, path):
    """Two defects that have no key, in the log."""
    joints, torques = (("theta1", "theta2"), ("tau1_cmd", "tau2_cmd")) if draw.rr else (("theta11", "theta21"), ("tau11_cmd", "tau21_cmd"))
    rows = read_table(path)
    for kind, *what in draw.edits:
        for row in rows:
            if kind == "constant":
                row[torques[1]] = repr(float(row[torques[1]]) / (1 + what[0]))
            else:
                row[joints[what[0]] + "_meas"] = repr(float(row[joints[what[0]] + "_meas"]) + what[1] * math.sin(float(row[joints[what[0]]]) + what[2]))
    write_table(path, rows)


def sim(scene, *more):
    """The summary; None where the drawn motion is out of reach or ends in a fault."""
    run = esmc("sim", scene, "--json", *more)
    if run.returncode == 2 and "leaves the reach" in run.stderr:
        return None
    assert run.stdout, run.stderr
    result = json.loads(run.stdout)
    return result if not result["supervisor"]["faults"] else None


def first(count, of):
    """`count` results of of(0), of(1), ... that are not None."""
    done, number = [], 0
    with ThreadPoolExecutor(2) as pool:
        while len(done) < count:
            assert number < 5 * count + 20, "too many draws are no runs"
            batch = range(number, number + max(2, count - len(done)))
            done += [(i, r) for i, r in zip(batch, pool.map(of, batch), strict=True) if r is not None]
            number = batch.stop
    return done[:count]


def judged(defects, seed):
    """(defects, what became of the log, intervals, those that hold, what was named), None where the run ends in a fault."""
    draw = Draw(seed)
    chosen = draw.defects(defects)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = draw.scene(folder)
        if sim(scene, *draw.sets(draw.wrong()), "--out", folder / "run") is None:
            return None
        if draw.edits:
            edit(draw, folder / "run" / "log.csv")
        run = esmc("identify", folder / "run", "--json")
    if run.returncode != 0:
        assert run.returncode == 2, run.stderr
        return chosen, "refused: " + run.stderr.strip().split(": ", 2)[-1], 0, 0, []
    found, truth = json.loads(run.stdout), draw.truth()
    inside = [p["lower"] <= sum(share * truth[k] for k, share in p["share"].items()) <= p["upper"] for p in found["parameters"]]
    missed = [p["name"].split()[0] if p["inertial"] else p["name"] for p, holds in zip(found["parameters"], inside, strict=True) if not holds]
    delay = found["delay"]["lower"] <= draw.delay <= found["delay"]["upper"]
    return chosen, ",".join(missed), len(inside) + 1, sum(inside) + delay, [f'{m["code"]}({m["where"]}, {m["amount"]:.2g})' for m in found["misfits"]]


def logs(count, seed, defects):
    return [r for _, r in first(count, lambda i: judged(defects, seed * 100003 + i))]


def misfits(count, seed):
    done = logs(count, seed, 2)
    refused = [d for d in done if d[1].startswith("refused")]
    read = [d for d in done if not d[1].startswith("refused")]
    intervals = sum(d[2] for d in read)
    good = sum(d[2] if d[4] else d[3] for d in read)
    for chosen, missed, n, holds, named in read:
        if holds < n and not named:
            print(f"silent: {' and '.join(chosen)}: {n - holds} of {n} miss the truth ({missed})")
    for chosen, why, *_ in refused:
        print(f"{' and '.join(chosen)}: {why}")
    of_all, of_named = Counter(), Counter()
    for chosen, _, n, holds, named in read:
        for d in chosen:
            of_all[d] += 1
            of_named[d] += bool(named)
    print("logs with a named misfit, by defect: " + ", ".join(f"{d} {of_named[d]} of {of_all[d]}" for d in DEFECTS))
    print(f"{count} logs with two defects: {len(refused)} refused; {good} of {intervals} intervals "
          f"({100 * good / max(1, intervals):.1f} %) hold the truth or the log names a misfit; of all, {sum(d[3] for d in read)} hold")
    return good >= 0.95 * intervals


def clean(count, seed):
    done = logs(count, seed, 0)
    named = [d for d in done if d[4] or d[1].startswith("refused")]
    for d in named:
        print("named without a defect:", d)
    intervals, hold = sum(d[2] for d in done), sum(d[3] for d in done)
    print(f"{count} logs without a defect: {len(named)} name one; {hold} of {intervals} intervals "
          f"({100 * hold / max(1, intervals):.1f} %) hold the truth")
    return len(named) <= 0.05 * count and hold >= 0.95 * intervals


def ratios(seed):
    """(error with what was written over that of exact knowledge, and over that before), per motion; None where a run ends in a fault."""
    draw = Draw(seed)
    draw.defects(draw.random.randrange(3), ("direction", "rotor"))
    exact = 'control.model={friction="exact"}'
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene, written = draw.scene(folder), folder / "written.toml"
        if sim(scene, *draw.sets(draw.wrong()), "--out", folder / "run") is None:
            return None
        run = esmc("identify", folder / "run", "--write", written)
        assert run.returncode == 0, (seed, run.stderr)
        out = []
        for motion in range(2):
            error = [sim(s, *draw.sets(model, motion)) for s, model in ((written, None), (scene, exact), (scene, draw.wrong()))]
            if None in error:
                return None
            after, best, before = (e["tracking"]["settled_rms_m"] for e in error)
            out.append((after / best, after / before))
        return out


def write(count, seed):
    done = first(count, lambda i: ratios(seed * 100003 + i))
    good = True
    for motion, what in enumerate(("the motion of the log", "another motion")):
        exact, before = [sorted(r[motion][k] for _, r in done) for k in (0, 1)]
        print(f"{count} scenes, {what}: error after over that of exact knowledge: median {statistics.median(exact):.3f}, worst {exact[-1]:.3f}; "
              f"over that before: median {statistics.median(before):.3f}, worst {before[-1]:.3f}")
        good = good and exact[-1] <= 1.02
    for i, r in done:
        if any(a > 1.02 for a, _ in r):
            print(f"scene {i}: {r}")
    return good


def main():
    what, *numbers = MORE
    count, seed = (int(x) for x in (numbers + ["50", "1"][len(numbers):]))
    good = {"write": write, "misfits": misfits, "clean": clean}[what](count, seed)
    print("identify: all checks hold" if good else "FAILED")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
