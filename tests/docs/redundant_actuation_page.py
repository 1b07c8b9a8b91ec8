#!/usr/bin/python3
"""Writes the tables of docs/redundant-actuation.md from runs of its two scenes.

usage: redundant_actuation_page.py ESMC            writes
       redundant_actuation_page.py ESMC --check    runs a part of it again: its rows must be there, and what the page concludes must hold
"""
import concurrent.futures
import math
import sys
from pathlib import Path

import page

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/redundant-actuation.md"
SCENES = ROOT / "host_sim/scenes"
MOTORS = ("tau11", "tau12", "tau21", "tau22")
PRELOADS = (0.0, 0.02, 0.05, 0.1, 0.2)
GAPS = (0.0, 0.001, 0.002, 0.005)
GAINS = tuple((p, gain, delay) for gain, delay in ((5.0, 5), (15.0, 5), (40.0, 5), (40.0, 10)) for p in (0.0, 0.1))


def run(scene, *sets):
    """Summary and rows of a run."""
    return page.run(ESMC, "sim", SCENES / scene, *sets, log=True)


def preload_row(gap, preload, gain=15.0, delay=10):
    sets = [f"control.gain={gain}", f"control.delay_ticks={delay}", "control.preload=" + str([preload] * 4)]
    # Without play the gear stays elastic: what is compared is play alone.
    effects = '[{type="viscous_friction", coefficient=[0.01, 0.002]}, '
    gear = "stiffness=[200.0, 200.0, 200.0, 200.0], damping=[0.1, 0.1, 0.1, 0.1], rotor_inertia=[1e-4, 1e-4, 1e-4, 1e-4]"
    effects += '{type="joint_flexibility", ' + gear + "}"
    if gap > 0:
        effects += f', {{type="backlash", gap={gap}}}'
    summary, rows = run("five_bar_preload.toml", *sets, "effects=" + effects + "]")
    late = [r for r in rows if r["t"] >= 0.5]
    torque = {m: [r[m] for r in late] for m in MOTORS}
    turns = sum(sum(1 for a, b in zip(t, t[1:]) if a * b < 0) for t in torque.values())
    error = [1e3 * math.hypot(r["x"] - r["x_ref"], r["y"] - r["y_ref"]) for r in late]
    seconds = late[-1]["t"] - late[0]["t"]
    change = sum(sum(abs(b - a) for a, b in zip(t, t[1:])) for t in torque.values()) / (4 * (len(late) - 1))
    return {"gap": gap, "preload": preload, "gain": gain, "delay": delay, "turns": turns / seconds, "rms": math.sqrt(sum(e * e for e in error) / len(error)), "max": max(error),
            "change": change, "heat": sum(sum(x * x for x in t) for t in torque.values()) / len(late), "most": max(max(map(abs, t)) for t in torque.values()),
            "faults": [f["name"] for f in summary["supervisor"]["faults"]]}


def preload_table(rows):
    out = "| play, rad | preload, N m | torque changes sign, 1/s | effector error rms, max, mm | change of torque per tick, N m | sum of squared torques, N² m² | largest torque, N m |\n"
    out += "|---|---|---|---|---|---|---|\n"
    for r in rows:
        out += f"| {r['gap']:g} | {r['preload']:g} | {r['turns']:.3g} | {r['rms']:.3g}, {r['max']:.3g} | {r['change']:.2g} | {r['heat']:.3g} | {r['most']:.3g} |\n"
    return out


def gains_table(rows):
    out = "| gain k, delay_ticks | preload, N m | torque changes sign, 1/s | effector error rms, max, mm | change of torque per tick, N m |\n|---|---|---|---|---|\n"
    for r in rows:
        out += f"| {r['gain']:g}, {r['delay']} | {r['preload']:g} | {r['turns']:.3g} | {r['rms']:.3g}, {r['max']:.3g} | {r['change']:.2g} |\n"
    return out


