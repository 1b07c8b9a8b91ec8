#!/usr/bin/python3
"""Instructions that the planning of a program takes per second of its motion, by callgrind; nothing here depends on a clock.

usage: plan_cost.py PLAN_COST [GRID ...]   (with grids: the price of each, and the time that it loses beside the finest)"""
import subprocess
import sys

import callgrind

WANTED = 3.0  # million instructions per second of motion
# Million instructions per second of motion: what was counted (2026-11-26), and a fifth.
LIMITS = {"pick_and_place": 9.5, "four_motors": 16, "in_time": 1, "rectangle": 11.3, "rectangle_at_speed": 2.3, "arm": 3.5, "arm_with_friction": 7.1,
          "joint_moves": 6.6}


def planned(program, name, *grid):
    """(million instructions, s of motion)"""
    run = subprocess.run([program, name, *grid], capture_output=True, text=True, check=True)
    _, calls = callgrind.profile(program, name, *grid)
    counted = [cost for function, (_, cost) in calls.items() if "plan::plan<" in function]
    if len(counted) != 1:
        sys.exit(f"{name}: {len(counted)} planners were counted")
    return 1e-6 * counted[0], float(run.stdout.split()[0])


def price(program, grids):
    finest = max(grids, key=int)
    print("| program |" + "".join(f" grid {g} |" for g in grids))
    for name in LIMITS:
        best = planned(program, name, finest)[1]
        print(f"| {name} |" + "".join(f" {cost / time:.3g}, {100 * (time / best - 1):.2g} % |"
                                      for cost, time in (planned(program, name, g) for g in grids)))


def main(program, *grids):
    callgrind.self_test()
    if grids:
        return price(program, grids)
    broken = 0
    for name, most in LIMITS.items():
        cost, time = planned(program, name)
        broken += cost / time > most
        met = "met" if cost / time <= WANTED else "not met"
        print(f"{'TOO MANY ' if cost / time > most else ''}{name}: {cost / time:.3g} million instructions per second of motion "
              f"({time:.4g} s), at most {most}; {WANTED:g} wanted: {met}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
