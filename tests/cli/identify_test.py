#!/usr/bin/python3
"""`esmc identify` from outside: mechanisms whose inertia, friction and delay are known here, runs with noise, and whether the stated
intervals hold the truth; what is refused. usage: identify_test.py ESMC"""
import json
import math
import random
import statistics
import tomllib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

from command import ARM, FRICTION, SCENES, read_table, sets
from log_bench import LogBench, expect, main, write_table

NOMINAL = SCENES / "five_bar_identification.toml"



def leg_text(leg):
    return "{ " + ", ".join(f"{k} = {v!r}" for k, v in leg.items()) + " }"


def standard(leg):
    """What the equations of motion are linear in, written down anew."""
    return {"a": leg["J1"] + leg["m1"] * leg["lg1"] ** 2 + leg["m2"] * leg["l1"] ** 2, "c": leg["J2"] + leg["m2"] * leg["lg2"] ** 2,
            "h": leg["m2"] * leg["lg2"], "s": leg["m1"] * leg["lg1"] + leg["m2"] * leg["l1"]}


ONE = {"l1": 0.12, "l2": 0.16, "lg1": 0.06, "lg2": 0.068, "m1": 0.1, "m2": 0.1, "J1": 2e-4, "J2": 7e-4}
TWO = {"l1": 0.118, "l2": 0.163, "lg1": 0.05, "lg2": 0.08, "m1": 0.12, "m2": 0.09, "J1": 3e-4, "J2": 6e-4}
ARM_LEG = {"l1": 0.30, "l2": 0.25, "lg1": 0.15, "lg2": 0.11, "m1": 1.2, "m2": 0.8, "J1": 1.0e-2, "J2": 4.5e-3}
M0 = 0.05
VISCOUS, COULOMB, DELAY = [0.01, 0.002, 0.008, 0.003], [0.02, 0.004, 0.015, 0.005], 0.7


def effects(viscous, coulomb):
    return (f'effects=[{{type="viscous_friction", coefficient={viscous}}}, {{type="coulomb_friction", torque={coulomb}}}, '
            f'{{type="compute_delay", time={DELAY}e-3}}, {{type="encoder", bits=16}}, {{type="noise", sigma=2e-5}}]')


def unequal_scene(bench):
    """Unequal legs and a mass at the effector, of which the controller believes something else."""
    text = NOMINAL.read_text(encoding="utf-8")
    lines = []
    for line in text.split("[[effects]]")[0].splitlines():
        line = f"legs = [{leg_text(ONE)}, {leg_text(TWO)}]\neffector_mass = {M0}" if line.startswith("leg = ") else line
        lines.append(line.replace("[control]", "[control]\nmodel = { m1 = 0.9, m2 = 1.1, J2 = 0.8 }"))
    path = bench.folder / "unequal.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def true_values_of(*legs):
    return {k + str(j): v for j, leg in enumerate(legs, 1) for k, v in standard(leg).items()}


def true_values():
    truth = {"m0": M0} | true_values_of(ONE, TWO)
    for i, joint in enumerate(("11", "12", "21", "22")):
        truth |= {f"viscous theta{joint}": VISCOUS[i], f"coulomb theta{joint}": COULOMB[i]}
    return truth


