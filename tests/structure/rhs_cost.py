#!/usr/bin/env python3
"""An effect that a scene does not name costs nothing: a program that contains all effects and one that contains none take
the same right-hand sides, instruction for instruction, and end in the same state to the last bit.
usage: rhs_cost.py WITH WITHOUT"""
import re
import subprocess
import sys
import tempfile


STEPS = 1000


def run(program, steps):
    """Instructions of the whole program, and the state at the end."""
    with tempfile.TemporaryDirectory() as folder:
        out = f"--callgrind-out-file={folder}/out"
        done = subprocess.run(["valgrind", "--tool=callgrind", out, program, str(steps)], capture_output=True, text=True, check=True)
        return int(re.search(r"Collected : (\d+)", done.stderr)[1]), done.stdout


def main():
    per_step, states = [], []
    for program in sys.argv[1:3]:
        (short, _), (long, state) = run(program, STEPS), run(program, 3 * STEPS)
        per_step.append((long - short) / (2 * STEPS))
        states.append(state)
    print(f"instructions per RK4 step: {per_step[0]:.1f} with all effects linked, {per_step[1]:.1f} without any")
    assert per_step[0] > 1000, "nothing was counted"
    # The projection takes a second round now and then; what surrounds the steps is the same for both lengths.
    assert abs(per_step[0] - per_step[1]) < 1.0, "an effect that is not named has a cost"
    assert states[0] == states[1], f"states differ: {states}"


if __name__ == "__main__":
    main()
