#!/usr/bin/python3
"""Ctrl-C in the middle of a run: a summary, and drives that have said that they are idle. usage: ESMC SCENE"""
import json
import signal
import subprocess
import sys
import time


def main():
    esmc, scene = sys.argv[1:3]
    for number in (signal.SIGINT, signal.SIGTERM):
        run = subprocess.Popen([esmc, "hil", scene, "--json", "--set", "simulation.duration=900"], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True)
        time.sleep(1.5)
        run.send_signal(number)
        out, err = run.communicate(timeout=60)
        assert run.returncode == 0, (run.returncode, err)
        summary = json.loads(out)
        assert summary["interrupted"] is True and summary["ticks"] > 0, summary
        assert summary["supervisor"]["final_state"] == "disabled", summary["supervisor"]
        assert summary["supervisor"]["faults"] == [], summary["supervisor"]


if __name__ == "__main__":
    main()
