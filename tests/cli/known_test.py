#!/usr/bin/python3
"""What a controller may know beside lengths and masses: rotors behind the gears of base and elbow motors, and dry friction that depends on the direction.
The plant against mass matrices that are written down here, in joint coordinates or by numerical derivatives of positions; the controller against the
error that an ideal loop has. usage: known_test.py ESMC"""
import cmath
import json
import math
import tomllib

from command import ARM, FRICTION, read_table, sets
from identify_test import ARM_LEG, NOMINAL, ONE, effects, standard, true_values_of
from log_bench import LogBench, expect, main, write_table


def rotors(bench):
    """A rotor behind the gear of a base joint: the plant's acceleration from rest by the mass matrix written down here, what the
    controller knows of it, and what identify and calibrate make of it."""
    rotor, torque, step = 0.05, 0.3, 1e-3
    s, angle = standard(ARM_LEG), 1.2
    couple = s["h"] * ARM_LEG["l1"] * math.cos(angle)
    a, b, c = s["a"] + rotor + s["c"] + 2 * couple, s["c"] + couple, s["c"]
    want = [torque * c / (a * c - b * b) * step, -torque * b / (a * c - b * b) * step]
    rates = rates_after(bench, ARM, step, (torque, 0.0), f"initial={{joints=[0.4, {angle}]}}", f"mechanism.rotor_inertia=[{rotor}, 0]")
    expect(rates and all(abs(r - w) < 1e-3 * abs(w) for r, w in zip(rates, want, strict=True)), f"rates after {step} s: {rates}, {want} by hand")

    base, rub = NOMINAL, effects([0.01, 0.002] * 2, [0.02, 0.004] * 2)
    turning = ["--set", "mechanism.rotor_inertia=[2e-3, 1e-3]"]
    told = [bench.settled(base, "effects=[]", "control.delay_ticks=0", turning[1], f"control.model={{J1={share}}}") for share in (1.0, 0.3)]
    expect(told[0] < 0.5 * told[1], f"a controller that knows the rotor: {told[0]} m, one that does not: {told[1]} m")
    out, _ = bench.record("turning", "sim", base, "--set", rub, *turning)
    found = bench.good(out)
    truth = true_values_of(ONE, ONE) | {"m0": 0.0}
    truth["a1"] += 2e-3
    truth["a2"] += 1e-3
    for p in (p for p in found["parameters"] if p["inertial"]):
        value = sum(share * truth[k] for k, share in p["share"].items())
        expect(p["lower"] <= value <= p["upper"] and abs(p["nominal"] - value) < 1e-7, f"{p['name']}: {p['lower']} to {p['upper']}, true {value}")
    sweep = bench.folder / "rotor_sweep.toml"
    sweep.write_text(f'scene = "{base}"\nset = ["mechanism.rotor_inertia=[2e-3, 1e-3]", "simulation.duration=0.3"]\n'
                     '[sample]\nmethod = "grid"\n[[vary]]\nkey = "mechanism.leg.J1"\nvalues = [1e-4, 4e-4]\n', encoding="utf-8")
    run = bench.run("sweep", sweep, "--out", bench.folder / "rotor_sweep")
    swept = [r["settled_rms_m"] for r in read_table(bench.folder / "rotor_sweep" / "cases.csv")] if run.returncode == 0 else []
    alone = [bench.settled(base, turning[1], "simulation.duration=0.3", f"mechanism.leg.J1={j}") for j in (1e-4, 4e-4)]
    expect([float(x) for x in swept] == alone, f"a sweep of J1 beside a rotor: {swept}, one by one {alone}: {run.stderr}")


