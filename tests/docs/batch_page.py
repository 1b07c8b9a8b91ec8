#!/usr/bin/python3
"""What batches cost beside a yardstick: the tables `batch` and `roofline` of docs/performance.md.

usage: batch_page.py BATCH ESMC MODULE_FOLDER [--update]     without --update: a short run, whose results must agree"""
import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import page

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/performance.md"
SPEC = ROOT / "host_sim/sweeps/b7_uncertain.toml"
UPDATE = "--update" in sys.argv
CASES, ROUNDS, TURNS = (4000, 5, 7) if UPDATE else (64, 1, 1)
# What a core of AMD's Zen 5 does in a cycle at most, with eight numbers at once: published figures; the division was measured.
PORTS = {"all": 8, "load": 2, "store": 1, "divide": 1 / 4}
ARITHMETIC = {("add",): 2, ("multiply",): 2, ("add", "multiply", "other"): 4}
KINDS = (("divide", r"vdivpd|vsqrtpd"), ("multiply", r"vmulpd|vfn?m(add|sub)\w*pd"), ("add", r"v(add|sub|cmp\w*|max|min)pd"))


def said(*command):
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"batch_page.py: {command}: {done.stderr}")
    return done.stdout


def disassembly(program):
    """Address -> (mnemonic, operands)."""
    lines = re.findall(r"^\s*([0-9a-f]+):\t(?:\{\w+\} )?(\S+)[ \t]*([^#<\n]*)", said("objdump", "-d", "--no-show-raw-insn", "-M", "intel", program), re.M)
    return {int(a, 16): (m, o) for a, m, o in lines}


def classes(program, code, which):
    """Instructions of a tick of eight mechanisms, by what they need."""
    out = dict.fromkeys((*PORTS, "add", "multiply", "other", "scalar"), 0.0)
    for address, n in json.loads(said(program, SPEC, "trace", which)).items():
        mnemonic, operands = code.get(int(address, 16), ("", ""))
        out["all"] += n
        first, *rest = operands.split(",")
        if "[" in first and mnemonic.startswith("vmov"):
            out["store"] += n
        elif "[" in operands and mnemonic.startswith("v"):
            out["load"] += n
        kind = next((k for k, pattern in KINDS if re.fullmatch(pattern, mnemonic)), None)
        if kind:
            out[kind] += n
        elif "zmm" in operands and "[" not in operands:
            out["other"] += n
        elif "zmm" not in operands:
            out["scalar"] += n
    return out


def measure(batch, esmc, folder):
    sys.path.insert(0, folder)
    import esmc as module  # pylint: disable=import-outside-toplevel

    best = {}
    with tempfile.NamedTemporaryFile("w", suffix=".toml", dir=SPEC.parent, encoding="utf-8") as spec:
        text = SPEC.read_text(encoding="utf-8")
        spec.write(re.sub(r"^count = \d+", f"count = {CASES}", text, flags=re.M))
        spec.flush()
        scene = module.Scene.load(str(ROOT / "host_sim/scenes/five_bar_circle.toml")).set("simulation.duration", 1.0).set("simulation.step", 1e-3)
        ranges, legs = {}, {"l1": 0.12, "l2": 0.16, "lg1": 0.06, "lg2": 0.068, "m1": 0.1, "m2": 0.1, "J1": 2e-4, "J2": 7e-4}
        for key, low, high in re.findall(r'^key = "(.*)"\nfactor = \[(.*), (.*)\]', text, re.M):
            value = legs[key.rsplit(".", 1)[1]]
            ranges[key] = (value * float(low), value * float(high))
        objectives = json.loads(re.search(r"^objectives = (.*)", text, re.M)[1])
        figures = {}
        for _ in range(TURNS):
            now = json.loads(said(batch, spec.name, min(CASES, 800), ROUNDS))
            if now["lanes"] != 8:
                return None
            told = said(esmc, "sweep", spec.name, "--jobs", 1)
            now["sweep"] = float(re.search(r"(\d+) simulated seconds per core-second", told)[1])
            begin = time.process_time()
            result = module.rollout(scene, ranges, n=CASES, threads=1, objectives=objectives)
            now["python"] = CASES / (time.process_time() - begin)
            assert set(result["outcome"]) == {"ok"}
            for k, v in now.items():
                best[k] = max(v, best.get(k, 0.0))
            figures = now
    assert figures["apart"] < 1e-4 and figures["rounded_apart"] < 1e-11, "the yardstick computes something else"
    return best


def tables(best, batch):
    of = [("the yardstick", "yardstick"), ("the yardstick without fused multiply-add, closure restored", "rounded"), ("the lanes alone", "sweep_lanes"), ("`esmc sweep --jobs 1`", "sweep"), ("`esmc.rollout(threads=1)`", "python")]
    first = "| | simulated s per s of CPU time | of the yardstick |\n|---|---|---|\n"
    first += "".join(f"| {name} | {best[k]:.0f} | {best[k] / best['yardstick']:.2f} |\n" for name, k in of)
    code = disassembly(batch)
    second = "| per tick of eight mechanisms | yardstick | lanes |\n|---|---|---|\n"
    count = [classes(batch, code, w) for w in ("yardstick", "lanes")]
    cycles = [8e-3 / best[k] * best["clock"] for k in ("yardstick", "sweep_lanes")]
    names = (("all", "instructions"), ("add", "of these additions, subtractions, comparisons"), ("multiply", "multiplications, fused ones included"),
             ("divide", "divisions, square roots"), ("other", "other operations on vectors: selections, bits of a number, constants"),
             ("load", "loads"), ("store", "stores"), ("scalar", "without vectors of eight"))
    for k, name in names:
        second += f"| {name} | {count[0][k]:.0f} | {count[1][k]:.0f} |\n"
    bound = [{k: c[k] / n for k, n in PORTS.items()} for c in count]
    for b, c in zip(bound, count):
        b["arithmetic"] = max(sum(c[k] for k in of) / n for of, n in ARITHMETIC.items())
    for k, name in (("all", "cycles at least: decoded and retired"), ("arithmetic", "arithmetic"), ("divide", "divider"), ("load", "loads"), ("store", "stores")):
        second += f"| {name} | {bound[0][k]:.0f} | {bound[1][k]:.0f} |\n"
    second += f"| cycles measured, at {best['clock'] / 1e9:.2f} GHz | {cycles[0]:.0f} | {cycles[1]:.0f} |\n"
    return {"batch": first, "roofline": second}


def main():
    batch, esmc, folder = sys.argv[1:4]
    best = measure(batch, esmc, folder)
    if best is None:
        print("no AVX-512 here: nothing to compare")
        return 0
    if not UPDATE:
        print(f"largest difference of an effector error: {best['apart']:.2g}")
        return 0
    made = tables(best, batch)
    print(*made.values(), sep="\n")
    page.put(PAGE, made)
    return 0


if __name__ == "__main__":
    sys.exit(main())
