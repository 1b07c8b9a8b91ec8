#!/usr/bin/env python3
"""What `esmc check` says of random scenes against what they do in `esmc sim`. usage: verdicts.py ESMC [SCENES [SEED]]

A scene is bad where, after the join, the torque changes from tick to tick by more than 5 % of torque_limit on average (loop_rings), or
more than half of all ticks are saturated (torque_exceeded). The judge is the log of the whole run; the check sees 200 ticks at most.
Fails below 90 % of the bad with their code, or with more than 10 % of the good called unfit."""
import csv
import json
import random
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

JOIN = 0.3


def mechanism(r):
    scale = r.uniform(0.8, 1.6)
    legs = []
    for _ in range(2):
        l1, l2 = 0.12 * scale * r.uniform(0.9, 1.1), 0.16 * scale * r.uniform(0.95, 1.15)
        m1, m2 = (0.1 * scale ** 2 * r.uniform(0.5, 2.0) for _ in range(2))
        legs.append(f"{{ l1 = {l1}, l2 = {l2}, lg1 = {l1 * r.uniform(0.3, 0.6)}, lg2 = {l2 * r.uniform(0.3, 0.6)}, m1 = {m1}, m2 = {m2}, "
                    f"J1 = {m1 * l1 ** 2 / 12}, J2 = {m2 * l2 ** 2 / 12} }}")
    gravity = r.choice([0.0, 9.81])
    if r.random() < 0.3:
        reach = 0.28 * scale
        centre, radius = [0.45 * reach, 0.45 * reach], r.uniform(0.1, 0.25) * reach
        return (f'type = "rr"\ngravity = {gravity}\nleg = {legs[0]}\nworking_mode = ["+"]\n', centre, radius)
    return (f'type = "five_bar"\nhalf_base = {0.05 * scale}\ngravity = {gravity}\neffector_mass = {r.uniform(0, 0.1)}\nlegs = [{legs[0]}, {legs[1]}]\n'
            'working_mode = ["+", "+"]\nassembly_mode = "-"\n', [0.0, 0.17 * scale], r.uniform(0.02, 0.06) * scale)


def control(r):
    law = r.choice(["esmc", "esmc", "esmc_projected", "smc", "ctc", "pd"])
    out = [f'law = "{law}"', f"lambda = {10 ** r.uniform(1.2, 2.9 if law in ('ctc', 'pd') else 2.5)}", f"torque_limit = {10 ** r.uniform(-0.7, 0.7)}"]
    if law not in ("ctc", "pd"):
        reaching = r.choice(["implicit", "implicit", "saturation", "tanh", "sign", "super_twisting"])
        out += [f'reaching = "{reaching}"', f"gain = {10 ** r.uniform(0.3, 2.5)}"]
        if reaching in ("saturation", "tanh"):
            out += [f"layer = {10 ** r.uniform(-2, 0)}"]
    if law == "pd":
        out += [f"kp = {10 ** r.uniform(0, 2.5)}", f"kd = {10 ** r.uniform(-2, 0.7)}"]
    told = r.choice([0, 0, 0, 1, 2])
    if law not in ("ctc", "pd") and told:
        out.append(f"delay_ticks = {told}")
    if r.random() < 0.25:
        f = r.uniform(0.5, 2.5)
        out.append(f"model = {{ m1 = {f}, m2 = {f}, J1 = {f}, J2 = {f} }}")
    if r.random() < 0.15:
        out.append(f"disturbance_observer = {10 ** r.uniform(1, 2.7)}")
    return "\n".join(out) + "\n"


def effects(r):
    out = []
    if r.random() < 0.4:
        out.append(f'{{ type = "coulomb_friction", torque = [{10 ** r.uniform(-2, 0)}, {10 ** r.uniform(-3, -1.5)}] }}')
    if r.random() < 0.3:
        out.append(f'{{ type = "viscous_friction", coefficient = [{10 ** r.uniform(-3, -1)}, {10 ** r.uniform(-3.5, -2)}] }}')
    if r.random() < 0.4:
        out.append(f'{{ type = "encoder", bits = {r.randint(12, 20)}, bandwidth = {10 ** r.uniform(2.3, 3.5)} }}')
    if r.random() < 0.2:
        out.append(f'{{ type = "delay", ticks = {r.randint(1, 3)} }}')
    if r.random() < 0.2:
        out.append(f'{{ type = "compute_delay", time = {r.uniform(1e-4, 2e-3)} }}')
    if r.random() < 0.15:
        out.append(f'{{ type = "joint_flexibility", stiffness = {10 ** r.uniform(1, 3)}, damping = {r.uniform(0, 0.2)}, rotor_inertia = {10 ** r.uniform(-4, -3)} }}')
    if r.random() < 0.15:
        out.append(f'{{ type = "payload", mass = {r.uniform(0.05, 0.8)} }}')
    if r.random() < 0.15:
        out.append(f'{{ type = "torque_saturation", limit = {10 ** r.uniform(-1, 0.5)} }}')
    if r.random() < 0.15:
        out.append(f'{{ type = "torque_lag", time_constant = {10 ** r.uniform(-3.5, -2.3)} }}')
    return "effects = [" + ", ".join(out) + "]\n"