def rates_after(bench, scene, step, torque, initial, *values):
    """Rates of final_state.qd after a short step from rest under constant torques, without gravity."""
    values = [*values, "mechanism.gravity=0.0", "effects=[]", "control.law=open_loop", initial, f"simulation.duration={step}", "simulation.step=1e-5",
            "control.torque=[" + ", ".join(f"{{offset={t}}}" for t in torque) + "]"]
    run = bench.run("sim", scene, "--json", *sets(*values))
    expect(run.returncode == 0, f"{values}: {run.stderr}")
    return json.loads(run.stdout)["final_state"]["qd"] if run.returncode == 0 else None


def five_bar_mass(theta, rotors, leg=ONE, l0=0.05):
    """M of T = w^T M w / 2 in the rates w of the base joints: positions of mass centres and angles, differentiated numerically; and the rates of all joints."""
    def points(base):
        elbow = l0 + cmath.rect(leg["l1"], base[0]), -l0 - cmath.rect(leg["l1"], -base[1])
        across = elbow[0] - elbow[1]
        d = abs(across)
        tip = max((elbow[1] + across / d * complex(d / 2, s * math.sqrt(leg["l2"] ** 2 - d * d / 4)) for s in (1, -1)), key=lambda z: z.imag)
        outer = cmath.phase(tip - elbow[0]), cmath.phase(-(tip - elbow[1]).conjugate())
        centre = [l0 + cmath.rect(leg["lg1"], base[0]), elbow[0] + (tip - elbow[0]) * leg["lg2"] / leg["l2"],
                  -l0 - cmath.rect(leg["lg1"], -base[1]), elbow[1] + (tip - elbow[1]) * leg["lg2"] / leg["l2"]]
        return centre, [base[0], outer[0], base[1], outer[1]], [base[0], outer[0] - base[0], base[1], outer[1] - base[1]]
    h, columns = 1e-6, []
    for k in (0, 1):
        up, down = (points([t + s * h * (i == k) for i, t in enumerate(theta)]) for s in (1, -1))
        columns.append([[(a - b) / (2 * h) for a, b in zip(x, y, strict=True)] for x, y in zip(up, down, strict=True)])
    m, J = [leg["m1"], leg["m2"]] * 2, [leg["J1"], leg["J2"]] * 2
    M = [[sum(m[i] * (a[0][i] * b[0][i].conjugate()).real + J[i] * a[1][i] * b[1][i] + rotors[i] * a[2][i] * b[2][i] for i in range(4)) for b in columns]
         for a in columns]
    return M, [c[2] for c in columns]


def elbow_plant(bench):
    arm, five, step = ARM, NOMINAL, 1e-3
    s, angle, rotor = standard(ARM_LEG), 1.2, (0.03, 0.05)
    couple = s["h"] * ARM_LEG["l1"] * math.cos(angle)
    a, b, c = s["a"] + s["c"] + 2 * couple + rotor[0], s["c"] + couple, s["c"] + rotor[1]
    for torque in ((0.3, 0.0), (0.0, 0.2)):
        want = [(torque[0] * c - torque[1] * b) / (a * c - b * b) * step, (torque[1] * a - torque[0] * b) / (a * c - b * b) * step]
        got = rates_after(bench, arm, step, torque, f"initial={{joints=[0.4, {angle}]}}", f"mechanism.rotor_inertia={list(rotor)}")
        expect(got and all(abs(g - w) < 1e-3 * abs(w) for g, w in zip(got, want, strict=True)), f"arm: {got}, by hand {want}")
    theta, rotors = (0.9, 1.1), (1e-3, 8e-4, 5e-4, 1.2e-3)
    M, rates = five_bar_mass(theta, rotors)
    det = M[0][0] * M[1][1] - M[0][1] ** 2
    for torque in ((0.05, 0.0, 0.0, 0.0), (0.0, 0.04, 0.0, 0.0), (0.0, 0.0, 0.0, -0.04)):
        F = [sum(t * r for t, r in zip(torque, rates[k], strict=True)) for k in (0, 1)]
        base = [(F[0] * M[1][1] - F[1] * M[0][1]) / det, (F[1] * M[0][0] - F[0] * M[0][1]) / det]
        want = [step * sum(base[k] * rates[k][i] for k in (0, 1)) for i in range(4)]
        got = rates_after(bench, five, step, torque, f"initial={{joints={list(theta)}}}", f"mechanism.rotor_inertia={list(rotors)}", "control.motors=all")
        expect(got and all(abs(g - w) < 3e-3 * max(map(abs, want)) for g, w in zip(got[2:], want, strict=True)), f"five-bar: {got}, by energy {want}")


