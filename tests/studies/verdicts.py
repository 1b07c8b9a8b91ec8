#!/usr/bin/env python3
"""What `esmc check` says of random scenes against what they do. usage: verdicts.py ESMC JUDGE [SCENES [SEED]] [--show]

JUDGE (verdict_judge.cpp) runs the scene's controller on a plant, drives and sensors that share nothing with the program's. A scene is bad
where, after the join, the torque changes from tick to tick by more than 5 % of torque_limit on average (loop_rings), where more than half
of all ticks are saturated (torque_exceeded), or where it ends in a fault (limit_crossed, or torque_exceeded). The check simulates 200 ticks
at most. Fails below 98 % of the bad with their code, with more than 5 % of the good called unfit, or without 40 to 60 % bad scenes; of
fewer than 200 scenes, below 90 %, above 10 %, and without 25 % bad and good ones."""
import json
import math
import random
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path


def leg(r, scale):
    l1, l2 = 0.12 * scale * r.uniform(0.9, 1.1), 0.16 * scale * r.uniform(0.95, 1.15)
    m1, m2 = (0.1 * scale ** 2 * r.uniform(0.5, 2.0) for _ in range(2))
    return (f"{{ l1 = {l1}, l2 = {l2}, lg1 = {l1 * r.uniform(0.3, 0.6)}, lg2 = {l2 * r.uniform(0.3, 0.6)}, m1 = {m1}, m2 = {m2}, "
            f"J1 = {m1 * l1 ** 2 / 12}, J2 = {m2 * l2 ** 2 / 12} }}")


def mechanism(r, scale):
    out = f"gravity = {r.choice([0.0, 9.81])}\n"
    rotor = 10 ** r.uniform(-5, -3) if r.random() < 0.2 else 0.0
    if r.random() < 0.3:
        return out + f'type = "rr"\nleg = {leg(r, scale)}\nworking_mode = ["+"]\nrotor_inertia = [{rotor}, 0.0]\n', "rr"
    return out + (f'type = "five_bar"\nhalf_base = {0.05 * scale}\neffector_mass = {r.uniform(0, 0.1)}\nlegs = [{leg(r, scale)}, {leg(r, scale)}]\n'
                  f'working_mode = ["+", "+"]\nassembly_mode = "-"\nrotor_inertia = [{rotor}, {rotor}]\n'), "five_bar"


def reference(r, kind, scale):
    """The section, and the rows of its table."""
    centre, radius = ([0.126 * scale, 0.126 * scale], r.uniform(0.028, 0.07) * scale) if kind == "rr" else ([0.0, 0.17 * scale], r.uniform(0.02, 0.06) * scale)
    speed, join, shape = r.uniform(1, 12), f"join = {r.choice([0.0, 0.3, 0.3, 0.3])}\n", r.random()
    ends = [[centre[0] - radius, centre[1]], [centre[0] + radius * r.uniform(-0.5, 1), centre[1] + radius * r.uniform(-1, 1)]]
    if shape < 0.1:
        return f'type = "line"\nfrom = {ends[0]}\nto = {ends[1]}\nduration = {r.uniform(0.2, 1.2)}\nrepeat = true\n{join}', ""
    if shape < 0.2:
        return f'type = "polyline"\npoints = {[*ends, [centre[0], centre[1] + radius]]}\nspeed = {r.uniform(0.05, 0.5)}\nrepeat = true\n{join}', ""
    if shape < 0.3:  # a table that ends in motion, which jumps to rest
        rows = [(0.05 * i, *(centre[k] + radius * f(speed * 0.05 * i) for k, f in ((0, math.cos), (1, math.sin)))) for i in range(r.randint(10, 30))]
        return f'type = "file"\npath = "table.csv"\n{join}', "t,x,y\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)
    return f'type = "circle"\ncenter = {centre}\nradius = {radius}\nspeed = {speed}\n{join}', ""