def five_bar(bench, seeds=12):
    scene, truth = unequal_scene(bench), true_values()

    def one(seed):
        return bench.good(bench.record(f"run{seed}", "sim", scene, "--set", effects(VISCOUS, COULOMB), "--seed", seed)[0])

    with ThreadPoolExecutor(2) as pool:
        results = [r for r in pool.map(one, range(1, seeds + 1)) if r]
    inside, widths = Counter(), {}
    for r in results:
        expect(sum(p["inertial"] for p in r["parameters"]) == 7, "a five-bar has seven inertial base parameters")
        for p in r["parameters"]:
            name = next(iter(p["share"]))
            value = sum(share * truth[k] for k, share in p["share"].items())
            inside[name] += p["lower"] <= value <= p["upper"]
            widths.setdefault(name, []).append((p["upper"] - p["lower"]) / 2 / abs(value))
        inside["delay"] += r["delay"]["lower"] <= DELAY <= r["delay"]["upper"]
        widths.setdefault("delay", []).append((r["delay"]["upper"] - r["delay"]["lower"]) / 2)
    expect(len(inside) == 16, f"parameters: {sorted(inside)}")
    for name, n in inside.items():
        expect(n >= 0.9 * len(results), f"{name}: the truth is inside in {n} of {len(results)} runs")
    expect(sum(inside.values()) >= 0.97 * 16 * len(results), f"intervals hold the truth too seldom: {dict(inside)} of {len(results)}")
    widths = {name: statistics.median(w) for name, w in widths.items()}
    for name, width in widths.items():
        expect(width < 0.25, f"{name}: +- {width} of it says nothing")
    # A mass may be moved from the tip of one leg to that of the other, or to the effector: the closed forms of what that does.
    share = {p["name"].split()[0]: p["share"] for p in results[0]["parameters"] if p["inertial"]}
    for name, k, of in (("a1", ONE["l1"] ** 2, 1), ("c1", ONE["l2"] ** 2, 1), ("h1", ONE["l2"], 1), ("s1", ONE["l1"], 1),
                        ("a2", TWO["l1"] ** 2, -1), ("c2", TWO["l2"] ** 2, -1), ("h2", TWO["l2"], -1)):
        expect(abs(share[name]["s2"] - of * k / TWO["l1"]) < 1e-6, f"share of s2 in {name}: {share[name]}")
        expect(of < 0 or abs(share[name]["m0"] - k) < 1e-6, f"share of m0 in {name}: {share[name]}")
    for name, n in inside.items():
        print(f"{name:18} inside {n} of {len(results)}, half width {widths[name]:.3g}")
    return inside, widths, len(results)


def snippet(bench):
    """Equal legs: the factors of [uncertainty] are the true ones over the believed ones."""
    out, _ = bench.record("equal", "sim", NOMINAL, "--set", "control.model={m1=0.9, m2=1.1, J1=1.2, J2=0.8}")
    table = tomllib.loads(bench.good(out)["toml"])["uncertainty"]
    for name, believed in (("m1", 0.9), ("m2", 1.1), ("J1", 1.2), ("J2", 0.8)):
        lower, upper = table[name]
        expect(lower <= 1 / believed <= upper and upper - lower < 0.3, f"[uncertainty] {name} = {table[name]}, true {1 / believed}")
    for kind, true in (("viscous", [0.01, 0.002] * 2), ("coulomb", [0.02, 0.004] * 2)):
        for (lower, upper), t in zip(table[kind], true, strict=True):
            expect(lower <= t <= upper, f"[uncertainty] {kind} = {table[kind]}, true {true}")
    told = bench.run("identify", out)
    expect(told.returncode == 0 and "torque delay" in told.stdout and "[uncertainty]" in told.stdout, "the table for people")


