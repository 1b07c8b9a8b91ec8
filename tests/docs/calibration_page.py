#!/usr/bin/python3
"""Tables of docs/calibration.md. Python's standard library only.

usage: calibration_page.py ESMC             makes all runs and writes the tables anew
       calibration_page.py ESMC --check     makes a few of the runs again; they must lie within what the tables say

The runs, mechanisms and judges are those of tests/cli."""
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

PAGE, SCENES = ROOT / "docs/calibration.md", ROOT / "host_sim/scenes"
CASES = 30


def one_calibration(esmc, bits, case):
    """Effector off before and after, m, and how many true values lie within two standard uncertainties."""
    draw = random.Random(1000 * bits + case)
    with tempfile.TemporaryDirectory() as folder:
        bench = geometry.Bench(esmc, SCENES, folder)
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


def calibration_table(esmc, cases):
    out = ["| encoders | scale from | effector beside, before | after: median | after: largest | true values within 2 standard uncertainties |",
           "|---|---|---|---|---|---|"]
    for bits in (14, 16, 18):
        with ThreadPoolExecutor(2) as pool:
            runs = list(pool.map(lambda c: one_calibration(esmc, bits, c), range(cases)))
        before = [1e3 * b for b, _ in runs]
        for way, name in enumerate(("half base, exact", "10 effector readings, 0.02 mm")):
            after = [1e3 * r[way][0] for _, r in runs]
            share = sum(r[way][1] for _, r in runs) / sum(r[way][2] for _, r in runs)
            out.append(f"| {bits} bit | {name} | {min(before):.1f} to {max(before):.1f} mm | {statistics.median(after):.4f} mm | "
                       f"{max(after):.4f} mm | {100 * share:.0f} % |")
    return "\n".join(out) + "\n"


def check_calibration(esmc, table):
    """Two cases of each row may not be worse than its largest."""
    for row in [r for r in table.splitlines() if r.startswith("| 1")][::2]:
        bits = int(row.split()[1])
        for case in (0, 1):
            _, found = one_calibration(esmc, bits, case)
            for line, (after, _, _) in zip([r for r in table.splitlines() if r.startswith(f"| {bits} ")], found):
                largest = float(line.split("|")[5].split()[0])
                if not 1e3 * after <= largest + 1e-4:
                    yield f"{bits} bits, case {case}: {1e3 * after} mm, the table's largest is {largest}"


TABLES = {"calibrate": (lambda esmc: calibration_table(esmc, CASES), check_calibration)}


def main():
    if len(sys.argv) not in (2, 3) or (len(sys.argv) == 3 and sys.argv[2] != "--check"):
        print(__doc__, file=sys.stderr)
        return 2
    esmc, check = sys.argv[1], len(sys.argv) == 3
    text, wrong = PAGE.read_text(encoding="utf-8"), []
    for name, (make, verify) in TABLES.items():
        block = re.compile(rf"(<!-- {name} -->\n)(.*?)(<!-- /{name} -->)", re.S)
        if len(block.findall(text)) != 1:
            wrong.append(f"the markers of {name} are gone")
        elif check:
            wrong += list(verify(esmc, block.search(text)[2]))
        else:
            table = make(esmc)
            text = block.sub(lambda m: m[1] + table + m[3], text)
    wrong += geometry.failures
    if not check and not wrong:
        PAGE.write_text(text, encoding="utf-8")
    for what in wrong:
        print("FAILED:", what)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
