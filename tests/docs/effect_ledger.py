#!/usr/bin/python3
"""The effect ledger of docs/effects.md: what each effect changes in the comparison scenario, and what it costs.

usage: effect_ledger.py ESMC RHS_COST SCENE --update   measures everything and writes the table
       effect_ledger.py ESMC                           checks the table: every effect of the program has a row, and what
                                                       does not depend on the machine is what the program computes now"""
import json
import math
import re
import subprocess
import sys
import tempfile
from pathlib import Path

PAGE = Path(__file__).resolve().parents[2] / "docs/effects.md"
BEGIN, END = "<!-- ledger -->\n", "<!-- /ledger -->"
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


def row(e):
    return (f"| `{e['effect']}` | `{e['parameters']}` | {e['integrator']} | {e['deviation_m']:.2g} | {e['settled_max_rad']:.2g} "
            f"| {e['states_added']} | ")


def main():
    esmc = sys.argv[1]
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    table, after = rest.split(END)
    effects = study(esmc)
    if "--update" in sys.argv:
        cost, scene = sys.argv[2:4]
        bare = instructions(cost)
        table = HEAD + f"| none | | rk4 | 0 | {effects[0]['without_rad']:.2g} | 0 | {bare:.0f} | 1 |\n"
        for e in effects:
            toml = f'type = "{e["effect"]}", {e["parameters"]}'
            table += row(e) + f"{instructions(cost, scene, toml):.0f} | {e['ns_per_step'] / e['ns_without']:.2f} |\n"
        PAGE.write_text(before + BEGIN + table + END + after, encoding="utf-8")
        return 0
    problems = []
    keys = subprocess.run([esmc, "keys"], capture_output=True, text=True, check=True).stdout
    types = re.search(r"`effects.type` \| one of: ([a-z_, ]+)", keys)[1].strip().split(", ")
    problems += [f"{t} has no row" for t in types if f"| `{t}` |" not in table]
    have = {line.rsplit("|", 3)[0] for line in table.splitlines() if line.startswith("| `")}
    for e in effects:
        if not any(same(line, row(e).rstrip(" ").rsplit("|", 1)[0]) for line in have):
            problems.append(f"no row says what the program computes: {row(e)}")
    print("\n".join(problems) or f"{len(effects)} rows agree with the program")
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