def payload(bench):
    """A mass missing from the scene: no table that is impossible; a payload, where factors near 1 explain the rest. Neither: said so."""
    scene = NOMINAL
    known = effects([0.01, 0.002] * 2, [0.02, 0.004] * 2)
    for mass in (0.05, 0.1):
        out, _ = bench.record(f"payload{mass}", "sim", scene, "--set", known[:-1] + f', {{type="payload", mass={mass}}}]')
        found = bench.good(out)
        table = tomllib.loads(found["toml"])["uncertainty"]
        expect(table.get("payload", [1, 0])[0] - 1e-3 <= mass <= table.get("payload", [1, 0])[1] + 1e-3, f"payload of {mass} kg: {table}")
        for name in ("m1", "m2", "J1", "J2"):
            expect(table[name][1] > table[name][0] > 0.7 and table[name][1] < 1.4, f"payload of {mass} kg: {name} = {table[name]}")
        expect(len(found["warnings"]) == 1 and "outside [0.5, 2]" in found["warnings"][0], f"payload of {mass} kg: {found['warnings']}")
        told = bench.run("identify", out).stdout
        expect(told.count("warning: ") == 1 and f"a payload of {mass}" in told, f"payload of {mass} kg, for people: {told[-900:]}")
        run = bench.run("sim", scene, "--json", "--set", "uncertainty={payload=" + str(table["payload"]) + "}", "--set", "simulation.duration=0.1")
        expect(run.returncode == 0, f"the table cannot be pasted: {run.stderr}")
    # Unequal legs as believed: the motion tells a payload from factors, also where those alone are not impossible, only wide.
    legs, friction = bench.folder / "legs.toml", effects(VISCOUS, COULOMB)
    legs.write_text(unequal_scene(bench).read_text(encoding="utf-8").replace("model = { m1 = 0.9, m2 = 1.1, J2 = 0.8 }\n", ""), encoding="utf-8")
    for mass in (0.0, 0.05):
        more = f', {{type="payload", mass={mass}}}]' if mass else "]"
        found = bench.good(bench.record(f"unequal{mass}", "sim", legs, "--set", friction[:-1] + more)[0])
        table = tomllib.loads(found["toml"])["uncertainty"]
        expect(len(found["warnings"]) == (mass > 0) == ("payload" in table), f"unequal legs, {mass} kg: {found['warnings']}")
        lower, upper = table.get("payload", [0, 0])
        expect(lower <= mass <= upper and upper - lower < 0.005, f"unequal legs: payload {table.get('payload')}, true {mass}")
        for name in ("m1", "m2", "J1", "J2"):
            expect(table[name][0] <= 1 <= table[name][1] < 1.1, f"unequal legs, {mass} kg: {name} = {table[name]}")
    # What a load may take away is what the controller believes to be there.
    own = f'control.model.mechanism={{type="five_bar", half_base=0.05, gravity=9.8, effector_mass=0.05, working_mode=["+", "+"], leg={leg_text(ONE)}}}'
    run = bench.run("check", scene, *sets(own, "uncertainty.payload=[-0.02, 0.02]"))
    expect(run.returncode == 0, f"a load that is believed in may be taken away: {run.stderr}")
    bench.refused(bench.run("check", scene, *sets(own.replace("effector_mass=0.05", "effector_mass=0.0"), "mechanism.effector_mass=0.05", "uncertainty.payload=[-0.02, 0.02]")), "takes away more")
    heavy, _ = bench.record("five times", "sim", scene, "--set", "control.model={J1=5.0, J2=0.2}", "--set", known)
    found = bench.good(heavy)
    expect(any("a payload does not mend it" in w for w in found["warnings"]), f"J1 5 times too large, J2 5 times too small: {found['warnings']}")
    # A mass centre far from where it is believed: factors that would have to be below 0, so that no table contains what was found.
    centre = bench.folder / "centre.toml"
    centre.write_text(scene.read_text(encoding="utf-8").replace("lg2 = 0.068", "lg2 = 0.02"), encoding="utf-8")
    told = bench.run("identify", heavy, "--scene", centre, "--json")
    words = json.loads(told.stdout)["warnings"] if told.returncode == 0 else [told.stderr]
    expect(any("does not contain what was found" in w for w in words), f"lg2 believed 0.02 m: {words}")
    plain, _ = bench.record("as believed", "sim", scene, "--set", known)
    found = bench.good(plain)
    expect(found["warnings"] == [] and "payload" not in found["toml"], f"as believed: {found['warnings']}")


def arm(bench):
    truth = standard(ARM_LEG) | {"viscous theta1": 0.1, "viscous theta2": 0.05, "coulomb theta1": 0.2, "coulomb theta2": 0.1}
    inside = total = 0
    for seed in range(1, 5):
        out, _ = bench.record(f"arm{seed}", "sim", ARM, "--seed", seed, "--set", effects([0.1, 0.05], [0.2, 0.1]), "--set",
                           "control.model={m2=0.9}", "--set", "control.delay_ticks=3", "--set", "simulation.duration=4.0", "--set",
                           'reference={type="joint_sine", offset=[0.3, 1.5], amplitude=[0.5, 0.7], omega=[5.3, 8.9], join=0.3}')
        for p in bench.good(out)["parameters"]:
            expect(p["name"] in truth, f"RR: no parameter {p['name']}")
            total += 1
            inside += p["lower"] <= truth.get(p["name"], 0) <= p["upper"]
    expect(total == 32 and inside >= 31, f"RR: {inside} of {total} intervals hold the truth")
    bench.bad("no column theta11_meas", out, "--scene", NOMINAL)


