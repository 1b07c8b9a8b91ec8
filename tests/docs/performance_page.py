#!/usr/bin/python3
"""The tables of docs/performance.md that benchmarks make: what one run measured, and laws beside their yardsticks.

usage: performance_page.py BENCHMARKS [--update]     with --update: runs them (two minutes, on a machine with nothing else to do)
       without: every benchmark has its row, every row its benchmark, and ratios are those of the rows
       performance_page.py --self-test"""
import json
import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).resolve().parents[2] / "docs/performance.md"
YARDSTICKS = (("law/five_bar/esmc/double", "law/five_bar/straight_line_esmc/double"),
              ("law/five_bar/esmc_projected/double", "law/five_bar/straight_line_esmc_projected/double"),
              ("law/rr/esmc/double", "law/rr/straight_line_esmc/double"),
              ("law/rr/esmc/double", "law/rr/hand_written_esmc/double"),
              ("plant/five_bar/kkt/double", "plant/five_bar/straight_line/double"),
              ("law/five_bar/esmc/float", "law/five_bar/esmc/double"),
              ("law/five_bar/esmc_projected/float", "law/five_bar/esmc_projected/double"))


def split(text, name):
    begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    head, rest = text.split(begin)
    body, tail = rest.split(end)
    return head + begin, body, end + tail


def tables(ns):
    """Rows of times, rows of ratios; ns: {name: ns per call}."""
    times = ["| benchmark | ns per call |", "|---|---|"] + [f"| `{name}` | {value:.1f} |" for name, value in sorted(ns.items())]
    ratios = ["| this | beside | takes |", "|---|---|---|"]
    ratios += [f"| `{name}` | `{yard}` | {round(ns[name], 1) / round(ns[yard], 1):.2f} |" for name, yard in YARDSTICKS]
    return "\n".join(times) + "\n", "\n".join(ratios) + "\n"


def measure(program):
    out = subprocess.run([program, "--benchmark_format=json", "--benchmark_repetitions=9", "--benchmark_min_time=0.2",
                          "--benchmark_enable_random_interleaving=true"], capture_output=True, text=True, check=True).stdout
    runs = json.loads(out)["benchmarks"]
    return {r["run_name"]: r["cpu_time"] for r in runs if r.get("aggregate_name") == "median"}


def rows(text):
    return {m[1]: float(m[2]) for m in re.finditer(r"^\| `([^`]+)` \| (\d+\.\d) \|$", text, re.M)}


def wrong(text, names):
    _, times, _ = split(text, "times")
    _, ratios, _ = split(text, "ratios")
    said = rows(times)
    yield from (f"no row: {n}" for n in names if n not in said)
    yield from (f"no benchmark: {n}" for n in said if n not in names)
    if set(said) == set(names) and tables(said)[1] != ratios:
        yield "the ratios are not those of the times above"


def self_test():
    ns = dict.fromkeys([n for pair in YARDSTICKS for n in pair], 100.0) | {"law/rr/esmc/double": 140.2}
    times, ratios = tables(ns)
    page = f"a\n<!-- times -->\n{times}<!-- /times -->\n<!-- ratios -->\n{ratios}<!-- /ratios -->\n"
    assert not list(wrong(page, list(ns)))
    assert list(wrong(page, [*ns, "other"])) == ["no row: other"]
    assert list(wrong(page, [n for n in ns if n != "law/rr/esmc/double"])) == ["no benchmark: law/rr/esmc/double"]
    assert list(wrong(page.replace("1.40", "1.10"), list(ns))), "a ratio that is not that of its times"


def main():
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    program, text = sys.argv[1], PAGE.read_text(encoding="utf-8")
    if "--update" in sys.argv:
        for name, table in zip(("times", "ratios"), tables(measure(program))):
            head, _, tail = split(text, name)
            text = head + table + tail
        PAGE.write_text(text, encoding="utf-8")
    names = subprocess.run([program, "--benchmark_list_tests"], capture_output=True, text=True, check=True).stdout.split()
    found = list(wrong(text, names))
    print("\n".join(found) if found else f"{len(names)} benchmarks")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
