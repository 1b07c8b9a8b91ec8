#!/usr/bin/python3
"""Tables and pictures of docs/spatial.md from runs of `esmc spatial`. Python's standard library only.

usage: spatial_page.py ESMC              runs everything and compares with docs
       spatial_page.py ESMC --update     writes the key table, the tables and the pictures anew"""
import math
import re
import subprocess
import sys
from pathlib import Path

import page
from effect_figures import same as same_picture
from effect_figures import svg

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/spatial.md"
IMAGES = ROOT / "docs/images"
SCENES = ROOT / "host_sim/scenes/spatial"
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
ON_REFERENCE = ["initial.rotation=[0,0,0]", "initial.position=[0,0,0]"]
EXACT = ["control.model={mass=1.0, inertia=1.0}"]
# mechanism, what is special, --set values
CASES = [
    ("free_body", "turn about z, exact model", ["reference.axis=[0,0,1]"] + EXACT),
    ("free_body", "turn about z, masses wrong", ["reference.axis=[0,0,1]"]),
    ("free_body", "turn through 90° of pitch, masses wrong", []),
    ("hexapod", "exact model", []),
    ("hexapod", "platform's mass + 20 %, inertia - 10 %", ["control.model={mass=1.2, inertia=0.9}"]),
    ("hexapod", "model with massless legs", ["control.model={legs=0.0}"]),
]
HALF_TURN = ['reference={type="hold"}', "initial.position=[0,0,0]", "initial.rotation=[0,0,3.141592653589793]",
             "measurement.attitude_noise=0.02", "control.lambda=4.0",
             "control.gain={position=20.0, angle=10.0}", "simulation.duration=1.0"]


def run(esmc, scene, sets, *more):
    return page.run(esmc, "spatial", SCENES / f"{scene}.toml", *sets, more=more)


def rows(esmc, scene, sets, *more):
    return page.run(esmc, "spatial", SCENES / f"{scene}.toml", *sets, log=True, more=more)[1]


def laws(esmc):
    yield "| mechanism | | law | largest error, deg | largest error, mm | force, N | moment, N m | ended by |"
    yield "|---|---|---|---|---|---|---|---|"
    for scene, what, sets in CASES:
        for law in ("esmc", "esmc_projected", "smc_euler"):
            j = run(esmc, scene, ON_REFERENCE + sets + [f"control.law={law}"])
            t, u = j["tracking"], j["input"]
            moment = f"{u['moment_max_nm']:.3g}" if u["moment_max_nm"] is not None else "-"
            fault = f"`{j['fault']['name']}` at {j['fault']['t']:.2g} s" if j["fault"] else "-"
            yield f"| {scene} | {what} | `{law}` | {t['max_deg']:.2g} | {1e3 * t['max_m']:.2g} | {u['force_max_n']:.3g} | {moment} | {fault} |"


def past_pole(cosine):
    """A turn that passes 90 degrees of pitch at a distance: the least cos(pitch) on its way is this."""
    angle = math.asin(cosine)
    return [f"reference.axis=[{math.sin(angle)!r},{math.cos(angle)!r},0]", "reference.angle=2.5", "reference.duration=1.0",
            "simulation.duration=1.5", "initial.position=[0,0,0]", "initial.rotation=[0.1,-0.05,0.15]", "control.lambda=6.0",
            "control.gain={position=20.0, angle=20.0}"]


def pole(esmc):
    yield "| least cos(pitch) on the way | noise, mrad | `esmc`: moment, N m | last quarter, deg | `smc_euler`: moment, N m | last quarter, deg |"
    yield "|---|---|---|---|---|---|"
    for cosine in (0.5, 0.1, 0.05, 0.02):
        for noise in (0.0, 0.002):
            cells = []
            for law in ("esmc", "smc_euler"):
                j = run(esmc, "free_body", past_pole(cosine) + [f"measurement.attitude_noise={noise}", f"control.law={law}"])
                cells += [f"{j['input']['moment_max_nm']:.3g}", f"{j['tracking']['settled_max_deg']:.2g}"]
            yield f"| {cosine:g} | {1e3 * noise:g} | " + " | ".join(cells) + " |"


def half_turn(esmc):
    yield "| `hysteresis` | the moment changes its direction, times in the first 0.2 s | 90 degrees are left after, s | at the latest, s |"
    yield "|---|---|---|---|"
    for hysteresis in (0.0, 0.02, 0.05, 0.1, 0.3):
        changes, times = [], []
        for seed in range(1, 11):
            log = rows(esmc, "free_body", HALF_TURN + [f"control.hysteresis={hysteresis}"], "--seed", seed)
            signs = [r["u6"] > 0 for r in log if r["t"] < 0.2]
            changes.append(sum(a != b for a, b in zip(signs, signs[1:])))
            times.append(next(r["t"] for r in log if r["angle_deg"] < 90))
        yield f"| {hysteresis:g} | {sum(changes) / len(changes):.3g} | {sum(times) / len(times):.3g} | {max(times):.3g} |"


def thinned(log, value, start, end, count=400):
    inside = [r for r in log if start <= r["t"] <= end]
    return [(r["t"], value(r)) for r in inside[::max(1, len(inside) // count)]]


def pictures(esmc):
    moment = lambda r: (r["u4"]**2 + r["u5"]**2 + r["u6"]**2) ** 0.5
    curves = [(law, thinned(rows(esmc, "free_body", past_pole(0.02) + [f"control.law={law}"]), moment, 0.3, 0.9)) for law in ("esmc", "smc_euler")]
    yield "spatial_pitch", svg("spatial_pitch", "moment, N m", 0.3, 0.9, curves)
    curves = [(f"hysteresis {h:g}", thinned(rows(esmc, "free_body", HALF_TURN + [f"control.hysteresis={h}"]), lambda r: r["u6"], 0.0, 0.3, 600))
              for h in (0.0, 0.1)]
    yield "spatial_half_turn", svg("spatial_half_turn", "moment about the axis, N m", 0.0, 0.3, curves)


def same(a, b):
    if NUMBER.sub("#", a) != NUMBER.sub("#", b):
        return False
    return all(abs(float(x) - float(y)) <= 0.02 * abs(float(x)) + 1e-12 for x, y in zip(NUMBER.findall(a), NUMBER.findall(b)))


def main():
    arguments = [a for a in sys.argv[1:] if a != "--update"]
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    esmc, update, failed = arguments[0], "--update" in sys.argv, 0
    keys = subprocess.run([esmc, "keys", "spatial"], capture_output=True, text=True, check=True).stdout
    tables = {name: "\n".join(make(esmc)) + "\n" for name, make in (("laws", laws), ("pole", pole), ("half turn", half_turn))} | {"keys": keys}
    if update:
        page.put(PAGE, tables)
    for name, table in tables.items():
        if not same(page.part(PAGE, name), table):
            failed += 1
            print(f"docs/spatial.md, {name}: not what the program does: spatial_page.py ESMC --update\n{table}")
    text = PAGE.read_text(encoding="utf-8")
    for name, picture in pictures(esmc):
        file = IMAGES / f"{name}.svg"
        if update:
            file.write_text(picture, encoding="utf-8")
        elif not file.is_file() or not same_picture(file.read_text(encoding="utf-8"), picture):
            failed += 1
            print(f"{file.relative_to(ROOT)} is not what the program does: spatial_page.py ESMC --update")
        if f"(images/{name}.svg)" not in text:
            failed += 1
            print(f"docs/spatial.md does not show {name}.svg")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
