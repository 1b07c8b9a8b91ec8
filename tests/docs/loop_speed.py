#!/usr/bin/python3
"""How fast the closed loop on frames runs: the table `loop` of docs/performance.md.

usage: loop_speed.py ESMC [--update]     with --update: measures (a minute, on a machine with nothing else to do)
       without: the instructions of a tick are what is counted now"""
import re
import resource
import subprocess
import sys
from pathlib import Path

import page

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/performance.md"
SCENE = ROOT / "host_sim/scenes/five_bar_circle.toml"
ROWS = (("0.5 ms RK4, ODrive", ["simulation.step=0.5e-3"]),
        ("1 ms RK4, ODrive, as the campaign", ["simulation.step=1e-3"]),
        ("1 ms RK4, CiA 402", ["simulation.step=1e-3", "drives.protocol=cia402"]),
        ("1 ms RK4, MIT", ["simulation.step=1e-3", "drives.protocol=mit", "drives.position_range=40.0", "drives.velocity_range=200.0"]))
TOLERANCE = 0.02
REPEATS = 40  # of a shared machine the best run says what the program takes


def command(esmc, sets, seconds):
    return [esmc, "hil", SCENE, "--json", *(a for s in (*sets, f"simulation.duration={seconds}") for a in ("--set", s))]


def run(arguments):
    done = subprocess.run(list(map(str, arguments)), capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"loop_speed.py: {arguments[0]}: {done.stderr}")
    return done.stderr


def instructions(esmc, sets):
    """Of a tick: what a second more takes. Start-up and arming cancel."""
    def of(seconds):
        said = run(["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", *command(esmc, sets, seconds)])
        return int(re.search(r"Collected : (\d+)", said)[1])
    return (of(1.5) - of(0.5)) / 1000


def speed(esmc, sets):
    """Simulated seconds per second of the processor in the program, of what 50 s more take: the best runs of each length."""
    def of(seconds):
        def used():
            before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
            run(command(esmc, sets, seconds))
            return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        return min(used() for _ in range(REPEATS))
    return 50 / (of(60) - of(10))


def main():
    esmc, table = sys.argv[1], page.part(PAGE, "loop")
    if "--update" in sys.argv:
        table = "| loop at 1 kHz | instructions per tick | x real time |\n|---|---|---|\n"
        table += "".join(f"| {name} | {instructions(esmc, sets):.0f} | {speed(esmc, sets):.0f} |\n" for name, sets in ROWS)
        page.put(PAGE, {"loop": table})
    wrong = 0
    for name, sets in ROWS:
        said = re.search(rf"^\| {re.escape(name)} \| (\d+) \| \d+ \|$", table, re.M)
        now = instructions(esmc, sets)
        if not said or abs(int(said[1]) - now) > TOLERANCE * now:
            wrong += 1
            print(f"{name}: {said[1] if said else 'no row'}, counted now: {now:.0f}")
    print(f"{len(ROWS) - wrong} of {len(ROWS)} rows as counted")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
