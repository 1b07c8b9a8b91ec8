#!/usr/bin/python3
"""Tables of docs/calibration.md. Python's standard library only.

usage: calibration_page.py ESMC [TABLE]     makes all runs, or those of one table, and writes what they say
       calibration_page.py ESMC --check     makes a few of the runs again; they must lie within what the tables say

The runs, mechanisms and judges are those of tests/cli."""
import json
import random
import re
import statistics
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/cli"))
sys.dont_write_bytecode = True
import calibrate_test as geometry  # noqa: E402
import identify_test as dynamics  # noqa: E402
from command import SCENES, esmc, sets  # noqa: E402
from log_bench import failures  # noqa: E402
import page  # noqa: E402

PAGE = ROOT / "docs/calibration.md"
CASES = 30


def one_calibration(bits, case):
    """Effector off before and after, m, and how many true values lie within two standard uncertainties."""
    draw = random.Random(1000 * bits + case)
    with tempfile.TemporaryDirectory() as folder:
        bench = geometry.Bench(folder)
        mechanism = {"half_base": 0.05 * (1 + 0.01 * draw.uniform(-1, 1)),
                     "legs": [tuple(l * (1 + 0.01 * draw.uniform(-1, 1)) for l in (0.12, 0.16)) for _ in range(2)]}
        bias = [5e-3 * draw.uniform(-1, 1) for _ in range(4)]
        base = Path(folder) / "base.toml"
        base.write_text(bench.nominal.read_text(encoding="utf-8").replace("bits = 16", f"bits = {bits}"), encoding="utf-8")
        out, _ = bench.record("run", "sim", bench.true_scene("true", mechanism, bias, base))
        rows = geometry.rows_of(out)
        readings = geometry.write_readings(Path(folder) / "readings.csv", rows, range(100, 2000, 190), 2e-5, draw)
        before, _ = geometry.errors(rows, geometry.NOMINAL["half_base"], geometry.NOMINAL["legs"], [0] * 4)
        result = []
        truth = {o: -b for o, b in zip(geometry.OFFSETS, bias)} | {"half_base": mechanism["half_base"]}
        for j, leg in enumerate(mechanism["legs"], 1):
            truth |= {f"leg {j} l1": leg[0], f"leg {j} l2": leg[1]}
        for way in (("--half-base", mechanism["half_base"]), ("--effector", readings, "--effector-sigma", "2e-5")):
            found = geometry.values(bench.good(out, *way))
            after, _ = geometry.errors(rows, *geometry.geometry(found, mechanism["half_base"]))
            inside = [abs(v - truth[n]) <= 2 * s for n, (v, s) in found.items()]
            result.append((after, sum(inside), len(inside)))
        return before, result


def calibration_table(cases):
    out = ["| encoders | scale from | effector beside, before | after: median | after: largest | true values within 2 standard uncertainties |",
           "|---|---|---|---|---|---|"]
    for bits in (14, 16, 18):
        with ThreadPoolExecutor(2) as pool:
            runs = list(pool.map(lambda c: one_calibration(bits, c), range(cases)))
        before = [1e3 * b for b, _ in runs]
        for way, name in enumerate(("half base, exact", "10 effector readings, 0.02 mm")):
            after = [1e3 * r[way][0] for _, r in runs]
            share = sum(r[way][1] for _, r in runs) / sum(r[way][2] for _, r in runs)
            out.append(f"| {bits} bit | {name} | {min(before):.1f} to {max(before):.1f} mm | {statistics.median(after):.4f} mm | "
                       f"{max(after):.4f} mm | {100 * share:.0f} % |")
    return "\n".join(out) + "\n"


def check_calibration(table):
    """Two cases of each row may not be worse than its largest."""
    for row in [r for r in table.splitlines() if r.startswith("| 1")][::2]:
        bits = int(row.split()[1])
        for case in (0, 1):
            _, found = one_calibration(bits, case)
            for line, (after, _, _) in zip([r for r in table.splitlines() if r.startswith(f"| {bits} ")], found):
                largest = float(line.split("|")[5].split()[0])
                if not 1e3 * after <= largest + 1e-4:
                    yield f"{bits} bits, case {case}: {1e3 * after} mm, the table's largest is {largest}"


SENSING = [("base encoders alone", ['control.sensors="base"']), ("four, mean of the tips", []), ("four, fused", ["control.encoder_sigma=3e-4"]),
           ("fused, passive ones 10 x better", ["control.encoder_sigma=[3e-3, 3e-4, 3e-3, 3e-4]"])]