def scene(r):
    body, centre, radius = mechanism(r)
    joined = f"radius = {radius}\nspeed = {r.uniform(1, 12)}\njoin = {JOIN}\n"
    return (f'name = "drawn"\n{effects(r)}[mechanism]\n{body}[control]\n{control(r)}rate_hz = 1000\n[reference]\ntype = "circle"\ncenter = {centre}\n{joined}'
            '[initial]\nat = "reference"\n[limits]\nmin_abs_sin_type1 = 0.02\nmin_abs_sin_type2 = 0.02\njoint_speed = 200\n'
            '[drives]\nprotocol = "odrive"\nnodes = [1, 2]\n[simulation]\nduration = 1.5\nstep = 1e-4\n')


def judged(esmc, text, folder):
    """(what it does, what check says of it); None: not a scene."""
    path = Path(folder, "scene.toml")
    path.write_text(text, encoding="utf-8")
    said = subprocess.run([esmc, "check", path, "--json"], capture_output=True, text=True)
    if said.returncode == 2:
        return None
    j = json.loads(said.stdout)
    run = subprocess.run([esmc, "sim", path, "--json", "--out", Path(folder, "out")], capture_output=True, text=True)
    if not run.stdout:
        return None
    s = json.loads(run.stdout)
    with open(Path(folder, "out", "log.csv"), newline="", encoding="utf-8") as f:
        rows = list(csv.DictReader(f))
    limit = float(next(line for line in text.splitlines() if line.startswith("torque_limit")).split("=")[1])
    until = s["supervisor"]["fault_t_s"]
    motors = [c for c in rows[0] if c.startswith("tau") and not c.endswith("_cmd")]
    late = [row for row in rows if float(row["t"]) >= JOIN and (until is None or float(row["t"]) < until)]
    steps = [abs(float(b[c]) - float(a[c])) for a, b in zip(late, late[1:]) for c in motors]
    does = {"change": sum(steps) / len(steps) / limit if steps else 0.0, "saturated": s["torque"]["saturated_ticks"] / s["ticks"],
            "fault": [f["name"] for f in s["supervisor"]["faults"]]}
    return does, j


def draw(job):
    esmc, seed = job
    r = random.Random(seed)
    while True:
        with tempfile.TemporaryDirectory() as folder:
            text = scene(r)
            both = judged(esmc, text, folder)
            if both and not any(f["code"] in ("unreachable",) for f in both[1]["findings"]):
                return (seed, text, *both)


def main():
    esmc, count, first = sys.argv[1], int((sys.argv + [0, 60])[2] if len(sys.argv) > 2 else 60), int(sys.argv[3]) if len(sys.argv) > 3 else 1
    with ThreadPoolExecutor(2) as pool:
        drawn = list(pool.map(draw, [(esmc, s) for s in range(first, first + count)]))
    bad = good = found = alarms = stopped = 0
    for seed, text, does, j in drawn:
        want = {code for code, is_so in (("loop_rings", does["change"] > 0.05), ("torque_exceeded", does["saturated"] > 0.5)) if is_so}
        codes = {f["code"] for f in j["findings"] if f["level"] == "error"}
        if not want and does["fault"]:
            stopped += 1  # neither: it falls
            right = j["verdict"] == "unfit"
        elif want:
            bad += 1
            right = bool(want & codes)
            found += right
        else:
            good += 1
            right = j["verdict"] != "unfit"
            alarms += not right
        if not right:
            print(f"seed {seed}: {does} {sorted(want)}, check: {[(f['level'], f['code']) for f in j['findings']]} {j['simulated']}")
    print(f"{count} scenes: {bad} bad, {found} found with their code; {good} good, {alarms} called unfit; {stopped} end in a fault otherwise")
    return 0 if found >= 0.9 * bad and alarms <= 0.1 * good and 0.3 * count <= bad + stopped else 1


if __name__ == "__main__":
    sys.exit(main())
