#!/usr/bin/env python3
"""esmc campaign from outside: the contract of its document, the same result whatever the number of threads, replay,
and as many episodes as fit into a test run, without a violation. Usage: campaign_test.py ESMC SCENES EPISODES [--sample COUNT]"""

import json
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import sample  # noqa: E402

SAMPLE = sample.take_option(sys.argv)
ESMC, SCENES, EPISODES = sys.argv[1], pathlib.Path(sys.argv[2]), int(sys.argv[3])
FAULTS = """nothing frame_loss burst_loss scattered_loss duplication delay reordering corruption not_finite denormal huge end_of_range
 wrong_length remote_frame fd_frame extended_frame frozen_sensor sensor_jump sensor_step sensor_flipped swapped_nodes
 drive_error drive_disarm drive_reset drive_silent heartbeat_lost drive_bus_off watchdog_off controller_death
 controller_late controller_bus_off commands_lost torque_lost queue_full babbling_node flood foreign_controller
 emergency_stop enable_open late_power zero_until_closed_loop computer_gone""".split()
PROTOCOLS = ("odrive", "odrive_0.5", "cia402", "mit", "moteus")
PHASES = ["arming", "joining", "running", "halting", "stopping"]
failed = 0


def check(condition, what):
    global failed
    if not condition:
        failed += 1
        print(f"campaign_test: {what}")


def esmc(*arguments, status=0):
    run = subprocess.run([ESMC, *arguments], capture_output=True, text=True, check=False)
    check(run.returncode == status, f"{arguments}: status {run.returncode}, {run.stderr.strip()} {run.stdout[:2000]}")
    return run


def campaign(*arguments):
    return json.loads(esmc("campaign", *arguments, "--json").stdout)


def main_run():
    j = campaign("--episodes", str(EPISODES))
    check(j["episodes"] == EPISODES and j["violations"] == [] and not j["interrupted"], "episodes and violations")
    r = j["reaction_ms"]
    check(0 < r["stale_max"] <= 2.0 + 1e-9, f"stale feedback noticed in {r['stale_max']} ms")
    check(r["stale_max"] < r["safe_max"] <= 3.0, f"safe torque in {r['safe_max']} ms")
    check(9.0 < r["host_death_max"] <= 12.0, f"host death: {r['host_death_max']} ms")
    check(j["simulated_s"] > 0.05 * EPISODES, "simulated time")
    check(sorted(j["faults"]) == sorted(FAULTS), "every fault occurs, and no other")
    check(sum(f["episodes"] for f in j["faults"].values()) == EPISODES, "the faults' counts add up")
    phases = [sum(f["phases"][p] for f in j["faults"].values()) for p in PHASES]
    check(sum(phases) == EPISODES and min(phases) > EPISODES / 20, f"phases {phases}")
    check(sum(j["protocols"].values()) == EPISODES and min(j["protocols"][p] for p in PROTOCOLS) > EPISODES / 20, f"protocols {j['protocols']}")
    for name, f in j["faults"].items():
        check(sum(f["drives"]) == f["episodes"] and min(f["drives"][:2]) > f["episodes"] / 4, f"{name}: drives {f['drives']}")
        check(sum(f["latched"].values()) == f["episodes"], f"{name}: names add up")
    for name in ("stale", "safe", "host_death"):
        bins = j["histograms"][name]
        top = {"stale": "stale_max", "safe": "safe_max", "host_death": "host_death_max"}[name]
        check(sum(b["count"] for b in bins) > EPISODES / 200 and bins[-1]["up_to_ms"] >= r[top] - 1e-9, f"histogram {name}")
    for fault, name in (("not_finite", "feedback_not_finite"), ("torque_lost", "torque_mismatch")):
        check(j["faults"][fault]["latched"].get(name, 0) > EPISODES / 400, f"{fault} is seldom latched as {name}")


def threads():
    one, three = (campaign("--episodes", "1000", "--seed", "77", "--jobs", n) for n in ("1", "3"))
    check(one == three, "the result depends on --jobs")


def seeds_and_protocols():
    one, other = (campaign("--episodes", "1000", "--seed", n) for n in ("77", "78"))
    check(one["digest"] != other["digest"], "the result does not depend on --seed")
    digests = {p: campaign("--episodes", "300", "--protocol", p) for p in PROTOCOLS}
    check(all(j["violations"] == [] for j in digests.values()), "one protocol alone")
    check(len({j["digest"] for j in digests.values()}) >= 3, "protocols differ")


def watchdogs_are_read_back():
    j = campaign("--episodes", "3000", "--protocol", "odrive")  # every other variant of its drives reads them back
    off = j["faults"]["watchdog_off"]["latched"]
    check(j["violations"] == [] and off["drive_configuration"] > off["none"] / 4, f"a watchdog that is off: {off}")


def scenes_of_ones_own():
    for scene in ("rr_line.toml", "five_bar_circle.toml"):
        j = campaign(str(SCENES / scene), "--set", "simulation.step=1e-3", "--episodes", "300")
        check(j["violations"] == [], f"{scene}: {j['violations'][:3]}")


def other_times(protocols):
    """What is demanded follows from the scene: the watchdogs of a slow loop are slow, and no fault of the controller."""
    scene = str(SCENES / "five_bar_circle.toml")
    for protocol in protocols:
        for sets in (["control.rate_hz=100"], ["control.rate_hz=333", "limits.max_age_ticks=5"], ["control.rate_hz=5000"],
                     ["drives.watchdog_timeout=0.05", "limits.feedback_jump=0"], ["drives.heartbeat_timeout=0.1"]):
            options = [o for s in sets for o in ("--set", s)]
            j = campaign(scene, "--protocol", protocol, "--episodes", "250", *options)
            check(j["violations"] == [], f"{protocol}, {sets}: {j['violations'][:3]}")