NOISE = 'type="noise", sigma=3e-4'
WORLDS = [("ideal", []), ("noise 3e-4 rad", [NOISE]), ("noise, theta11 off by 1 mrad", [NOISE, 'type="bias", angle=[1e-3, 0.0, 0.0, 0.0]']),
          ("noise, theta12 off by 1 mrad", [NOISE, 'type="bias", angle=[0.0, 1e-3, 0.0, 0.0]']),
          ("noise, all off by 1 mrad, signs + - + -", [NOISE, 'type="bias", angle=[1e-3, -1e-3, 1e-3, -1e-3]']),
          ("16-bit encoders", ['type="encoder", bits=16'])]
SEEDS = 8


def tracking(sensing, world, seed):
    """Effector rms after 0.25 s, m. Without the two tables that sensors = "base" has no use for."""
    text = (SCENES / "five_bar_fusion.toml").read_text(encoding="utf-8")
    text = re.sub(r"^encoder_sigma = .*\n", "", text, flags=re.M)
    if 'control.sensors="base"' in sensing:
        text = text.replace("[sensors]\nnodes = [3, 4]\n", "")
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.toml"
        scene.write_text(text, encoding="utf-8")
        run = esmc("sim", scene, "--json", "--seed", seed, *sets(*sensing, "effects=[" + ", ".join("{" + e + "}" for e in world) + "]", "control.delay_ticks=2"))
        if run.returncode != 0:
            failures.append(f"{sensing} {world}: {run.stderr}{run.stdout[-300:]}")
            return 0.0
        return json.loads(run.stdout)["tracking"]["settled_rms_m"]


def fusion_rows(seeds):
    out = ["| effector rms, mm | " + " | ".join(n for n, _ in SENSING) + " |", "|---|" + "---|" * len(SENSING)]
    jobs = [(s, w, seed) for _, w in WORLDS for _, s in SENSING for seed in range(1, seeds + 1)]
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda j: tracking(*j), jobs))
    for name, _ in WORLDS:
        cells = []
        for _ in SENSING:
            mine, found = found[:seeds], found[seeds:]
            cells.append(f"{1e3 * statistics.mean(mine):.3f}")
        out.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(out) + "\n"


def check_fusion(table):
    """One run of each cell, within a quarter of the table's mean."""
    again = fusion_rows(1).splitlines()
    for have, want in zip(again[2:], table.splitlines()[2:], strict=True):
        for a, b in zip(have.split("|")[2:-1], want.split("|")[2:-1], strict=True):
            if not abs(float(a) - float(b)) <= 0.25 * float(b) + 2e-3:
                yield f"fusion: {have} is not near {want}"


def identify_table(seeds):
    with tempfile.TemporaryDirectory() as folder:
        bench = dynamics.LogBench("identify", folder)
        inside, widths, runs = dynamics.five_bar(bench, seeds)
    out = [f"| parameter | half width of the interval, median | truth inside, of {runs} runs |", "|---|---|---|"]
    for name in inside:
        out.append(f"| {name} | {widths[name]:.2g} ticks | {inside[name]} |" if name == "delay" else
                   f"| `{name}` | {100 * widths[name]:.2g} % | {inside[name]} |")
    return "\n".join(out) + "\n"


def check_identify(table):
    """Two runs; interval widths within a factor of two, of friction, whose width varies more from run to run, of three."""
    again = identify_table(2)
    for have, want in zip(again.splitlines()[2:], table.splitlines()[2:], strict=True):
        a, b = (float(row.split("|")[2].split()[0]) for row in (have, want))
        factor = 3 if "coulomb" in want or "viscous" in want else 2
        if not b / factor <= a <= factor * b:
            yield f"identify: {have} is not near {want}"


TABLES = {"calibrate": (lambda: calibration_table(CASES), check_calibration),
          "fusion": (lambda: fusion_rows(SEEDS), check_fusion),
          "identify": (lambda: identify_table(60), check_identify)}


def main():
    if len(sys.argv) not in (2, 3) or (len(sys.argv) == 3 and sys.argv[2] not in ("--check", *TABLES)):
        print(__doc__, file=sys.stderr)
        return 2
    check = sys.argv[2:] == ["--check"]
    only = set(sys.argv[2:]) & set(TABLES) or set(TABLES)
    wrong, made = [], {}
    for name, (make, verify) in TABLES.items():
        if check:
            wrong += list(verify(page.part(PAGE, name)))
        elif name in only:
            made[name] = make()
    wrong += failures
    if made and not wrong:
        page.put(PAGE, made)
    for what in wrong:
        print("FAILED:", what)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
