#!/usr/bin/python3
"""What the laws cost beside the same law as straight-line code, as one written by hand, and in the other precision: instructions of
one call, counted by callgrind, so that no clock is asked. docs/performance.md has the times.

usage: law_cost.py BENCHMARKS"""
import re
import subprocess
import sys
import tempfile
from pathlib import Path

# this, beside, at most
LIMITS = (("law/five_bar/esmc/double", "law/five_bar/straight_line_esmc/double", 1.5),
          ("law/five_bar/esmc_projected/double", "law/five_bar/straight_line_esmc_projected/double", 1.5),
          ("law/rr/esmc/double", "law/rr/straight_line_esmc/double", 1.5),
          ("law/rr/esmc/double", "law/rr/hand_written_esmc/double", 1.1),
          ("law/five_bar/esmc/float", "law/five_bar/esmc/double", 1.02),
          ("law/five_bar/esmc_projected/float", "law/five_bar/esmc_projected/double", 1.02))
CALLS = re.compile(r"\btorque_of<|\bcalled<")  # of benchmarks.cpp: what is timed


def per_call(lines):
    """Instructions of one call with all it calls, from callgrind's lines; the function is the one that matches CALLS."""
    names, calls, cost, callee, pending = {}, 0, 0, None, 0
    for line in lines:
        if m := re.match(r"(c?fn)=\((\d+)\)(?: (.*))?", line):
            if m[3]:
                names[m[2]] = m[3]
            if m[1] == "cfn":
                callee = m[2]
        elif m := re.match(r"calls=(\d+)", line):
            pending = int(m[1])
        elif pending:  # the line after `calls`: what these cost
            if CALLS.search(names[callee]):
                calls += pending
                cost += int(line.split()[-1])
            pending = 0
    if not calls:
        sys.exit("no call of a law was counted")
    return cost / calls


def instructions(program, name):
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "calls"
        subprocess.run(["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", program, f"--benchmark_filter=^{name}$",
                        "--benchmark_min_time=0.001"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
        return per_call(out.read_text(encoding="utf-8", errors="replace").splitlines())


def self_test():
    text = "fn=(1) main\n10 5\ncfn=(2) auto called<Law>()\ncalls=4 7\n10 4000\ncfn=(3) other\ncalls=9 1\n10 9\ncfn=(2)\ncalls=1 7\n11 1500\n"
    assert per_call(text.splitlines()) == 1100


def main(program):
    self_test()
    counted = {name: instructions(program, name) for name in sorted({n for this, beside, _ in LIMITS for n in (this, beside)})}
    broken = 0
    for this, beside, most in LIMITS:
        ratio = counted[this] / counted[beside]
        broken += ratio > most
        print(f"{'TOO MANY ' if ratio > most else ''}{this}: {counted[this]:.0f} instructions, {ratio:.2f} x {beside}, at most {most}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