def gains(r, law, told):
    out = [f'law = "{law}"', f"lambda = {10 ** r.uniform(1.2, 2.9 if law in ('ctc', 'pd') else 2.5)}"]
    if law not in ("ctc", "pd"):
        reaching = r.choice(["implicit", "implicit", "implicit", "saturation", "tanh", "sign", "super_twisting", "implicit_coupled"])
        if reaching == "implicit_coupled" and law != "esmc":
            reaching = "implicit"
        out += [f'reaching = "{reaching}"', f"gain = {10 ** r.uniform(0.3, 2.5)}"]
        if reaching in ("saturation", "tanh"):
            out += [f"layer = {10 ** r.uniform(-1.5, 0.3)}"]
    if law == "pd":
        out += [f"kp = {10 ** r.uniform(0, 2.2)}", f"kd = {10 ** r.uniform(-2, 0.5)}"]
    if told:
        out.append(f"delay_ticks = {told}")
    if law != "pd" and told and r.random() < 0.4:
        out.append("predictor = true")
    if law != "pd" and r.random() < 0.2:
        out.append(f"disturbance_observer = {10 ** r.uniform(1, 2.7)}")
    return out


def control(r, kind, told):
    law = r.choice(["esmc", "esmc", "esmc_projected", "smc", "ctc", "ctc", "pd"])
    four = kind == "five_bar" and law != "pd" and r.random() < 0.2
    out = [*gains(r, law, told), f"rate_hz = {500 if four else r.choice([500, 1000, 1000, 1000])}"]  # as a bus carries
    factors = ""
    if r.random() < 0.3:
        f = r.uniform(0.5, 2.2)
        factors += f"m1 = {f}, m2 = {f}, J1 = {f}, J2 = {f}"
    if r.random() < 0.2:
        factors += (", " if factors else "") + 'friction = "exact"'
    if factors:
        out.append(f"model = {{ {factors} }}")
    limit = 10 ** r.uniform(-0.5, 0.7)
    if four:
        out += ['motors = "all"', 'sensors = "all"', f"torque_limit = [{limit}, {limit / 2}, {limit}, {limit / 2}]"]
    else:
        out.append(f"torque_limit = {limit}")
    return "\n".join(out) + "\n", four


def drive_effects(r, delay):
    out = []
    if delay:
        out.append(f'{{ type = "compute_delay", time = {delay} }}')
    if r.random() < 0.4:
        out.append(f'{{ type = "encoder", bits = {r.randint(12, 20)}, bandwidth = {10 ** r.uniform(2.3, 3.5)} }}')
    if r.random() < 0.12:
        out.append(f'{{ type = "delay", ticks = {r.randint(1, 2)} }}')
    if r.random() < 0.12:
        out.append(f'{{ type = "joint_flexibility", stiffness = {10 ** r.uniform(1, 3)}, damping = {r.uniform(0, 0.2)}, rotor_inertia = {10 ** r.uniform(-4, -3)} }}')
    if r.random() < 0.12:
        out.append(f'{{ type = "torque_saturation", limit = {10 ** r.uniform(-1, 0.5)} }}')
    if r.random() < 0.12:
        out.append(f'{{ type = "torque_lag", time_constant = {10 ** r.uniform(-3.5, -2.3)} }}')
    if r.random() < 0.12:
        out.append(f'{{ type = "thermal_limit", continuous = {10 ** r.uniform(-1, 0.3)}, time_constant = {10 ** r.uniform(-0.5, 1)} }}')
    return out


def effects(r, delay, scale):
    out = drive_effects(r, delay)
    if r.random() < 0.35:
        out.append(f'{{ type = "coulomb_friction", torque = [{10 ** r.uniform(-2, 0)}, {10 ** r.uniform(-3, -1.5)}] }}')
    if r.random() < 0.3:
        out.append(f'{{ type = "viscous_friction", coefficient = [{10 ** r.uniform(-3, -1)}, {10 ** r.uniform(-3.5, -2)}] }}')
    begin = r.choice([0.0, round(r.uniform(0.3, 1.0), 3)])
    if r.random() < 0.15:
        out.append(f'{{ type = "payload", mass = {r.uniform(0.05, 0.8)}, from = {begin} }}')
    if r.random() < 0.1:
        out.append(f'{{ type = "external_force", force = [{r.uniform(-5, 5)}, {r.uniform(-5, 5)}], from = {begin}, to = {begin + 0.4} }}')
    elif r.random() < 0.05:
        out.append(f'{{ type = "external_force", kind = "human", anchor = [0.0, {0.17 * scale}], stiffness = {10 ** r.uniform(0, 2)}, damping = 0.5 }}')
    return "effects = [" + ", ".join(out) + "]\n"