def other_times_odrive():
    other_times(PROTOCOLS[:2])


def other_times_of_torque_modes():
    other_times(PROTOCOLS[2:])


def slow_loop():
    scene = str(SCENES / "five_bar_circle.toml")
    slow = campaign(scene, "--set", "control.rate_hz=100", "--episodes", "250")["reaction_ms"]
    check(30.0 < slow["host_death_max"] <= 50.0, f"host death at 100 Hz: {slow['host_death_max']} ms")
    check(slow["stale_max"] <= 20.0 + 1e-9 and slow["safe_max"] <= 21.0, f"stale feedback at 100 Hz: {slow}")


def four_motors():
    """Sensors of the base only: a distal drive that vanishes takes no sample away that anybody needs."""
    for protocol in PROTOCOLS:
        j = campaign(str(SCENES / "five_bar_circle.toml"), "--protocol", protocol, "--episodes", "500", "--set",
                     'control.motors="all"', "--set", "drives.nodes=[1, 2, 3, 4]")
        check(j["violations"] == [], f"four motors, {protocol}: {j['violations'][:3]}")


def what_no_campaign_can_judge():
    scene = str(SCENES / "five_bar_circle.toml")
    with tempfile.TemporaryDirectory() as d:
        disturbed = pathlib.Path(d) / "disturbed.toml"
        disturbed.write_text(pathlib.Path(scene).read_text() + '\n[[effects]]\ntype = "bit_timing"\n'
                             '[[effects]]\ntype = "loss"\nprobability = 0.9\n')
        run = esmc("campaign", str(disturbed), status=2)
        check(run.stdout == "" and run.stderr.count("\n") == 1 and "'bit_timing'" in run.stderr
              and "campaign" in run.stderr, f"effects of the bus: {run.stderr!r}")
    # A beat of the drives is 10 ms: this loop ends without anybody doing anything to it.
    run = esmc("campaign", scene, "--set", "drives.heartbeat_timeout=0.005", status=1)
    check(run.stdout == "" and run.stderr.count("\n") == 1 and "heartbeat_lost" in run.stderr, f"{run.stderr!r}")


def replay():
    runs = [campaign("--replay", str(2**64 - 1)) for _ in range(2)]
    check(runs[0] == runs[1] and runs[0]["bit_equal"] and runs[0]["seed"] == 2**64 - 1, "replay")
    text = esmc("campaign", "--replay", "5").stdout
    check("bit-equal" in text and text.count("\n") > 30, "replay prints its ticks")
    with tempfile.TemporaryDirectory() as d:
        esmc("campaign", "--replay", "5", "--out", d + "/r")
        lines = (pathlib.Path(d) / "r/episode.txt").read_text().splitlines()
        check(len(lines) == json.loads((pathlib.Path(d) / "r/episode.json").read_text())["ticks"], "a line per tick")


def violations_are_told():
    # Drives as delivered: their watchdog is off, and they push against a speed that they find too high.
    off = ["--episodes", "400", "--protocol", "odrive", "--set", "drives.confirmed=false"]
    # Where they say their torque, what they do not give is noticed.
    run = esmc("campaign", *off, status=1)
    check("torque_mismatch before anything is done to the loop" in run.stderr, run.stderr)
    off += ["--set", "drives.torque_mismatch=0"]
    with tempfile.TemporaryDirectory() as d:
        run = esmc("campaign", *off, "--json", "--out", d + "/c", status=1)
        j = json.loads(run.stdout)
        check(len(j["violations"]) > 3, "a watchdog that is off is no violation")
        names = [v["invariant"] for v in j["violations"]]
        check(names.count("watchdog") > 0.8 * len(names) and set(names) <= {"watchdog", "safe_time", "torque_without_power", "torque_limit"},
              f"{names}")
        check(json.loads((pathlib.Path(d) / "c/campaign.json").read_text()) == j, "campaign.json")
        check("controller_death" in (pathlib.Path(d) / "c/campaign.md").read_text(), "campaign.md")
    first = j["violations"][0]
    again = json.loads(esmc("campaign", *off[2:], "--replay", str(first["seed"]), "--json", status=1).stdout)
    check(again["digest"] == first["digest"] and again["violation_tick"] == first["tick"]
          and again["invariant"] == first["invariant"] and again["fault"] == first["fault"], "replay of a violation")
    text = esmc("campaign", *off, status=1).stdout
    check(f"--replay {first['seed']}" in text, "the text tells how to replay")


def bad_input():
    for arguments in (["--episodes", "-1"], ["--episodes", "many"], ["--jobs", "0"], ["--replay", "x"], ["--seed", "1.5"],
                      ["--protocol", "canopen"], ["no_such.toml"], ["--set", "control.law=\"open_loop\""], ["--fast"]):
        run = esmc("campaign", *arguments, status=2)
        check(run.stdout == "" and run.stderr.startswith("esmc: ") and run.stderr.count("\n") == 1,
              f"{arguments}: {run.stderr!r}")


PARTS = (main_run, threads, seeds_and_protocols, watchdogs_are_read_back, scenes_of_ones_own, other_times_odrive,
         other_times_of_torque_modes, slow_loop, four_motors, what_no_campaign_can_judge, replay, violations_are_told, bad_input)
for part in sample.drawn(PARTS, SAMPLE, lambda p: p.__name__):
    part()
print("campaign_test: " + ("passed" if failed == 0 else f"{failed} checks failed"))
sys.exit(1 if failed else 0)
