#!/usr/bin/python3
"""A day of the comparison scenario at 1 ms steps: nothing drifts. Minutes of CPU time; not part of the tests.
usage: day.py ESMC SCENE [SECONDS]"""
import json
import subprocess
import sys


def run(esmc, scene, seconds):
    done = subprocess.run([esmc, "sim", scene, "--json", "--set", f"simulation.duration={seconds}", "--set", "simulation.step=1e-3"],
                          capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def main():
    esmc, scene = sys.argv[1:3]
    seconds = float(sys.argv[3]) if len(sys.argv) > 3 else 86400.0
    minute, day = run(esmc, scene, 60.0), run(esmc, scene, seconds)
    for name, d in (("a minute", minute), (f"{seconds:g} s", day)):
        print(f"{name}: settled error {d['tracking']['settled_max_rad']:.6g} rad, closure {d['closure']['max_m']:.2g} m, "
              f"energy balance {d['energy']['relative_error']:.2g}, faults {d['supervisor']['faults']}, "
              f"{d['real_time_factor']:.0f} x real time")
    assert day["supervisor"]["faults"] == []
    assert day["tracking"]["settled_max_rad"] < 1.001 * minute["tracking"]["settled_max_rad"], "the error drifts"
    assert day["closure"]["max_m"] < 1e-13, "closure drifts"
    assert day["energy"]["relative_error"] < 1e-5, "the account of the energy drifts"


if __name__ == "__main__":
    main()