def elbow_controller(bench):
    """An ideal loop tracks as well with rotors as without, where the controller knows them; the share that it does not know makes it worse."""
    arm, five = ARM, NOMINAL
    own = 'control.model.mechanism={type="rr", gravity=9.8, working_mode=["+"], leg={' + ", ".join(f"{k}={v}" for k, v in ARM_LEG.items()) + "}}"
    sine = ['reference={type="joint_sine", offset=[0.3, 1.5], amplitude=[0.5, 0.7], omega=[5.3, 8.9], join=0.3}', "effects=[]", "simulation.duration=1.5"]
    cases = [("arm", arm, [*sine, "mechanism.rotor_inertia=[0.02, 0.03]"], own),
             ("five-bar", five, ["control.motors=all", "effects=[]", "control.delay_ticks=0", "simulation.duration=1.5", "mechanism.rotor_inertia=[1e-4, 5e-4, 1e-4, 5e-4]"],
              'control.model.mechanism={type="five_bar", half_base=0.05, gravity=9.8, working_mode=["+", "+"], leg={' +
              ", ".join(f"{k}={v}" for k, v in ONE.items()) + "}}")]
    for name, scene, values, untold in cases:
        for law in (["control.law=esmc"], ["control.law=esmc_projected"], ["control.law=smc"], ["control.law=ctc"],
                    ["control.reaching=super_twisting", "control.gain=500"], ["control.reaching=implicit_coupled"], ["control.disturbance_observer=40"],
                    ["control.predictor=true", "control.delay_ticks=2", values[-1]]):
            late = ["effects=[{type=\"compute_delay\", time=2e-3}]"] if "control.predictor=true" in law else []
            without = bench.settled(scene, *values[:-1], "mechanism.rotor_inertia=[0, 0]", *law, *late)
            told, not_told = bench.settled(scene, *values, *law, *late), bench.settled(scene, *values, *law, *late, untold)
            expect(told < 1.5 * without + 2e-6, f"{name} {law}: {told} m with a rotor that is known, {without} without one")
            expect(told < 0.7 * not_told, f"{name} {law}: {told} m with a rotor that is known, {not_told} with one that is not")
    margins = json.loads(bench.run("check", arm, "--json", "--set", "mechanism.rotor_inertia=[0, 0.5]").stdout)["margins"]
    plain = json.loads(bench.run("check", arm, "--json").stdout)["margins"]
    expect(margins != plain, "check knows nothing of the elbow's rotor")
    refused = bench.run("design", arm, "--json", "--set", "mechanism.rotor_inertia=[0, 0.1]", "--set", "uncertainty={m1=[0.9, 1.1]}")
    expect("rotor of an elbow" in json.loads(refused.stdout)["refused"], f"design: {refused.stdout[:300]}")
    mjcf = bench.run("export", arm, "--format", "mjcf", "--set", "mechanism.rotor_inertia=[0.1, 0.02]")
    expect(mjcf.stdout.count('armature="0.02"') == 1, f"export: {mjcf.stdout[:2000]}{mjcf.stderr}")
    for what, values in (("needs J1 and J2 above 0", ["mechanism.rotor_inertia=[0, 0.1]", "mechanism.leg.J2=0"]),
                       ("'control.model' needs J1 and J2 above 0", ["mechanism.rotor_inertia=[0, 0.1]", "control.model.J1=0"]),
                       ("must be 2 or 4 numbers", ["mechanism.rotor_inertia=[0, 0.1, 0]"])):
        bench.refused(bench.run("sim", five if "2 or 4" in what else arm, *sets(*values)), what)