def large(bench):
    """A mechanism of bars ten times as long, of 1e4 N m: lengths by a, masses by a^3 and times by the root of a. Nothing that is tried on its log may leave its reach."""
    a = 10.0
    t, torque = math.sqrt(a), a**4
    leg = {k: v * {"l": a, "m": a**3, "J": a**5}[k[0]] for k, v in ONE.items()}
    friction = effects([x * torque * t for x in (0.01, 0.002)], [x * torque for x in (0.02, 0.004)])
    out, _ = bench.record("large", "sim", NOMINAL, *sets(f"mechanism.half_base={0.05 * a}", f"mechanism.leg={leg_text(leg)}", f"control.lambda={30 / t}",
                          f"control.gain={{position=40.0, angle={40 / a}}}", f"control.rate_hz={1000 / t}", f"control.torque_limit={2 * torque}",
                          f"reference.omega=[{9.1 / t}, {14.3 / t}]", f"reference.join={0.3 * t}", f"simulation.duration={4 * t}", friction))
    result = bench.good(out, "--window", 0.1 * t)
    truth = true_values_of(leg, leg) | {"m0": 0.0}
    for p in (p for p in (result["parameters"] if result else []) if p["inertial"]):
        value = sum(share * truth[k] for k, share in p["share"].items())
        expect(p["lower"] <= value <= p["upper"], f"large: {p['name']}: {p['lower']} to {p['upper']}, true {value}")


def light(bench):
    """All masses and torques divided by 2^10: the same delay, every value and uncertainty divided by that."""
    found = []
    for part in (1, 1024):
        leg = {k: v / (1 if k[0] == "l" else part) for k, v in ONE.items()}
        friction = effects([0.01 / part, 0.002 / part], [0.02 / part, 0.004 / part])
        out, _ = bench.record(f"light{part}", "sim", NOMINAL, *sets(f"mechanism.leg={leg_text(leg)}", f"control.torque_limit={2 / part}", friction))
        found.append(bench.good(out))
    one, other = found
    for key in ("ticks", "sigma"):
        expect(abs(one["delay"][key] - other["delay"][key]) < 1e-6, f"light: delay {one['delay']}, {other['delay']}")
    for p, q in zip(one["parameters"], other["parameters"], strict=True):
        expect(abs(q["sigma"] * 1024 / p["sigma"] - 1) < 1e-3, f"light: {p['name']} +- {p['sigma']}, {q['sigma']}")


def cogging_of_elbows(bench):
    """What is believed of an elbow's motor is not found again."""
    out, _ = bench.record("elbow", "sim", NOMINAL, *sets("control.motors=all", "drives.nodes=[1, 2, 3, 4]", "control.sensors=all", effects([0.01, 0.002], [0.02, 0.004])))
    rows = read_table(out / "log.csv")
    for r in rows:
        r["tau12_cmd"] = repr(float(r["tau12_cmd"]) - 0.004 * math.sin(14 * float(r["theta12"])))
    log, told = bench.folder / "elbow.csv", bench.folder / "elbow.toml"
    write_table(log, rows)
    first = bench.good(log, "--scene", out / "scene.toml", "--write", told)
    expect([m["code"] for m in first["misfits"]] == ["cogging"], f"elbow: {first['misfits']}")
    amplitude = tomllib.loads(told.read_text(encoding="utf-8"))["control"]["model"]["ripple"]["amplitude"]
    expect(abs(amplitude[1] - 0.004) < 2e-4 and [amplitude[i] for i in (0, 2, 3)] == [0, 0, 0], f"elbow: {amplitude}")
    again = bench.good(log, "--scene", told)
    expect(again["misfits"] == [], f"elbow, known: {again['misfits']}")


