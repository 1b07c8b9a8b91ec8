#!/usr/bin/env python3
"""Runs `esmc sim` with open_loop torques on the golden trajectories and compares every sample.

Each case becomes a scene (nothing of it is known to the program); log.csv gives the samples within the run,
final_state the last one. Accepted: 1e-9 absolute in every coordinate and rate, as the issue of this test asks.
usage: trajectories.py ESMC FILE...
"""
import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path

ALLOWED = 1e-9
RATE_HZ = 1000
LEG = ("l1", "l2", "lg1", "lg2", "m1", "m2", "J1", "J2")


def numbers(values):
    return "[" + ", ".join(repr(float(v)) for v in values) + "]"


def leg_table(p):
    return "{ " + ", ".join(f"{k} = {float(p[k])!r}" for k in LEG) + " }"


def waveform(w):
    terms = ", ".join(
        f"{{ amp = {float(t['amp'])!r}, omega = {float(t['omega'])!r}, phase = {float(t['phase'])!r} }}" for t in w["terms"])
    return f"{{ offset = {float(w['offset'])!r}, terms = [{terms}] }}"


def scene(case):
    p, five_bar = case["params"], "legs" in case["params"]
    legs = p["legs"] if five_bar else [p]
    initial = case["initial"]
    signs = case["mode"]["sigma"] if five_bar else [1 if initial["theta"][1] > 0 else -1]
    mode = ", ".join('"+"' if s > 0 else '"-"' for s in signs)
    lines = [f'name = "{case["id"]}"', "[mechanism]", f'type = "{"five_bar" if five_bar else "rr"}"',
             f"gravity = {float(p['g'])!r}", f"working_mode = [{mode}]"]
    if five_bar:
        lines += [f"half_base = {float(p['l0'])!r}", f"effector_mass = {float(p['m0'])!r}"]
    else:
        lines += [f"leg = {leg_table(p)}"]
    for leg in legs if five_bar else []:
        lines += ["[[mechanism.legs]]"] + [f"{k} = {float(leg[k])!r}" for k in LEG]
    lines += ["[control]", 'law = "open_loop"', f'motors = "{"all" if five_bar else "base"}"', f"rate_hz = {RATE_HZ}",
              "torque = [" + ", ".join(waveform(w) for w in case["torque"]) + "]", "[initial]"]
    if five_bar:
        lines += [f"position = {numbers([initial['x'], initial['y']])}",
                  f"velocity = {numbers([initial['xd'], initial['yd']])}"]
    else:
        lines += [f"joints = {numbers(initial['theta'])}", f"joint_rates = {numbers(initial['thetad'])}"]
    lines += ["[simulation]", f"duration = {float(case['duration'])!r}", "accuracy = 1e-10"]
    friction = [float(leg[c]) for leg in legs for c in ("c1", "c2")]
    if any(friction):
        lines += ["[[effects]]", 'type = "viscous_friction"', f"coefficient = {numbers(friction)}"]
    return "\n".join(lines) + "\n"


def worst_error(case, log, summary):
    five_bar = "legs" in case["params"]
    angles = ["theta11", "theta12", "theta21", "theta22"] if five_bar else ["theta1", "theta2"]
    worst = 0.0
    for i, t in enumerate(case["t"]):
        row = round(t * RATE_HZ)
        if row < len(log):
            q = [float(log[row][a]) for a in angles]
            qd = [float(log[row][a + "_rate"]) for a in angles]
            x = [float(log[row]["x"]), float(log[row]["y"])]
        else:
            final = summary["final_state"]
            q, qd = final["q"][-len(angles):], final["qd"][-len(angles):]
            x = final["q"][:2]
        errors = [abs(a - b) for a, b in zip(q, case["theta"][i])] + [abs(a - b) for a, b in zip(qd, case["thetad"][i])]
        if five_bar:
            errors += [abs(a - b) for a, b in zip(x, case["pos"][i])]
        worst = max([worst] + errors)
    return worst


def main():
    esmc, failed, ran = sys.argv[1], 0, 0
    for path in sys.argv[2:]:
        for case in json.loads(Path(path).read_text(encoding="utf-8"))["cases"]:
            with tempfile.TemporaryDirectory() as folder:
                file, out = Path(folder, "case.toml"), Path(folder, "out")
                file.write_text(scene(case), encoding="utf-8")
                run = subprocess.run([esmc, "sim", file, "--out", out, "--json"], capture_output=True, text=True)
                ran += 1
                if run.returncode != 0:
                    failed += 1
                    print(f"FAILED {case['id']}: exit {run.returncode}: {run.stderr.strip()}")
                    continue
                with open(out / "log.csv", newline="", encoding="utf-8") as f:
                    error = worst_error(case, list(csv.DictReader(f)), json.loads(run.stdout))
            print(f"{'ok    ' if error <= ALLOWED else 'FAILED'} {case['id']}: largest error {error:.1e}")
            failed += error > ALLOWED
    print(f"{ran} trajectories, {failed} outside {ALLOWED}")
    sys.exit(1 if failed or not ran else 0)


if __name__ == "__main__":
    main()
