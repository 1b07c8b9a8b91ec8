"""What the tests over a real vcan0 share: a job runs beside it, and its runs are compared with one on the virtual bus."""
import json
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
SKIPPED = 77
# A stall of the machine can end a run by wall clock in many ways (old samples, a joint that ran away meanwhile); it
# cannot make these.
NOT_BY_STALLING = {"malformed_frame", "feedback_not_finite", "torque_not_finite", "bus_off", "loop_not_closed"}


def inside(*words, timeout=300, **environment):
    """Output of a job inside with_vcan that succeeds. Where there is no vcan the test ends here as skipped."""
    job = subprocess.run([HERE / "with_vcan", "--timeout", str(timeout), "--", *words], capture_output=True, text=True,
                         env={**os.environ, **environment})
    if job.returncode == SKIPPED:
        print(job.stdout.strip())
        sys.exit(SKIPPED)
    assert job.returncode == 0, f"{job.returncode}: {job.stdout} {job.stderr}"
    return job.stdout


def hil(esmc, scene, *more):
    """Summary of a run on the virtual bus."""
    run = subprocess.run([esmc, "hil", scene, "--json", *more], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def same(got, want, name):
    for key in ("digest", "final_state", "ticks"):
        assert got[key] == want[key], f"{name}: {key} is {got[key]}, on the virtual bus {want[key]}"


def same_runs(out, names, want):
    for name in names:
        same(json.loads((out / name / "summary.json").read_text()), want, name)
    assert json.loads((out / "controller" / "summary.json").read_text())["supervisor"]["faults"] == []


def against_the_clock(out, *more_not_by_stalling):
    run = json.loads((out / "realtime.json").read_text())
    faults = {f["name"] for f in run["supervisor"]["faults"]}
    print("realtime:", run["ticks"], "ticks, faults:", sorted(faults))
    assert run["late_ticks"] >= 0  # how many is the machine's business
    assert run["ticks"] == 50 and not faults & NOT_BY_STALLING.union(more_not_by_stalling), run["supervisor"]