def hostile(bench):
    scene = NOMINAL
    out, _ = bench.record("plain", "sim", scene)
    bench.bad("--window 0.03", out, "--window", "0.03")
    log = (out / "log.csv").read_text(encoding="utf-8").splitlines()
    place = bench.folder / "hostile.csv"

    def with_log(lines, what, *more, end="\n"):
        place.write_text("\n".join(lines) + end, encoding="utf-8")
        bench.bad(what, place, "--scene", scene, *more)

    with_log(log[:1500], "rows are too few")
    head = log[0].split(",")

    def changed(column, change):
        at = head.index(column)
        return [log[0]] + [",".join([*(f := l.split(",")[:at]), change(float(f[0]) if at else 0.0, l.split(",")[at]), *l.split(",")[at + 1:]]) for l in log[1:]]
    with_log(changed("tau11_cmd", lambda t, v: repr(-float(v))), "with their signs?")
    with_log(changed("tau11_cmd", lambda t, v: "0"), "motor 1 has no torque at all")
    tau, rate, driven = head.index("tau11_cmd"), head.index("theta11_rate_meas"), [log[0]]
    for fields in (l.split(",") for l in log[1:]):  # something else drives the joint with its motion
        fields[tau] = repr(float(fields[tau]) - 0.03 * float(fields[rate]))
        driven.append(",".join(fields))
    with_log(driven, "friction brakes")
    with_log(changed("state", lambda t, v: "fault" if t > 1.0 else v), "state is 'fault': only rows of a running controller")
    with_log(log[:1], "rows are too few")
    with_log(log, "torn off", end="")
    with_log(log[:900] + log[950:], "hostile.csv:901: t = ")
    at = log[0].split(",").index("tau21_cmd")
    for word in ("nan", "-inf", "x"):
        fields = log[700].split(",")
        fields[at] = word
        with_log(log[:700] + [",".join(fields)] + log[701:], "hostile.csv:701: tau21_cmd must be a finite number")
    with_log([log[0].replace("tau21_cmd", "other")] + log[1:], "no column tau21_cmd")
    bench.bad("--window", out, "--window", "0.001")
    bench.bad("too few", out, "--window", "1.0")
    bench.bad("must be a number > 0", out, "--coverage", "nan")
    bench.bad("fit no closed mechanism", out, "--scene", heavy_scene(bench, scene))
    # Torques that are not those of the motion.
    draw = random.Random(5)
    wild = [log[0]]
    for line in log[1:]:
        fields = line.split(",")
        fields[at] = str(draw.uniform(-1, 1))
        wild.append(",".join(fields))
    with_log(wild, "stay unexplained")
    for name, change in (("rest", 'reference={type="hold"}'), ("slow", "reference.omega=[0.3, 0.2]")):
        more = ["--set", "initial.position=[0.0, 0.17]"] if name == "rest" else []
        still, _ = bench.record(name, "sim", scene, "--set", change, *more)
        run = bench.run("identify", still)
        expect(run.returncode == 2 and ("does not determine" in run.stderr or "unexplained" in run.stderr), f"{name}: {run.returncode} {run.stderr}")


def heavy_scene(bench, scene):
    """Lengths that those angles do not close, or whose motion those torques do not explain."""
    path = bench.folder / "other.toml"
    path.write_text(scene.read_text(encoding="utf-8").replace("half_base = 0.05", "half_base = 0.09"), encoding="utf-8")
    return path


def designed(bench):
    """The way of docs/calibration.md from a log to gains: the table goes into the scene, delay and lag are told."""
    scene = NOMINAL
    out, _ = bench.record("chain", "sim", scene)
    found = bench.good(out)
    path = bench.folder / "identified.toml"
    path.write_text(scene.read_text(encoding="utf-8") + "\n" + found["toml"], encoding="utf-8")
    told = ["--set", f"control.delay_ticks={found['delay']['upper']}", "--set", "control.sensor_lag_ticks=2"]
    run = bench.run("design", path, "--json", "--simulate", "4", "--set", "control.law=smc", *told)
    expect(run.returncode == 0, f"design: exit {run.returncode}: {run.stdout}{run.stderr}")
    plants = json.loads(run.stdout)["simulated"]["exact_lengths"]
    expect(plants["outside_band"] == 0 and plants["stopped"] == 0 and plants["largest_error"] > 0, f"design: {plants}")
    refused = json.loads(bench.run("design", path, "--json", *told).stdout)["refused"]
    expect(refused and "tried and helps: law smc" in refused, f"design of the full law: {refused}")


