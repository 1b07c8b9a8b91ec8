#!/usr/bin/python3
"""Ctrl-C in the middle of a run: a summary, and drives that have said that they are idle. usage: ESMC SCENE"""
import json
import signal
import subprocess
import sys
import time


def interrupted(esmc, scene, number):
    """The summary of a long run that was stopped after its first tick, however slow the machine is to get there."""
    for patience in (1.5, 5, 20, 60):
        run = subprocess.Popen([esmc, "hil", scene, "--json", "--set", "simulation.duration=100000"], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True)
        time.sleep(patience)
        run.send_signal(number)
        out, err = run.communicate(timeout=120)
        assert run.returncode == 130, (run.returncode, err)
        summary = json.loads(out)
        if summary["ticks"] > 0:
            return summary
    raise AssertionError(f"no tick in {patience} s")


def main():
    esmc, scene = sys.argv[1:3]
    for number in (signal.SIGINT, signal.SIGTERM):
        summary = interrupted(esmc, scene, number)
        assert summary["interrupted"] is True, summary
        assert summary["supervisor"]["final_state"] == "disabled", summary["supervisor"]
        assert summary["supervisor"]["faults"] == [], summary["supervisor"]


if __name__ == "__main__":
    main()