def type2_row(name, *sets):
    summary, rows = run("five_bar_type2.toml", *sets)
    faults = [f["name"] for f in summary["supervisor"]["faults"]]
    fault_t = summary["supervisor"]["fault_t_s"]
    out = {"name": name, "faults": faults, "t": fault_t}
    for where in ("near", "away"):
        part = []
        for r in rows:
            if faults and r["t"] >= fault_t:
                break
            d2 = math.sin(sum(r[j] for j in ("theta11", "theta12", "theta21", "theta22")))
            if (abs(d2) < 0.1) == (where == "near"):
                part.append(r)
        out[where] = {
            "ticks": len(part),
            "error": max((1e6 * math.hypot(r["x"] - r["x_ref"], r["y"] - r["y_ref"]) for r in part), default=math.nan),
            "torque": max((abs(r[m]) for r in part for m in MOTORS if m in r), default=math.nan)}
    return out


def type2_table(rows):
    out = "| run | ticks with \\|D2\\| < 0.1 | largest error there, elsewhere, µm | largest torque there, elsewhere, N m | ends |\n|---|---|---|---|---|\n"
    for r in rows:
        end = f"{r['faults'][0]} at {r['t']:.3f} s" if r["faults"] else "running"
        out += (f"| {r['name']} | {r['near']['ticks']} | {r['near']['error']:.3g}, {r['away']['error']:.3g} | "
                f"{r['near']['torque']:.3g}, {r['away']['torque']:.3g} | {end} |\n")
    return out


TYPE2 = (("four motors", ()),
         ("four motors, masses of the model 10 % too small", ("control.model={m1=0.9, m2=0.9}",)),
         ("four motors, encoders of 16 bits", ('effects=[{type="encoder", bits=16}]', "control.delay_ticks=2", "control.gain=40.0")),
         ("two motors", ("control.motors=base", "control.torque_limit=2.0", "sensors={nodes=[3, 4]}", "drives.nodes=[1, 2]")))


def conclusions(preload, type2):
    """What the page says in words."""
    def at(gap, p):
        return next(r for r in preload if (r["gap"], r["preload"]) == (gap, p))
    for r in preload:
        assert not r["faults"], r
    with_play, loaded = at(0.002, 0.0), at(0.002, 0.1)
    assert loaded["turns"] == 0 < with_play["turns"], (with_play, loaded)
    assert loaded["rms"] < 0.5 * with_play["rms"] and loaded["change"] < 0.01 * with_play["change"], (with_play, loaded)
    assert at(0.0, 0.1)["heat"] > 2 * at(0.0, 0.0)["heat"], "without play it costs"
    four, two = type2[0], type2[-1]
    assert not four["faults"] and four["near"]["ticks"] > 30 and four["near"]["error"] < 1.2 * four["away"]["error"], four
    assert two["faults"] == ["type2_singularity"], two


def main():
    check = "--check" in sys.argv
    grid = [(g, p) for g in GAPS for p in PRELOADS] if not check else [(0.002, 0.0), (0.002, 0.1), (0.0, 0.0), (0.0, 0.1)]
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        preload = list(pool.map(lambda c: preload_row(*c), grid))
        gains = list(pool.map(lambda c: preload_row(0.002, *c), GAINS[:2] if check else GAINS))
        type2 = list(pool.map(lambda c: type2_row(c[0], *c[1]), TYPE2))
    conclusions(preload, type2)
    tables = {"preload": preload_table(preload), "gains": gains_table(gains), "type2": type2_table(type2)}
    if check:
        text = PAGE.read_text(encoding="utf-8")
        for line in "".join(tables.values()).splitlines():
            if line not in text:
                sys.exit(f"docs/redundant-actuation.md has no line\n{line}\n{Path(__file__).name} ESMC writes it")
        print("as on the page")
        return
    page.put(PAGE, tables)


if __name__ == "__main__":
    ESMC = sys.argv[1]
    main()