def elbow_identified(bench):
    """A rotor missing from the scene is named, written, and then known."""
    arm = ARM
    leg = ", ".join(f"{k} = {v}" for k, v in ARM_LEG.items())
    text = arm.read_text(encoding="utf-8").replace("[control]\n", f'[control]\nmodel = {{ mechanism = {{ type = "rr", gravity = 9.8, working_mode = ["+"], leg = {{ {leg} }} }} }}\n')
    text = text.replace('type = "rr"\n', 'type = "rr"\nrotor_inertia = [0.0, 0.02]\n')
    scene, file = bench.folder / "untold.toml", bench.folder / "told.toml"
    scene.write_text(text, encoding="utf-8")
    values = [effects([0.1, 0.05], [0.2, 0.1])[:-1].replace("coulomb_friction\", ", 'coulomb_friction", asymmetry=[0.05, 0.0], ') + "]", "control.delay_ticks=3",
            "simulation.duration=4.0", 'reference={type="joint_sine", offset=[0.3, 1.5], amplitude=[0.5, 0.7], omega=[5.3, 8.9], join=0.3}']
    out, _ = bench.record("untold", "sim", scene, *sets(*values))
    found = bench.good(out, "--write", file)
    named = {(m["code"], m["where"]): m for m in found["misfits"]}
    for key, true in ((("rotor_inertia", "theta2"), 0.02), (("direction_dependent_friction", "theta1"), 0.05)):
        expect(key in named and abs(named[key]["amount"] - true) < 4 * named[key]["sigma"], f"{key}: {found['misfits']}")
    model = tomllib.loads(file.read_text(encoding="utf-8"))["control"]["model"]
    expect(abs(model["mechanism"]["rotor_inertia"][1] - 0.02) < 2e-3 and abs(model["friction"]["asymmetry"][0] - 0.05) < 5e-3, f"written: {model}")
    after, wrong = bench.settled(file), bench.settled(scene, *values)
    exact = bench.settled(arm, "mechanism.rotor_inertia=[0.0, 0.02]", 'control.model.friction="exact"', *values)
    expect(after <= 1.1 * exact and after < wrong, f"{after} m with what was found, {exact} with the truth, {wrong} before")
    again, _ = bench.record("told", "sim", file)
    expect(bench.good(again)["misfits"] == [], "what is known is named again")


