#!/usr/bin/python3
"""What the laws cost beside the same law as straight-line code, as one written by hand, and in the other precision: instructions of
one call, counted by callgrind, so that no clock is asked. docs/performance.md has the times.

usage: law_cost.py BENCHMARKS"""
import re
import sys

import callgrind

# this, beside, at most
LIMITS = (("law/five_bar/esmc/double", "law/five_bar/straight_line_esmc/double", 1.5),
          ("law/five_bar/esmc_projected/double", "law/five_bar/straight_line_esmc_projected/double", 1.5),
          ("law/rr/esmc/double", "law/rr/straight_line_esmc/double", 1.5),
          ("law/rr/esmc/double", "law/rr/hand_written_esmc/double", 1.1),
          ("law/five_bar/esmc/float", "law/five_bar/esmc/double", 1.02),
          ("law/five_bar/esmc_projected/float", "law/five_bar/esmc_projected/double", 1.02))
CALLS = re.compile(r"\btorque_of<|\bcalled<")  # of benchmarks.cpp: what is timed


def instructions(program, name):
    """Of one call of a law, with all it calls."""
    _, calls = callgrind.profile(program, "--counted", f"--benchmark_filter=^{name}/iterations")
    counted = [entry for function, entry in calls.items() if CALLS.search(function)]
    if not counted:
        sys.exit(f"{name}: no call of a law was counted")
    return sum(cost for _, cost in counted) / sum(n for n, _ in counted)


def main(program):
    callgrind.self_test()
    counted = {name: instructions(program, name) for name in sorted({n for this, beside, _ in LIMITS for n in (this, beside)})}
    broken = 0
    for this, beside, most in LIMITS:
        ratio = counted[this] / counted[beside]
        broken += ratio > most
        print(f"{'TOO MANY ' if ratio > most else ''}{this}: {counted[this]:.0f} instructions, {ratio:.2f} x {beside}, at most {most}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
