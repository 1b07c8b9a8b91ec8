#!/usr/bin/python3
"""The effect ledger of docs/effects.md: what each effect changes in the comparison scenario, and what it costs.

usage: effect_ledger.py ESMC RHS_COST SCENE --update   measures everything and writes the tables
       effect_ledger.py ESMC --update-bus              that of the bus effects alone
       effect_ledger.py ESMC                           checks the table: every effect of the program has a row, and what
                                                       does not depend on the machine is what the program computes now"""
import json
import math
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import page

PAGE = Path(__file__).resolve().parents[2] / "docs/effects.md"
HEAD = ("| effect | parameters | integrator | effector moves by, m | settled error with it, rad | states | instructions per step "
        "| time per step, relative |\n|---|---|---|---|---|---|---|---|\n")


def instructions(program, *arguments):
    """Per step of the plant: a long run less a short one."""
    def count(steps):
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run(["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/out", program, str(steps),
                                   *arguments], capture_output=True, text=True, check=True)
        return int(re.search(r"Collected : (\d+)", done.stderr)[1])
    short, long = 500, 1500
    return (count(long) - count(short)) / (long - short)


def study(esmc):
    done = subprocess.run([esmc, "accuracy", "--quick", "--json"], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)["effects"]


# Effects of the bus act in `esmc hil` only; their rows are made here, from its runs.
BUS_HEAD = ("| effect | parameters | effector moves by, m | settled error with it, rad | fault | time per tick, relative |\n"
            "|---|---|---|---|---|---|\n")
BUS_EFFECTS = [  # name, parameters, whether bit_timing stands beside it
    ("bit_timing", "", False), ("loss", "probability = 0.01", False), ("duplication", "probability = 0.05", True),
    ("corruption", "detected = 0.01", True), ("corruption", "undetected = 0.0001", False),
    ("babbling_node", "identifier = 0, rate_hz = 2000.0", True),
    ("babbling_node", "identifier = 0, rate_hz = 1e5, from = 0.5", True),
    ("bus_off", "at = 0.5", False), ("drive_dropout", "drive = 2, from = 0.5, to = 0.502", False),
    ("drive_dropout", "drive = 2, from = 0.5, to = 0.6", False)]


SCENE = PAGE.parents[1] / "host_sim/scenes/five_bar_circle.toml"


def hil(esmc, effects):
    summary, rows = page.run(esmc, "hil", SCENE, f"effects=[{effects}]", log=True)
    return summary, [(r["x"], r["y"]) for r in rows]


def bus_rows(esmc):
    """A row without its cost, and the effects it is about."""
    bare, path = hil(esmc, "")
    for name, parameters, timed in BUS_EFFECTS:
        effects = ('{type="bit_timing"}, ' if timed else "") + "{" + f'type="{name}"' + (", " + parameters if parameters else "") + "}"
        summary, moved = hil(esmc, effects)
        off = max(math.dist(a, b) for a, b in zip(path, moved))
        faults = [f["name"] for f in summary["supervisor"]["faults"]]
        said = f"`{parameters}`" if parameters else ""
        if timed:
            said += ", beside `bit_timing`"
        # After a fault the mechanism is stopped: how far off that is says nothing about the effect.
        yield (f"| `{name}` | {said} | {'' if faults else f'{off:.2g}'} | {summary['tracking']['settled_max_rad']:.2g} "
               f"| {faults[0] if faults else 'none'} "), effects


def bus_table(esmc):
    return BUS_HEAD + "".join(f"{line}| {relative_time(esmc, effects)} |\n" for line, effects in bus_rows(esmc))


def relative_time(esmc, effects):
    """Of the loop without files, best of several in turns."""
    pairs = [[page.run(esmc, "hil", SCENE, f"effects=[{e}]")["wall_s"] for e in (effects, "")] for _ in range(9)]
    return f"{min(p[0] for p in pairs) / min(p[1] for p in pairs):.1f}"


def row(e):
    return (f"| `{e['effect']}` | `{e['parameters']}` | {e['integrator']} | {e['deviation_m']:.2g} | {e['settled_max_rad']:.2g} "
            f"| {e['states_added']} | ")


def main():
    esmc = sys.argv[1]
    if "--update-bus" in sys.argv:
        page.put(PAGE, {"bus ledger": bus_table(esmc)})
        return 0
    effects = study(esmc)
    if "--update" in sys.argv:
        cost, scene = sys.argv[2:4]
        bare = instructions(cost)
        table = HEAD + f"| none | | rk4 | 0 | {effects[0]['without_rad']:.2g} | 0 | {bare:.0f} | 1 |\n"
        for e in effects:
            toml = f'type = "{e["effect"]}", {e["parameters"]}'
            table += row(e) + f"{instructions(cost, scene, toml):.0f} | {e['ns_per_step'] / e['ns_without']:.2f} |\n"
        page.put(PAGE, {"ledger": table, "bus ledger": bus_table(esmc)})
        return 0
    problems, table, bus = [], page.part(PAGE, "ledger"), page.part(PAGE, "bus ledger")
    keys = subprocess.run([esmc, "keys"], capture_output=True, text=True, check=True).stdout
    types = re.search(r"`effects.type` \| one of: ([a-z_, ]+)", keys)[1].strip().split(", ")
    problems += [f"{t} has no row" for t in types if f"| `{t}` |" not in table + bus]
    have = {line.rsplit("|", 3)[0] for line in table.splitlines() if line.startswith("| `")}
    for e in effects:
        if not any(same(line, row(e).rstrip(" ").rsplit("|", 1)[0]) for line in have):
            problems.append(f"no row says what the program computes: {row(e)}")
    have = {line.rsplit("|", 2)[0] for line in bus.splitlines() if line.startswith("| `")}
    rows = list(bus_rows(esmc))
    problems += [f"no row says what the program computes: {r}" for r, _ in rows if not any(same(line, r) for line in have)]
    print("\n".join(problems) or f"{len(effects) + len(rows)} rows agree with the program")
    return 1 if problems else 0


def same(line, want):
    """Text equal, numbers within 5 %: compilers differ in the last bits, and chatter magnifies them."""
    a, b = line.split("|"), want.split("|")
    return len(a) == len(b) and all(close(x.strip(), y.strip()) for x, y in zip(a, b))


def close(x, y):
    try:
        return math.isclose(float(x), float(y), rel_tol=0.06, abs_tol=1e-6)
    except ValueError:
        return x == y


if __name__ == "__main__":
    sys.exit(main())