def one_way(bench):
    """Dry friction that depends on the direction: the deceleration of a free arm either way, holding at rest, and a controller that knows it."""
    arm = ARM
    s, angle, step, more = standard(ARM_LEG), 1.2, 2e-4, 0.4
    for rate, torque in ((3.0, -(1.0 + more)), (-3.0, 1.0 - more)):
        for kind in ("", ", regularised=1e-3"):
            values = ["mechanism.gravity=0.0", f'effects=[{{type="coulomb_friction", torque=[1.0, 0.0], asymmetry=[{more}, 0.0]{kind}}}]', "control.law=none",
                    f"initial={{joints=[0.4, {angle}], joint_rates=[{rate}, 0.0]}}", "control.rate_hz=5000", f"simulation.duration={step}", "simulation.step=2e-6"]
            run = bench.run("sim", arm, "--json", *sets(*values))
            got = json.loads(run.stdout)["final_state"]["qd"]
            couple, pull = s["h"] * ARM_LEG["l1"] * math.cos(angle), s["h"] * ARM_LEG["l1"] * math.sin(angle) * rate * rate
            a, b, c = s["a"] + s["c"] + 2 * couple, s["c"] + couple, s["c"]
            want = [rate + step * (torque * c + pull * b) / (a * c - b * b), -step * (torque * b + pull * a) / (a * c - b * b)]
            expect(all(abs(g - w) < 0.02 * abs(want[0] - rate) for g, w in zip(got, want, strict=True)), f"friction at {rate} rad/s{kind}: {got}, by hand {want}")
    for torque, holds in ((1.35, True), (1.45, False), (-0.55, True), (-0.65, False)):
        values = ["mechanism.gravity=0.0", 'effects=[{type="coulomb_friction", torque=[1.0, 9.0], asymmetry=[0.4, 0.0]}]', "control.law=open_loop",
                f"control.torque=[{{offset={torque}}}, {{offset=0.0}}]", f"initial={{joints=[0.4, {angle}]}}", "simulation.duration=0.05"]
        for method in ("moreau_jean", "event_driven"):
            run = bench.run("sim", arm, "--json", "--set", f"simulation.integrator={method}", *sets(*values))
            rate = json.loads(run.stdout)["final_state"]["qd"][0] if run.returncode == 0 else math.nan
            expect((rate == 0.0) == holds and rate * torque >= 0, f"{method}: at {torque} N m the joint turns with {rate} rad/s")
    scene = FRICTION
    dry = ['effects=[{type="coulomb_friction", torque=[0.02, 0.005], asymmetry=[0.01, -0.002]}]', "control.delay_ticks=0"]
    table = "control.model.friction={coulomb=[0.02, 0.005], asymmetry=[0.01, -0.002]}"
    exact, known, mean = (bench.settled(scene, *dry, m) for m in ("control.model.friction=exact", table, "control.model.friction={coulomb=[0.02, 0.005]}"))
    expect(exact == known < 0.7 * mean, f"exact {exact} m, as stated {known}, the mean of both directions alone {mean}")
    for key, value in (("effects", 'effects=[{type="coulomb_friction", torque=[0.02, 0.005], asymmetry=[0.01, 0.006]}]'),
                       ("control.model.friction", "control.model.friction={coulomb=[0.02, 0.005], asymmetry=[-0.03, 0.0]}")):
        bench.refused(bench.run("sim", scene, "--set", value), key, "must be at most")


