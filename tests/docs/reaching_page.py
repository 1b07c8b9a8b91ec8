#!/usr/bin/python3
"""The tables of docs/reaching.md: error and torque activity of laws and optional parts in four environments, and their instructions per tick. Python's
standard library; valgrind for the instructions.

usage: reaching_page.py ESMC             makes all runs and writes the tables
       reaching_page.py ESMC --check     makes a few of the runs and of the counts again; they must be what the page shows"""
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import page

ROOT = Path(__file__).resolve().parents[2]
PAGE, SCENE = ROOT / "docs/reaching.md", ROOT / "host_sim/scenes/five_bar_super_twisting.toml"
TOLERANCE = 0.006
FRICTION = '{type="viscous_friction",coefficient=[0.01,0.002]}'
DELAY = '{type="compute_delay",time=0.002}'
ENCODER = '{type="encoder",bits=16}'
WORLDS = {  # effects, control.delay_ticks, control.sensor_lag_ticks
    "masses": ([], 0, 0),
    "friction": ([FRICTION], 0, 0),
    "delay": ([FRICTION, DELAY], 2, 0),
    "encoders": ([FRICTION, DELAY, ENCODER], 2, 2),
}
LAWS = ("implicit", "implicit_coupled", "super_twisting")
PARTS = {"none": [], "observer": ["control.disturbance_observer=100.0"], "predictor": ["control.predictor=true"],
         "both": ["control.disturbance_observer=100.0", "control.predictor=true"]}
TICKS = 200  # counted


def options(world, law, part):
    effects, delay, lag = WORLDS[world]
    return [f"control.reaching={law}", f"control.delay_ticks={delay}", f"control.sensor_lag_ticks={lag}",
            f"effects=[{','.join(effects)}]", *PARTS[part]]


def cell(summary):
    """Settled error, and mean change of torque per tick."""
    if summary["supervisor"]["faults"]:
        return "fault"
    return f"{summary['tracking']['settled_rms_m'] * 1e6:.3g} um, {summary['torque']['mean_abs_delta_nm'] * 1e3:.3g} mN m"


def run(esmc, world, law, part, *more):
    return cell(page.run(esmc, "sim", SCENE, *options(world, law, part), *more))


def instructions(esmc, law, part):
    """Of Controller::tick with all it calls, mean over TICKS, double, counted by callgrind."""
    with tempfile.TemporaryDirectory() as folder:
        out = f"{folder}/calls"
        subprocess.run(["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", "--collect-atstart=no",
                        "--toggle-collect=esmc::Controller<esmc::FiveBar<double> >::tick*", esmc, "sim", SCENE, "--json",
                        *(w for s in (*options("delay", law, part), f"simulation.duration={TICKS / 1000}") for w in ("--set", s))],
                       capture_output=True, text=True, check=True)
        total = int(re.search(r"^(?:summary|totals): (\d+)", Path(out).read_text(encoding="utf-8"), re.M)[1])
    return total / TICKS


def cases(world):
    return [(world, law, part) for law in LAWS for part in PARTS if part in ("none", "observer") or WORLDS[world][1]]


def table(esmc):
    lines = ["| law | part | " + " | ".join(f"{w}" for w in WORLDS) + " | instructions |", "|---|---|" + "---|" * (len(WORLDS) + 1)]
    found = {case: run(esmc, *case) for world in WORLDS for case in cases(world)}
    for law in LAWS:
        for part in PARTS:
            shown = [found.get((world, law, part), "") for world in WORLDS]
            lines.append(f"| `{law}` | {part} | " + " | ".join(shown) + f" | {instructions(esmc, law, part):.0f} |")
    return "\n".join(lines) + "\n"


def lambda_table(esmc):
    values = (40.0, 100.0, 200.0, 300.0, 600.0, 900.0)
    lines = ["| part | lambda = " + " | ".join(f"{v:g}" for v in values) + " |", "|---|" + "---|" * len(values)]
    for part in PARTS:
        lines.append(f"| {part} | " + " | ".join(run(esmc, "delay", "implicit", part, f"control.lambda={v}") for v in values) + " |")
    return "\n".join(lines) + "\n"


def gain_table(esmc):
    """What L too large and too small does to the super-twisting law."""
    values = (15.0, 150.0, 1500.0, 15000.0)
    lines = ["| environment | L = " + " | ".join(f"{v:g}" for v in values) + " |", "|---|" + "---|" * len(values)]
    for world in ("friction", "delay"):
        lines.append(f"| {world} | " + " | ".join(run(esmc, world, "super_twisting", "none", f"control.gain={v}") for v in values) + " |")
    return "\n".join(lines) + "\n"


def coupled_table(esmc):
    """The clamp and the coupled step with gains that agree and that do not, on the scene of the coupled step."""
    scene = ROOT / "host_sim/scenes/five_bar_coupled.toml"
    lines = ["| gain of positions, of angles | `implicit` | `implicit_coupled` |", "|---|---|---|"]
    for gain in ("{position=150.0,angle=150.0}", "{position=4.0,angle=150.0}", "{position=15.0,angle=15.0}", "{position=4.0,angle=4.0}"):
        cells = [cell(page.run(esmc, "sim", scene, f"control.reaching={law}", f"control.gain={gain}")) for law in ("implicit", "implicit_coupled")]
        lines.append(f"| {', '.join(re.findall(r'[0-9.]+', gain))} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def numbers(text):
    return [float(x) for x in re.findall(r"\d+\.?\d*(?:e[-+]?\d+)?", text)]


def check(esmc):
    shown = {}
    for line in page.part(PAGE, "parts").splitlines()[2:]:
        fields = [f.strip() for f in line.strip("|").split("|")]
        for world, text in zip(WORLDS, fields[2:]):
            shown[world, fields[0].strip("`"), fields[1]] = text
        shown[fields[0].strip("`"), fields[1]] = float(fields[-1])
    wrong = []
    for law, part in (("implicit", "none"), ("implicit_coupled", "observer"), ("super_twisting", "both")):
        now = instructions(esmc, law, part)
        if abs(now - shown[law, part]) > TOLERANCE * now:
            wrong.append(f"{law} {part}: {now:.0f} instructions, the page has {shown[law, part]:.0f}")
    for case in (("friction", "implicit", "none"), ("friction", "implicit", "observer"), ("delay", "super_twisting", "none"),
                 ("delay", "implicit_coupled", "both"), ("encoders", "implicit", "predictor")):
        now = run(esmc, *case)
        a, b = numbers(now), numbers(shown[case])
        if len(a) != len(b) or any(abs(x - y) > TOLERANCE * max(x, y) for x, y in zip(a, b)):
            wrong.append(f"{' '.join(case)}: {now}, the page has {shown[case]}")
    print("\n".join(wrong) or "5 runs, 3 counts")
    return 1 if wrong else 0


def main(esmc):
    if "--check" in sys.argv:
        return check(esmc)
    page.put(PAGE, {"coupled": coupled_table(esmc), "parts": table(esmc), "lambda": lambda_table(esmc), "gain": gain_table(esmc)})
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
