#!/usr/bin/env python3
"""The gain margin of `esmc margins` against the gain at which `esmc sim` begins to ring. usage: margins.py ESMC [COUNT [SEED]]

A pose at rest without gravity, reached from an offset far inside the layer. The loop gain is scaled by what believes or asks for torque: all masses and
inertias of control.model; with pd kp and kd. It rings where the joints are faster in the last 0.3 s than the disturbance of the start."""
import json
import random
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "cli"))
from command import ARM, CIRCLE, MORE, esmc, read_table, sets  # noqa: E402

DISTURBANCE = 1e-5  # rad/s
LAWS = ("esmc", "esmc_projected", "smc", "esmc saturation", "esmc tanh", "ctc", "pd", "esmc observer", "ctc observer", "esmc super_twisting", "esmc predictor")


def draw(seed):
    r = random.Random(seed)
    law, rr = LAWS[seed % len(LAWS)], r.random() < 0.4
    name, *more = law.split()
    s = ["mechanism.gravity=0", f"control.law={name}", "control.torque_limit=1000", "simulation.step=1e-4", f"control.lambda={10 ** r.uniform(1.2, 2.2):.3g}",
         "limits.joint_speed=1000"]
    if rr:
        joints = [r.uniform(-1, 1), r.uniform(0.5, 2)]
    else:
        joints = [r.uniform(0.7, 1.1), r.uniform(0.7, 1.1)]
    effects, told = [], 0
    late = r.choice(("none", "delay", "fraction", "lag", "gear", "observer"))
    if late == "delay" or more == ["predictor"]:
        told = r.randint(1, 2)
        effects.append(f'{{type="compute_delay", time={told * 1e-3}}}')
    elif late == "fraction":
        effects.append(f'{{type="compute_delay", time={r.uniform(2e-4, 1.8e-3):.4g}}}')
    elif late == "lag":
        effects.append(f'{{type="torque_lag", time_constant={10 ** r.uniform(-3.5, -2.7):.3g}}}')
    elif late == "gear":
        stiffness = 10 ** r.uniform(2.5, 3.5) * (10 if rr else 1)
        effects.append(f'{{type="joint_flexibility", stiffness={stiffness:.4g}, damping={0.02 * stiffness ** 0.5:.3g}, rotor_inertia={1e-3 if rr else 1e-4}}}')
    elif late == "observer":
        effects.append(f'{{type="noise", sigma=0.0, bandwidth={r.uniform(600, 3000):.4g}}}')
    s.append("effects=[" + ", ".join(effects) + "]")
    if name not in ("ctc", "pd"):
        s.append(f"control.gain={r.uniform(20, 80):.3g}")
        s.append("control.delay_ticks=%d" % (told if more == ["predictor"] else r.randint(told, 3)))
    if more in (["saturation"], ["tanh"]):
        s += [f"control.reaching={more[0]}", f"control.layer={r.uniform(0.2, 1):.3g}"]
    if more == ["super_twisting"]:
        s += ["control.reaching=super_twisting", "control.gain=500"]
    if more == ["observer"]:
        s.append(f"control.disturbance_observer={r.uniform(10, 60):.3g}")
    if more == ["predictor"]:
        s.append("control.predictor=true")
    gains = (10 ** r.uniform(0, 1) * (10 if rr else 1), 10 ** r.uniform(-1.5, -1) * (10 if rr else 1))
    return law, rr, late, joints, s, (gains if name == "pd" else None)


def scaled(gain, pd, rr):
    if pd:
        return [f"control.kp={pd[0] * gain}", f"control.kd={pd[1] * gain}"]
    return ["control.model={" + ", ".join(f"{k}={gain}" for k in ("m1", "m2", "J1", "J2") + (() if rr else ("effector_mass",))) + "}"]


def rings(scene, values, joints, pd, rr, gain, folder):
    held = ["reference={type='hold'}", "initial={joints=[%r, %r], joint_rates=[%r, %r]}" % (*joints, DISTURBANCE, -DISTURBANCE), "simulation.duration=1.2"]
    run = esmc("sim", scene, "--json", "--out", folder, *sets(*values, *held, *scaled(gain, pd, rr)))
    assert run.stdout, (values, run.stderr)
    if json.loads(run.stdout)["supervisor"]["faults"]:
        return True
    rows = read_table(Path(folder, "log.csv"))
    speeds = [c for c in rows[0] if c in ("theta11_rate", "theta21_rate", "theta1_rate", "theta2_rate")]
    assert len(speeds) == 2, list(rows[0])
    size = [max(abs(float(row[c])) for c in speeds) for row in rows]
    return max(size[len(size) * 3 // 4:]) > DISTURBANCE


def judge(seed):
    law, rr, late, joints, values, pd = draw(seed)
    scene = ARM if rr else CIRCLE
    hold = ["reference={type='hold'}", "initial={joints=[%r, %r]}" % tuple(joints)]
    said = esmc("margins", scene, "--json", *sets(*values, *hold, *scaled(1.0, pd, rr)))
    if not said.stdout:
        return seed, law, rr, late, None, said.stderr.strip()
    m = json.loads(said.stdout)["worst"]
    if not m["stable"] or m["gain_margin"] is None or m["gain_margin"] > 100:
        return seed, law, rr, late, None, f"margin {m['gain_margin']}, stable {m['stable']}"
    with tempfile.TemporaryDirectory() as folder:
        low, high = max(1.0, m["gain_margin"] / 1.5), m["gain_margin"] * 1.5
        if rings(scene, values, joints, pd, rr, low, folder) or not rings(scene, values, joints, pd, rr, high, folder):
            return seed, law, rr, late, (m["gain_margin"], float("nan")), str(values)
        while high / low > 1.01:
            middle = (low * high) ** 0.5
            low, high = (low, middle) if rings(scene, values, joints, pd, rr, middle, folder) else (middle, high)
    return seed, law, rr, late, (m["gain_margin"], (low * high) ** 0.5), str(values)


def main():
    count, first = (int(x) for x in (MORE + ["11", "1"][len(MORE):]))
    with ThreadPoolExecutor(2) as pool:
        all_ = list(pool.map(judge, range(first, first + count)))
    judged = wrong = 0
    for seed, law, rr, late, both, text in all_:
        if both is None:
            print(f"seed {seed}: {law}, {late}: not judged: {text}")
            continue
        judged += 1
        bad = not abs(both[0] / both[1] - 1.0) < 0.05
        wrong += bad
        print(f"seed {seed}: {law}, {'RR' if rr else '5R'}, {late}: margin {both[0]:.4g}, sim rings from {both[1]:.4g}{'  WRONG ' + text if bad else ''}")
    print(f"{count} drawn, {judged} judged, {wrong} more than 5 % off")
    return 0 if wrong == 0 and judged >= 0.6 * count else 1


if __name__ == "__main__":
    sys.exit(main())