def scene(r):
    """A scene file and the table that it may name."""
    scale = r.uniform(0.8, 1.6)
    body, kind = mechanism(r, scale)
    delay = r.choice([0, 0, 0, r.randint(1, 3), round(r.uniform(0.1, 3), 2)])  # ticks at 1 kHz
    told = r.choice([0, math.ceil(delay), math.ceil(delay)]) if delay else r.choice([0, 0, 0, 0, 1, 2])
    law, four = control(r, kind, told)
    path, table = reference(r, kind, scale)
    return (f'name = "drawn"\n{effects(r, 1e-3 * delay, scale)}[mechanism]\n{body}[control]\n{law}[reference]\n{path}[initial]\nat = "reference"\n'
            '[limits]\nmin_abs_sin_type1 = 0.02\nmin_abs_sin_type2 = 0.02\njoint_speed = 200\n'
            f'[drives]\nprotocol = "odrive"\nnodes = {[1, 2, 3, 4] if four else [1, 2]}\n[simulation]\nduration = 1.5\nstep = 1e-4\n'), table


def draw(job):
    """Seed, scene, what it does and what check says of it."""
    esmc, judge, seed = job
    r = random.Random(seed)
    while True:
        text, table = scene(r)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "scene.toml")
            path.write_text(text, encoding="utf-8")
            Path(folder, "table.csv").write_text(table, encoding="utf-8")
            said = subprocess.run([esmc, "check", path, "--json"], capture_output=True, text=True, check=False)
            assert said.returncode in (0, 1, 2), (seed, said.returncode)
            if said.returncode == 2 or any(f["code"] == "unreachable" for f in json.loads(said.stdout)["findings"]):
                continue  # no scene
            does = subprocess.run([judge, path], capture_output=True, text=True, check=True)
            return seed, text, json.loads(does.stdout), json.loads(said.stdout)


def wanted(does):
    """Codes of which one is right; none: the scene is good."""
    if does["diverged"]:
        return {"loop_rings", "torque_exceeded", "limit_crossed"}
    want = {code for code, bad in (("loop_rings", does["change"] > 0.05), ("torque_exceeded", does["saturated"] > 0.5)) if bad}
    return want | ({"limit_crossed", "torque_exceeded"} if does["fault"] else set())


def main():
    show = "--show" in sys.argv
    esmc, judge, *numbers = [a for a in sys.argv[1:] if a != "--show"]
    count, first = [*map(int, numbers), *[60, 1][len(numbers):]]
    with ThreadPoolExecutor(1 if count > 100 else 2) as pool:
        drawn = list(pool.map(draw, [(esmc, judge, s) for s in range(first, first + count)]))
    bad = good = found = alarms = 0
    for seed, text, does, j in drawn:
        want = wanted(does)
        right = want & {f["code"] for f in j["findings"] if f["level"] == "error"} if want else j["verdict"] != "unfit"
        bad, found = bad + bool(want), found + bool(want and right)
        good, alarms = good + (not want), alarms + (not want and not right)
        if not right or show:
            print(f"seed {seed}: {does} {sorted(want)}, check: {[(f['level'], f['code']) for f in j['findings']]} {j['simulated']}")
            if show:
                print(text)
    print(f"{count} scenes: {bad} bad, {found} found with their code; {good} good, {alarms} called unfit")
    share, least, most, few = (0.98, 0.05, 0.6, 0.4) if count >= 200 else (0.9, 0.1, 0.75, 0.25)
    return 0 if found >= share * bad and alarms <= least * good and few * count <= bad <= most * count else 1


if __name__ == "__main__":
    sys.exit(main())