def written(bench):
    """--write: a scene whose controller tracks as if it knew the truth, and which every command reads; refusals leave nothing."""
    legs = unequal_scene(bench)
    sine = ["control.delay_ticks=3", "simulation.duration=4.0",
            'reference={type="joint_sine", offset=[0.3, 1.5], amplitude=[0.5, 0.7], omega=[5.3, 8.9], join=0.3}']
    cases = [("legs", legs, effects(VISCOUS, COULOMB), []),
             ("equal", NOMINAL, effects([0.01, 0.002] * 2, [0.02, 0.004] * 2), ["control.model={m1=0.9, m2=1.1, J2=0.8}"]),
             ("arm", ARM, effects([0.1, 0.05], [0.2, 0.1]), ["control.model={m2=0.8, m1=1.1}", *sine])]
    for name, scene, true_effects, values in cases:
        values = [true_effects, *values]
        out, _ = bench.record(f"write {name}", "sim", scene, *sets(*values))
        file = bench.folder / "elsewhere" / f"{name}.toml"
        file.parent.mkdir(exist_ok=True)
        before = bench.good(out, "--write", file)
        model = tomllib.loads(file.read_text(encoding="utf-8"))["control"]["model"]
        expect(set(model) == {"mechanism", "friction"}, f"{name}: {model}")
        wrong, after = bench.settled(scene, *values), bench.settled(file)
        exact = bench.settled(scene, *values, "control.model={m1=1, m2=1, J1=1, J2=1, friction=\"exact\"}")
        expect(after <= 1.1 * exact and after < wrong, f"{name}: {after} m with what was found, {exact} with the truth, {wrong} before")
        # The same numbers once more, believed already: nothing is left to find.
        again, _ = bench.record(f"again {name}", "sim", file)
        found = tomllib.loads(bench.good(again)["toml"])["uncertainty"]
        for key in ("m1", "m2", "J1", "J2"):
            lower, upper = found.get(key, (1, 1))
            expect(lower <= 1 <= upper, f"{name}: {key} = {found.get(key)} after --write")
        expect(before["misfits"] == [], f"{name}: {before['misfits']}")
        for command in (["check"], ["design", "--set", "control.law=smc"], ["hil", "--set", "simulation.duration=0.1"]):
            run = bench.run(command[0], file, *command[1:])
            expect(run.returncode in (0, 1) and "esmc: " not in run.stderr.replace("esmc: warning", ""), f"{name}: {command}: {run.returncode} {run.stderr}")
    plain, _ = bench.record("write plain", "sim", legs)
    for what, target in (("is an input of this command", plain / "scene.toml"), ("no/such", bench.folder / "no/such/file.toml")):
        bench.bad(what, plain, "--write", target)
    text = (plain / "log.csv").read_text(encoding="utf-8").splitlines()[:900]
    short = bench.folder / "short.csv"
    short.write_text("\n".join(text) + "\n", encoding="utf-8")
    target = bench.folder / "never.toml"
    bench.bad("rows are too few", short, "--scene", legs, "--write", target)
    expect(not target.exists(), "a refusal left a scene")


def belief(bench):
    """Friction and a mechanism of the controller's own: the same run as by what they replace; what is wrong is said."""
    scene = FRICTION

    def digest(*values):
        run = bench.run("sim", scene, "--json", "--set", "simulation.duration=0.7", *sets(*values))
        expect(run.returncode == 0, f"{values}: {run.stderr}")
        return json.loads(run.stdout)["digest"] if run.returncode == 0 else None

    dry = 'effects=[{type="viscous_friction", coefficient=[0.01, 0.002, 0.02, 0.003]}, {type="coulomb_friction", torque=[0.02, 0.005]}]'
    table = "control.model.friction={viscous=[0.01, 0.002, 0.02, 0.003], coulomb=[0.02, 0.005]}"
    expect(digest(dry, "control.model.friction=exact") == digest(dry, table) != digest(dry), "stated friction is not that of the effects")
    leg = "{ l1 = 0.12, l2 = 0.16, lg1 = 0.06, lg2 = 0.068, m1 = 0.1, m2 = 0.1, J1 = 2e-4, J2 = 7e-4 }"
    own = f'mechanism={{type="five_bar", half_base=0.05, gravity=9.8, working_mode=["+", "+"], leg={leg}}}'
    expect(digest(f"control.model.{own}") == digest(), "a mechanism like that of the scene, with the factors of the scene")
    for what, value in (("'control.model.friction' must be one of: none | exact, or a table", "friction=3"),
                        ("'control.model.friction.viscous' must be 2 or 4 numbers", "friction={viscous=[0.1]}"),
                        ("unknown key 'control.model.friction.dry'", "friction={dry=[0.1, 0.1]}"),
                        ("'control.model.mechanism' is of another type", own.replace("five_bar", "rr").replace("half_base=0.05, ", "").replace('["+", "+"]', '["+"]')),
                        ("missing key 'control.model.mechanism.half_base'", own.replace("half_base=0.05, ", ""))):
        bench.refused(bench.run("sim", scene, "--set", f"control.model.{value}"), what)


