#!/usr/bin/python3
"""The tables of docs/performance.md that benchmarks make: what one run measured, laws beside their yardsticks, and where the
instructions of a tick are.

usage: performance_page.py BENCHMARKS [--update]     with --update: runs them (two minutes, on a machine with nothing else to do)
       performance_page.py BENCHMARKS --tick         only the instructions of a tick
       without: every benchmark has its row, every row its benchmark, ratios are those of the rows, and the instructions of a tick
       what is counted now
       performance_page.py --self-test"""
import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/structure"))
import callgrind  # noqa: E402
import page  # noqa: E402

PAGE = ROOT / "docs/performance.md"
TICK = "tick/five_bar/esmc/double"
# What a tick does, and the functions whose own instructions it is (others are inlined into these); the first that matches.
STAGES = (("law: errors, rates and reaching term of 18 channels", r"_acceleration\b|\bdemand|angle_of_unit"),
          ("torque: Cᵀ(M v' + f + g), limits", r"Controller<.*>::apply_law\b"),
          ("where the mechanism is: closure, rates, guards", r"Controller<.*>::(observe|guarded)\b|estimate|::forward\b"),
          ("reference: path, inverse kinematics, rates", r"Reference<|Controller<.*>::desired?\b"),
          ("controller and supervisor: states, checks of the torque", r"Controller<|Supervisor|Outlook|within_limits_at"),
          ("drives and bus: ages, codecs, checks of what is sent", r"Cycle<|OdriveAxis|odrive|CanFrame|VirtualBus"))
TOLERANCE = 0.01
YARDSTICKS = (("law/five_bar/esmc/double", "law/five_bar/straight_line_esmc/double"),
              ("law/five_bar/esmc_projected/double", "law/five_bar/straight_line_esmc_projected/double"),
              ("law/rr/esmc/double", "law/rr/straight_line_esmc/double"),
              ("law/rr/esmc/double", "law/rr/hand_written_esmc/double"),
              ("plant/five_bar/kkt/double", "plant/five_bar/straight_line/double"),
              ("law/five_bar/esmc/float", "law/five_bar/esmc/double"),
              ("law/five_bar/esmc_projected/float", "law/five_bar/esmc_projected/double"))


def tables(ns):
    """Rows of times, rows of ratios; ns: {name: ns per call}."""
    times = ["| benchmark | ns per call |", "|---|---|"] + [f"| `{name}` | {value:.1f} |" for name, value in sorted(ns.items())]
    ratios = ["| this | beside | takes |", "|---|---|---|"]
    ratios += [f"| `{name}` | `{yard}` | {round(ns[name], 1) / round(ns[yard], 1):.2f} |" for name, yard in YARDSTICKS]
    return "\n".join(times) + "\n", "\n".join(ratios) + "\n"


def tick_table(own, calls):
    """Rows of the stages from a profile of the tick's benchmark."""
    ticks = sum(n for function, (n, _) in calls.items() if re.search(r"\bCycle<.*>::tick<", function))
    counts = dict.fromkeys([stage for stage, _ in STAGES], 0.0)
    for function, cost in own.items():
        if "esmc::" in function and "anonymous namespace" not in function and "::Config" not in function and not re.search(r">::(Cycle|Controller)\(", function):
            stage = next((s for s, pattern in STAGES if re.search(pattern, function)), None)
            if stage:
                counts[stage] += cost / ticks
    whole = sum(counts.values())
    lines = ["| part of a tick | instructions | share |", "|---|---|---|"]
    lines += [f"| {stage} | {n:.0f} | {100 * n / whole:.0f} % |" for stage, n in counts.items()]
    return "\n".join([*lines, f"| together | {whole:.0f} | |"]) + "\n"


def count(program):
    return tick_table(*callgrind.profile(program, f"--benchmark_filter=^{TICK}$", "--benchmark_min_time=0.05"))


def same_counts(shown, now):
    a, b = ([[float(x) for x in re.findall(r"\| (\d+) \|", line)] for line in table.splitlines()] for table in (shown, now))
    return len(a) == len(b) and all(len(x) == len(y) and all(abs(p - q) <= max(5, TOLERANCE * q) for p, q in zip(x, y)) for x, y in zip(a, b))


def measure(program):
    out = subprocess.run([program, "--benchmark_format=json", "--benchmark_repetitions=9", "--benchmark_min_time=0.2",
                          "--benchmark_enable_random_interleaving=true"], capture_output=True, text=True, check=True).stdout
    runs = json.loads(out)["benchmarks"]
    return {r["run_name"]: r["cpu_time"] for r in runs if r.get("aggregate_name") == "median"}


def rows(text):
    return {m[1]: float(m[2]) for m in re.finditer(r"^\| `([^`]+)` \| (\d+\.\d) \|$", text, re.M)}


def wrong(text, names):
    said, ratios = rows(page.cut(text, "times")[1]), page.cut(text, "ratios")[1]
    yield from (f"no row: {n}" for n in names if n not in said)
    yield from (f"no benchmark: {n}" for n in said if n not in names)
    if set(said) == set(names) and tables(said)[1] != ratios:
        yield "the ratios are not those of the times above"


def self_test():
    ns = dict.fromkeys([n for pair in YARDSTICKS for n in pair], 100.0) | {"law/rr/esmc/double": 140.2}
    times, ratios = tables(ns)
    text = f"a\n<!-- times -->\n{times}<!-- /times -->\n<!-- ratios -->\n{ratios}<!-- /ratios -->\n"
    assert not list(wrong(text, list(ns)))
    assert list(wrong(text, [*ns, "other"])) == ["no row: other"]
    assert list(wrong(text, [n for n in ns if n != "law/rr/esmc/double"])) == ["no benchmark: law/rr/esmc/double"]
    assert list(wrong(text.replace("1.40", "1.10"), list(ns))), "a ratio that is not that of its times"
    callgrind.self_test()
    own = {"void esmc::demand<X>()": 900, "esmc::Cycle<X, Y>::tick<Z>(Z&)": 300, "esmc::(anonymous namespace)::bench()": 70, "strcmp": 8}
    table = tick_table(own, {"esmc::Cycle<X, Y>::tick<Z>(Z&)": [3, 1500]})
    assert "channels | 300 | 75 % |" in table and "sent | 100 | 25 % |" in table and "together | 400 |" in table, table
    assert same_counts(table, table.replace("300", "301")) and not same_counts(table, table.replace("300", "330"))


def main():
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    program = sys.argv[1]
    if "--update" in sys.argv:
        page.put(PAGE, dict(zip(("times", "ratios"), tables(measure(program)))))
    if "--update" in sys.argv or "--tick" in sys.argv:
        page.put(PAGE, {"tick": count(program)})
    text = PAGE.read_text(encoding="utf-8")
    names = subprocess.run([program, "--benchmark_list_tests"], capture_output=True, text=True, check=True).stdout.split()
    found = list(wrong(text, names))
    now = count(program)
    if not same_counts(page.cut(text, "tick")[1], now):
        found.append(f"a tick is now\n{now}")
    print("\n".join(found) if found else f"{len(names)} benchmarks")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