def motors(bench):
    """Motors that give more or less torque than they are asked for, or cog: the torques of a controller that knows it, the scene that identify writes, the error that
    remains."""
    arm, five = ARM, NOMINAL
    for scene, motor, factor, ripple in ((arm, 2, 1.25, (0.05, 7, 0.4)), (five, 1, 0.8, (0.003, 24, -2.0))):
        model = "control.model={{torque_factor={}, ripple={{amplitude={}, per_turn={}, phase={}}}}}"
        one = [1.0, 1.0], [0.0, 0.0], [1.0, 1.0], [0.0, 0.0]
        known = [list(v) for v in one]
        for v, x in zip(known, (factor, *ripple), strict=True):
            v[motor - 1] = x
        first = []
        for k in (one, known):
            out, run = bench.record(f"first{len(first)}", "sim", scene, *sets("effects=[]", "control.delay_ticks=0", "simulation.duration=0.05", model.format(*k)))
            first.append({k: float(v) for k, v in read_table(out / "log.csv")[0].items() if k != "state"})
        columns = [c for c in first[0] if c.startswith("tau") and c.endswith("_cmd")]
        joint = [c for c in first[0] if c.startswith("theta") and c.endswith("_meas")]
        angle = first[0][joint[0 if motor == 1 else len(joint) // 2]]
        want = [first[0][c] for c in columns]
        want[motor - 1] = (want[motor - 1] - ripple[0] * math.sin(ripple[1] * angle + ripple[2])) / factor
        got = [first[1][c] for c in columns]
        expect(all(abs(g - w) < 1e-9 + 1e-9 * abs(w) for g, w in zip(got, want, strict=True)), f"torques asked for: {got}, by hand {want}")

    values = ["effects=[{type=\"torque_ripple\", amplitude=0.02, per_turn=14.0}]", "control.delay_ticks=0"]
    told = "control.model.ripple={amplitude=0.02, per_turn=14}"
    for law in (["control.law=esmc"], ["control.law=ctc"], ["control.disturbance_observer=40"], ["control.reaching=super_twisting", "control.gain=500"],
                ["control.predictor=true", "control.delay_ticks=2"]):
        late = ["effects=[{type=\"torque_ripple\", amplitude=0.02, per_turn=14.0}, {type=\"compute_delay\", time=2e-3}]"] if "predictor" in law[0] else []
        no_ripple = [late[0].replace("0.02", "0.0")] if late else ["effects=[]"]
        ideal, with_it, without = (bench.settled(five, *values, *law, *x) for x in (no_ripple, [*late, told], late))
        expect(with_it < 1.5 * ideal + 2e-6 and with_it < 0.7 * without, f"{law}: {with_it} m with cogging that is known, {without} with one that is not, {ideal} without")

    out, _ = bench.record("cogging", "sim", five, *sets(*values))
    file = bench.folder / "cogging.toml"
    found = bench.good(out, "--write", file)
    model = tomllib.loads(file.read_text(encoding="utf-8"))["control"]["model"]
    ripple = model.get("ripple", {})
    sigma = max((m["sigma"] for m in found["misfits"] if m["code"] == "cogging"), default=0.0)
    expect(ripple.get("per_turn") == [14.0, 14.0] and all(abs(a - 0.02) < 4 * sigma for a in ripple["amplitude"]) and all(abs(p) < 0.2 for p in ripple["phase"]),
           f"written: {model}, {found['misfits']}")
    exact, wrong, after = bench.settled(five, *values, told), bench.settled(five, *values), bench.settled(file)
    expect(after <= 1.1 * exact + 1e-6 and after < 0.5 * wrong, f"{after} m with what was found, {exact} with the truth, {wrong} before")
    again, _ = bench.record("cogging_known", "sim", file)
    left = bench.good(again, "--write", bench.folder / "cogging_left.toml")["misfits"]  # this log is exact to 1e-6 N m
    expect(all(m["code"] == "cogging" and m["amount"] < 3 * sigma for m in left), f"cogging that is known is named again: {left}")
    last, _ = bench.record("cogging_all", "sim", bench.folder / "cogging_left.toml")
    expect(all(m["code"] != "cogging" for m in bench.good(last)["misfits"]), "what was left of the cogging is named again")

    out, _ = bench.record("weak", "sim", five, "--set", "effects=[]", "--set", "control.delay_ticks=0")
    rows = read_table(out / "log.csv")
    for r in rows:
        r["tau21_cmd"] = repr(float(r["tau21_cmd"]) / 0.9)
    write_table(out / "log.csv", rows)
    found = bench.good(out, "--write", file)
    factor = tomllib.loads(file.read_text(encoding="utf-8"))["control"]["model"].get("torque_factor", [1, 1])
    expect(abs(factor[1] - 0.9) < 0.01 and factor[0] == 1.0, f"torque factors {factor}: {found['misfits']}")
    for key, value, what in (("torque_factor", "0", "from 0.1 to 10"), ("torque_factor", "[1, 1, 1]", "2 numbers"), ("ripple", "{amplitude=0.1}", "per_turn"),
                             ("ripple", "{amplitude=0.1, per_turn=0}", "> 0"), ("ripple", "{amplitude=0.1, per_turn=3, phase=11}", "-10 to 10")):
        bench.refused(bench.run("sim", five, "--set", f"control.model.{key}={value}"), key, what)
    bench.refused(bench.run("sim", five, *sets("control.motors=all", "control.model.ripple={amplitude=0.1, per_turn=3}")), "sensors")


if __name__ == "__main__":
    main(lambda folder: LogBench("identify", folder), rotors, elbow_plant, elbow_controller, elbow_identified, one_way, motors)