def misfits(bench):
    """A log of each defect, made of a good one, names it. Logs without a defect: study.identify_clean."""
    base = NOMINAL

    def edited(name, scene, out, change):
        """The log with columns changed: {name: list of values}."""
        rows = read_table(out / "log.csv")
        number = lambda key: [float(r[key]) for r in rows]
        for key, values in change(number).items():
            for r, v in zip(rows, values, strict=True):
                r[key] = repr(v)
        path = bench.folder / f"{name}.csv"
        write_table(path, rows)
        return path, "--scene", scene

    def expect_named(code, where, arguments, amount, tolerance):
        result = bench.good(*arguments)
        hits = [m for m in result["misfits"] if m["code"] == code and m["where"] == where] if result else []
        expect(hits and abs(abs(hits[0]["amount"]) - amount) <= tolerance, f"{code} of {where}, {amount}: {result and result['misfits']}")

    out, _ = bench.record("defects", "sim", base, "--set", effects([0.01, 0.002], [0.02, 0.004]))
    add = lambda values, more: [v + m for v, m in zip(values, more, strict=True)]
    expect_named("direction_dependent_friction", "theta11", edited("direction", base, out, lambda n: {"tau11_cmd": [v + 0.006 for v in n("tau11_cmd")]}), 0.006, 1e-3)
    expect_named("torque_constant", "theta21", edited("constant", base, out, lambda n: {"tau21_cmd": [v / 1.05 for v in n("tau21_cmd")]}), 0.05, 0.01)
    expect_named("cogging", "theta11", edited("cogging", base, out, lambda n: {"tau11_cmd": add(n("tau11_cmd"), [-0.02 * math.sin(24 * a) for a in n("theta11")])}), 0.02, 4e-3)
    expect_named("eccentric_encoder", "theta21", edited("eccentric", base, out, lambda n: {"theta21_meas": add(n("theta21_meas"), [4e-3 * math.sin(a + 0.5) for a in n("theta21")])}), 4e-3, 2e-3)
    out, _ = bench.record("rotor", "sim", ARM, "--set", effects([0.1, 0.05], [0.2, 0.1]), "--set", "control.delay_ticks=3", "--set", "simulation.duration=4.0",
                          "--set", 'reference={type="joint_sine", offset=[0.3, 1.5], amplitude=[0.5, 0.7], omega=[5.3, 8.9], join=0.3}')
    rotor = lambda n: {"tau2_cmd": add(n("tau2_cmd"), [3.6e-3 * (b - a) / 1e-3 for a, b in zip(n("theta2_rate"), [*n("theta2_rate")[1:], n("theta2_rate")[-1]], strict=True)])}
    expect_named("rotor_inertia", "theta2", edited("rotor", ARM, out, rotor), 3.6e-3, 6e-4)


def four_motors(bench):
    """Torques of elbows are gathered where the mechanism is when they act, at parts of a tick, too."""
    for delay in (0.1, 0.9):
        out, _ = bench.record(f"four {delay}", "sim", SCENES / "five_bar_identification.toml", "--set", "control.motors=all", "--set", "drives.nodes=[1, 2, 3, 4]",
                              "--set", "control.delay_ticks=1", "--set", f'effects=[{{type="viscous_friction", coefficient=[0.01, 0.002]}}, {{type="compute_delay", time={delay}e-3}}]')
        found = bench.good(out, "--observer-bandwidth", "0")["delay"]
        expect(abs((found["lower"] + found["upper"]) / 2 - delay) < 0.005, f"four motors: a delay of {delay} ticks: {found}")


if __name__ == "__main__":
    main(lambda folder: LogBench("identify", folder), five_bar, four_motors, snippet, payload, arm, designed, written, belief, misfits, large, light, cogging_of_elbows, hostile)
