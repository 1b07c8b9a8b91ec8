#!/usr/bin/python3
"""`esmc calibrate` from outside: mechanisms that are not what the controller believes, their logs, what is found, and where the
effector then is; what is refused. usage: calibrate_test.py ESMC

The judge is forward kinematics of this file against where the simulator's plant was, and the true numbers themselves."""
import cmath
import json
import math
import random
import tomllib

from command import ARM, SCENES, read_table
from log_bench import LogBench, expect, main, write_table

NOMINAL = {"half_base": 0.05, "legs": [(0.12, 0.16), (0.12, 0.16)]}
REST = "lg1 = 0.06, lg2 = 0.068, m1 = 0.1, m2 = 0.1, J1 = 2e-4, J2 = 7e-4"
OFFSETS = ("offset theta11", "offset theta12", "offset theta21", "offset theta22")


def effector(half_base, legs, a11, a21, near):
    """Effector of a five-bar by its base joints: the intersection of two circles next to `near`."""
    one = half_base + legs[0][0] * cmath.exp(1j * a11)
    two = -half_base - legs[1][0] * cmath.exp(-1j * a21)
    w = one - two
    d = abs(w)
    along = (d * d + legs[1][1] ** 2 - legs[0][1] ** 2) / (2 * d)
    across = math.sqrt(legs[1][1] ** 2 - along * along)
    return min((two + w / d * complex(along, s * across) for s in (1, -1)), key=lambda p: abs(p - near))


class Bench(LogBench):
    nominal, arm = SCENES / "five_bar_calibration.toml", ARM

    def __init__(self, folder):
        super().__init__("calibrate", folder)

    def true_scene(self, name, mechanism, bias, base=None):
        """The scene with another plant, and encoders whose zero is off; its controller believes the nominal one."""
        text = (base or self.nominal).read_text(encoding="utf-8")
        (l11, l12), (l21, l22) = mechanism["legs"]
        lines = []
        for line in text.splitlines():
            if line.startswith("half_base"):
                line = f"half_base = {mechanism['half_base']!r}"
            elif line.startswith("leg = "):
                line = f"legs = [{{ l1 = {l11!r}, l2 = {l12!r}, {REST} }}, {{ l1 = {l21!r}, l2 = {l22!r}, {REST} }}]"
            elif line.startswith("[control]"):
                line += f'\nmodel = {{ mechanism = "{self.nominal}" }}'
            lines.append(line)
        lines += ["[[effects]]", 'type = "bias"', f"angle = {list(bias)!r}"]
        path = self.folder / f"{name}.toml"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path


def rows_of(out):
    return [{k: float(v) for k, v in r.items() if k != "state"} for r in read_table(out / "log.csv")]


def errors(rows, half_base, legs, offsets):
    """Largest and root mean square distance of the effector, as base encoders have it, from where it was."""
    d = []
    for r in rows:
        truth = complex(r["x"], r["y"])
        d.append(abs(effector(half_base, legs, r["theta11_meas"] + offsets[0], r["theta21_meas"] + offsets[2], truth) - truth))
    return max(d), math.sqrt(sum(e * e for e in d) / len(d))


def values(result):
    return {u["name"]: (u["value"], u["sigma"]) for u in result["unknowns"]}


def geometry(found, half_base):
    legs = [(found[f"leg {j} l1"][0], found[f"leg {j} l2"][0]) for j in (1, 2)]
    return found.get("half_base", (half_base, 0))[0], legs, [found[o][0] for o in OFFSETS]


def write_readings(path, rows, at, noise, draw, frame=(0j, 0.0)):
    """Effector readings t,x,y at these rows, with noise, in a frame with this origin and angle."""
    lines = ["t,x,y"]
    for i in at:
        p = complex(rows[i]["x"], rows[i]["y"]) + complex(draw.gauss(0, noise), draw.gauss(0, noise))
        p = (p - frame[0]) * cmath.exp(-1j * frame[1])
        lines.append(f"{rows[i]['t']!r},{p.real!r},{p.imag!r}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def accuracy(bench):
    """Lengths wrong by up to 1 %, zeros by up to 5 mrad, 16-bit encoders: to 0.2 mm at the effector, and the truth where it is said
    to be."""
    draw = random.Random(20)
    beside, outside, all_of = [], 0, 0
    for case in range(6):
        sign = (lambda: draw.choice((-1, 1))) if case < 3 else (lambda: draw.uniform(-1, 1))
        mechanism = {"half_base": 0.05 * (1 + 0.01 * sign()),
                     "legs": [tuple(l * (1 + 0.01 * sign()) for l in (0.12, 0.16)) for _ in range(2)]}
        bias = [5e-3 * sign() for _ in range(4)]
        scene = bench.true_scene(f"true{case}", mechanism, bias)
        out, _ = bench.record(f"run{case}", "hil" if case == 0 else "sim", scene)
        rows = rows_of(out)
        before, _ = errors(rows, NOMINAL["half_base"], NOMINAL["legs"], [0] * 4)
        expect(before > 5e-4, f"case {case}: only {before} m to mend")
        at = range(100, 2000, 140)
        ways = [("--half-base", mechanism["half_base"])]
        readings = write_readings(bench.folder / f"readings{case}.csv", rows, at, 2e-5, draw)
        ways.append(("--effector", readings, "--effector-sigma", "2e-5"))
        # In a frame beside the base every length looks undetermined; the readings are what is blamed.
        shifted = write_readings(bench.folder / f"shifted{case}.csv", rows, at, 2e-5, random.Random(case), (0.03 + 0j, 0.0))
        bench.bad("no lengths meet the effector readings", out, "--effector", shifted, "--effector-sigma", "2e-5")
        elsewhere = write_readings(bench.folder / f"elsewhere{case}.csv", rows, at, 2e-5, draw, (complex(0.3, -0.2), 0.7))
        ways.append(("--effector", elsewhere, "--effector-sigma", "2e-5", "--free-frame"))
        for way in ways:
            result = bench.good(out, *way)
            if result is None:
                continue
            found = values(result)
            half_base, legs, offsets = geometry(found, mechanism["half_base"])
            after, _ = errors(rows, half_base, legs, offsets)
            expect(result["misfits"] == [], f"case {case} {way}: round encoders, {result['misfits']}")
            beside.append((before, after))
            expect(after <= 0.2e-3, f"case {case} {way}: effector {after} m off after calibration")
            expect(after <= 6 * result["effector"]["sigma_m"] + 2e-5, f"case {case} {way}: {after} m off, told {result['effector']}")
            expect(0.5 * before < result["effector"]["nominal_max_m"] < 1.5 * before, f"case {case}: what the nominal values cost")
            truth = {"half_base": mechanism["half_base"]}
            for j, leg in enumerate(mechanism["legs"], 1):
                truth |= {f"leg {j} l1": leg[0], f"leg {j} l2": leg[1]}
            truth |= {o: -b for o, b in zip(OFFSETS, bias)}
            if "--free-frame" in way:
                truth |= {"frame x": 0.3, "frame y": -0.2, "frame angle": 0.7}
            for name, (value, sigma) in found.items():
                all_of += 1
                outside += abs(value - truth[name]) > 2 * sigma
                expect(abs(value - truth[name]) < 6 * sigma, f"case {case} {way}: {name} {value} +- {sigma}, true {truth[name]}")
            expect(way[0] != "--half-base" or "half_base" not in found, "a known half base is not estimated")
    expect(outside <= 0.15 * all_of, f"{outside} of {all_of} true values are more than two standard uncertainties off")
    before, after = ([1e3 * way[i] for way in beside] for i in (0, 1))
    print(f"effector by base encoders, max: {min(before):.3g} to {max(before):.3g} mm before, {min(after):.2g} to {max(after):.2g} mm after")


def table(bench):
    """The table for people: a name, three numbers, a unit, with blanks between, also of negative offsets that are next to nothing."""
    out, _ = bench.record("as drawn", "sim", bench.true_scene("drawn", NOMINAL, [5e-5] * 4))
    found, lines = values(bench.good(out, "--trust-half-base")), bench.run("calibrate", out, "--trust-half-base").stdout.splitlines()
    expect(any(len(f"{value:.8g}") == len("-1.2345678e-05") for value, _ in found.values()), f"no number is as long as one can be: {found}")
    for name, (value, sigma) in found.items():
        fields = next((line for line in lines if line.startswith(name)), "")[len(name):].split()
        expect(len(fields) == 4 and abs(float(fields[1]) - value) <= 1e-7 * abs(value) and fields[3] in ("m", "rad"), f"{name}: {fields}")


def eccentric(bench):
    """An encoder off its centre by 1 mrad: named, and the truth where it is said to be."""
    draw = random.Random(9)
    for case in range(8):
        mechanism = {"half_base": 0.05, "legs": [tuple(l * (1 + 0.01 * draw.uniform(-1, 1)) for l in (0.12, 0.16)) for _ in range(2)]}
        out, _ = bench.record(f"round{case}", "sim", bench.true_scene(f"round{case}", mechanism, [0.0] * 4))
        joint, phase = ("theta11", "theta12", "theta21", "theta22")[case % 4], draw.uniform(0, 6)
        rows = read_table(out / "log.csv")
        for r in rows:
            r[f"{joint}_meas"] = repr(float(r[f"{joint}_meas"]) + 1e-3 * math.sin(float(r[joint]) + phase))
        log = bench.folder / f"eccentric{case}.csv"
        write_table(log, rows)
        result = bench.good(log, "--scene", out / "scene.toml", "--half-base", 0.05)
        expect(any(m["code"] == "eccentric_encoder" for m in result["misfits"]), f"case {case}, {joint}: {result['misfits']}")
        for j, leg in enumerate(mechanism["legs"], 1):
            for name, true in zip((f"leg {j} l1", f"leg {j} l2"), leg):
                value, sigma = values(result)[name]
                expect(abs(value - true) < 3 * sigma, f"case {case}, {joint}: {name} {value} +- {sigma}, true {true}")


def closed_loop(bench):
    """The controller on its circle, believing the drawing and then the calibrated scene."""
    # The worst corner of +-1 % for the circle of the comparison scenario: 14 mm by the lengths alone.
    mechanism = {"half_base": 0.0505, "legs": [(0.1212, 0.1584), (0.1212, 0.1584)]}
    bias = [2e-3, -3e-3, 1e-3, 5e-3]
    scene = bench.true_scene("uncalibrated", mechanism, bias)
    out, _ = bench.record("uncalibrated", "sim", scene)
    calibrated = bench.folder / "calibrated.toml"
    result = bench.good(out, "--half-base", 0.0505, "--write", calibrated)
    circle = ["--set", 'reference={type="circle", center=[0.0, 0.17], radius=0.07, speed=10.0, join=0.3}', "--set", "control.rate_hz=1000",
              "--set", "control.lambda=40.0", "--set", "control.gain=150.0", "--set", "control.delay_ticks=0", "--set",
              'control.sensors="base"', "--set", "simulation.duration=2.0"]
    bare = bench.folder / "bare.toml"  # no table of passive encoders
    bare.write_text(scene.read_text(encoding="utf-8").replace("[sensors]\nnodes = [3, 4]\n", ""), encoding="utf-8")
    zeros = lambda angle: f'effects=[{{type="bias", angle={angle}}}]'
    _, before = bench.record("before", "sim", bare, *circle, "--set", zeros(bias))
    left = [b + v[0] for b, v in zip(bias, (values(result)[o] for o in OFFSETS))]
    _, after = bench.record("after", "sim", bare, *circle, "--set", f'control.model.mechanism="{calibrated}"', "--set", zeros(left))
    if before and after:
        b, a = before["tracking"]["settled_max_m"], after["tracking"]["settled_max_m"]
        expect(b > 12e-3 and a < 0.2e-3, f"closed loop: {b} m before, {a} m after")
        print(f"closed loop, max: {1e3 * b:.3g} mm before, {1e3 * a:.3g} mm after")
    # A log of a scene that names no encoders on a bus is written with those that it has.
    unnamed, _ = bench.record("unnamed", "sim", bare)
    bench.good(unnamed, "--half-base", 0.0505, "--write", bench.folder / "unnamed.toml")
    sensors = tomllib.loads((bench.folder / "unnamed.toml").read_text(encoding="utf-8"))["sensors"]
    expect(len(sensors["offset"]) == 2 and sensors["nodes"] == [3, 4], f"passive encoders: {sensors}")
    # What was written is what was printed, and a scene that stands by itself.
    run = bench.run("check", calibrated)
    expect(run.returncode == 0, f"the calibrated scene: {run.stderr}")
    text = calibrated.read_text(encoding="utf-8")
    shares = tomllib.loads(text)["uncertainty"]
    expect(all(0 < shares[k] < 1e-2 for k in ("l1", "l2")) and shares["half_base"] == 0, f"uncertainty of lengths: {shares}")
    for line in result["toml"].splitlines():
        expect(line in text, f"printed, but not written: {line}")
    expect("model" not in text, "the calibrated scene has no belief apart from itself")
    again = bench.good(out, "--scene", calibrated, "--half-base", 0.0505)
    # Its offsets go onto those the log was written with, so the lengths are what is found again.
    for name in ("leg 1 l1", "leg 2 l2"):
        expect(abs(values(again)[name][0] - values(result)[name][0]) < 1e-9, f"{name}: the start decides")


def arm(bench):
    """Without a loop: positions of the effector alone."""
    out, _ = bench.record("arm", "sim", bench.arm, "--set", 'effects=[{type="encoder", bits=16}, {type="bias", angle=[3e-3, -2e-3]}]',
                          "--set", "control.model={l1=1.01, l2=0.99}", "--set", "control.delay_ticks=2")
    rows, draw = rows_of(out), random.Random(3)
    readings = write_readings(bench.folder / "arm.csv", rows, range(50, 3200, 150), 5e-5, draw)
    found = values(bench.good(out, "--effector", readings, "--effector-sigma", "5e-5"))
    for name, truth in (("l1", 0.30), ("l2", 0.25), ("offset theta1", -3e-3), ("offset theta2", 2e-3)):
        value, sigma = found[name]
        expect(abs(value - truth) < 5 * sigma + 1e-5 and sigma < 1e-3, f"RR: {name} {value} +- {sigma}, true {truth}")
    bench.bad("has no loop", out)
    bench.bad("same unknown", out, "--effector", readings, "--free-frame")
    bench.bad("an RR arm has none", out, "--effector", readings, "--half-base", 0.1)
    two = write_readings(bench.folder / "two.csv", rows, (100, 700), 5e-5, draw)
    bench.bad("3 or more", out, "--effector", two)
    bench.bad("no column theta11_meas", out, "--scene", bench.nominal)
    return out


def four_starts(bench):
    """Four joint angles of the start close the loop of the drawing, not of what is found."""
    rows = rows_of(bench.record("drawing", "sim", bench.nominal, "--set", "simulation.duration=0.01")[0])
    mechanism = {"half_base": 0.05, "legs": [(0.1206, 0.1594), (0.1195, 0.1603)]}
    out, _ = bench.record("found", "sim", bench.true_scene("found", mechanism, [0.0] * 4))
    start = [rows[0][j] for j in ("theta11", "theta12", "theta21", "theta22")]
    scene, written = bench.folder / "four.toml", bench.folder / "four_found.toml"
    scene.write_text(bench.nominal.read_text(encoding="utf-8") + f"\n[initial]\njoints = {start!r}\n", encoding="utf-8")
    bench.good(out / "log.csv", "--scene", scene, "--trust-half-base", "--write", written)
    expect(tomllib.loads(written.read_text(encoding="utf-8"))["initial"]["joints"] == [start[0], start[2]], "two angles and the modes")


def hostile(bench):
    out, _ = bench.record("plain", "sim", bench.nominal)
    log = (out / "log.csv").read_text(encoding="utf-8").splitlines()
    place = bench.folder / "hostile.csv"

    def with_log(text, what, *more):
        place.write_text(text, encoding="utf-8")
        bench.bad(what, place, "--scene", bench.nominal, *more)

    head, known = log[0], ("--trust-half-base",)
    at = head.split(",").index("theta12_meas")
    torn = "\n".join(log)
    with_log(torn[:-7], "torn off", *known)
    with_log("", "hostile.csv:1: is empty", *known)
    with_log(head + "\n", "0 rows are too few", *known)
    with_log("\n".join(log[:150]) + "\n", "149 rows are too few", *known)
    with_log("\n".join(log[:500] + log[499:]) + "\n", "hostile.csv:501: the time must ascend", *known)
    for word in ("nan", "inf", "", "1.0x", "1e999"):
        fields = log[700].split(",")
        fields[at] = word
        with_log("\n".join(log[:700] + [",".join(fields)] + log[701:]) + "\n", "hostile.csv:701: theta12_meas must be a finite number", *known)
    with_log("\n".join(log[:700] + [log[700] + ",1"] + log[701:]) + "\n", "hostile.csv:701: ", *known)
    with_log("\n".join([head.replace("theta12_meas", "other")] + log[1:]) + "\n", "hostile.csv:1: there is no column theta12_meas", *known)
    with_log("\n".join([head.replace("theta22_meas", "theta12_meas")] + log[1:]) + "\n", "two columns theta12_meas", *known)

    # The drives' observers lag by what the motion does from row to row: rows that are not there would be a lag of nobody.
    gap = "\n".join(log[:700] + log[750:]) + "\n"
    with_log(gap, "hostile.csv:701: t = 1.498 s is 0.102 s after the row before", *known)
    with_log(gap, "--observer-bandwidth 0 takes rows as they are", *known)
    for step, digits in ((2, 9), (1, 4)):  # every second row; time as somebody has rounded it
        place.write_text("\n".join([head, *(f"{float(l.split(',', 1)[0]):.{digits}f},{l.split(',', 1)[1]}" for l in log[1::step])]) + "\n", encoding="utf-8")
        bench.good(place, "--scene", bench.nominal, *known)
    place.write_text(gap, encoding="utf-8")
    bench.good(place, "--scene", bench.nominal, *known, "--observer-bandwidth", "0")
    inside = write_readings(bench.folder / "inside.csv", rows_of(out), [300, 720, 1300], 2e-5, random.Random(3))
    with_log(gap, "is in a gap of the log, from 1.396 to 1.498 s", "--effector", inside, *known, "--observer-bandwidth", "0")

    bench.bad("but not its scale", out)
    bench.bad("there is no such log", bench.folder / "nowhere")
    bench.bad("no scene beside the log", place)
    bench.bad("must be a number > 0", out, "--half-base", "nan")
    bench.bad("must be a number > 0", out, "--half-base", "-0.05")
    bench.bad("is an input", out, "--trust-half-base", "--write", out / "scene.toml")
    bench.bad("it the log of this mechanism", out, "--half-base", "0.08")
    for content, what in (("t,x,y\n0.1,0.0,0.17\n", "too few"), ("x,y\n1,2\n", "no column t"), ("t,x,y\n9.0,0.0,0.17\n0.1,0,0\n", ":2: t = 9 s is outside"),
                          ("t,x,y\n0.1,nan,0.17\n", ":2: x must be")):
        (bench.folder / "readings.csv").write_text(content, encoding="utf-8")
        bench.bad(what, out, "--effector", bench.folder / "readings.csv")
    # Readings of another unit, in another frame, of another time; encoders that say nothing; observers that would hide all.
    good = write_readings(bench.folder / "good.csv", rows_of(out), range(100, 1900, 200), 2e-5, random.Random(3))
    bench.good(out, "--effector", good, "--trust-half-base")
    for how, what in ((lambda t, x, y: (t, 1e3 * x, 1e3 * y), "m from the base"), (lambda t, x, y: (t, x + 0.02, y), "--effector-sigma"),
                      (lambda t, x, y: (t - 0.05, x, y), "--effector-sigma"), (lambda t, x, y: (t, 1e300, 1e300), "m from the base")):
        lines = good.read_text(encoding="utf-8").splitlines()
        place.write_text("\n".join(lines[:1] + [",".join(repr(v) for v in how(*map(float, l.split(",")))) for l in lines[1:]]) + "\n", encoding="utf-8")
        bench.bad(what, out, "--effector", place, "--trust-half-base")
    for word in ("0", "1e300"):
        dead = [log[0]] + [",".join(l.split(",")[:at] + [word] + l.split(",")[at + 1:]) for l in log[1:]]
        for more in ((), ("--keep-nominal",)):
            with_log("\n".join(dead) + "\n", "is it the log of this mechanism", *known, *more)
    bench.bad("no lengths near the nominal ones fit it even roughly", out, "--half-base", "1e300")
    bench.bad("is it the log of this mechanism", out, *known, "--observer-bandwidth", "1")
    bench.bad("must be 0, or 1 to 1e6", out, *known, "--observer-bandwidth", "nan")
    # An encoder slips in the middle: that is told, not the motion blamed.
    slipped = [log[0]] + [",".join(f[:at] + [repr(float(f[at]) + (0.05 if i > len(log) // 2 else 0.0))] + f[at + 1:])
                          for i, f in enumerate(l.split(",") for l in log[1:])]
    with_log("\n".join(slipped) + "\n", "did an encoder slip", *known)
    # Another mechanism's angles fit no lengths.
    shuffled = [log[0]] + [",".join(l.split(",")[:at] + [str(math.sin(3.7 * i * i))] + l.split(",")[at + 1:]) for i, l in enumerate(log[1:])]
    with_log("\n".join(shuffled) + "\n", "is it the log of this mechanism?", *known)
    # Lengths that are not those of the scene at all.
    large = bench.folder / "large.toml"
    large.write_text(bench.nominal.read_text(encoding="utf-8").replace("l1 = 0.12,", "l1 = 0.16,"), encoding="utf-8")
    bench.bad("from the nominal 0.16 m: is it the log of this mechanism?", out, "--trust-half-base", "--scene", large)
    bench.good(out, "--trust-half-base", "--scene", large, "--within", "0.5")

    # Not exciting: at rest, with encoders that flicker; and one leg's combination left out.
    rest, _ = bench.record("rest", "sim", bench.nominal, "--set", 'reference={type="hold"}', "--set", "initial.position=[0.0, 0.17]",
                           "--set", 'effects=[{type="noise", sigma=3e-5}]')
    bench.bad("does not determine", rest, "--trust-half-base")
    kept = bench.good(rest, "--trust-half-base", "--keep-nominal")
    expect(len(kept["kept_nominal"]) >= 5, f"at rest: {kept['kept_nominal']}")
    for u in kept["unknowns"]:
        expect(abs(u["value"] - u["nominal"]) < 2e-3 * max(1.0, abs(u["nominal"])), f"invented: {u}")
    small, _ = bench.record("small", "sim", bench.nominal, "--set", "reference.amplitude=[0.003, 0.003]")
    bench.bad("does not determine", small, "--trust-half-base")
    # What leans on nominal values is no better than they are: a length that is 1 per mille off, and a motion that shows little of it.
    mechanism = {"half_base": 0.05, "legs": [(0.12012, 0.16), (0.12, 0.16)]}
    little, _ = bench.record("little", "sim", bench.true_scene("little_truth", mechanism, [0.0] * 4), "--set", "effects=[{type='encoder', bits=16}]",
                             "--set", 'reference={type="circle", center=[0.0, 0.2], radius=0.003, speed=5}')
    kept = bench.good(little, "--scene", bench.nominal, "--trust-half-base", "--keep-nominal")
    expect(kept["kept_nominal"], "a motion of 3 mm determines nothing less than all")
    true = dict(zip(("leg 1 l1", "leg 1 l2", "leg 2 l1", "leg 2 l2"), (0.12012, 0.16, 0.12, 0.16)))
    for u in kept["unknowns"]:
        beside = u["value"] - true.get(u["name"], 0.05 if u["name"] == "half_base" else 0.0)
        expect(abs(beside) <= 3 * u["sigma"], f"promised better than it is: {u}, beside by {beside}")
    moved = max(abs(effector(0.05, mechanism["legs"], r["theta11"], r["theta21"], complex(r["x"], r["y"]))
                    - effector(0.05, [(v["leg 1 l1"], v["leg 1 l2"]), (v["leg 2 l1"], v["leg 2 l2"])], r["theta11"] + v["offset theta11"],
                               r["theta21"] + v["offset theta21"], complex(r["x"], r["y"])))
                for v in [{u["name"]: u["value"] for u in kept["unknowns"]}] for r in rows_of(little)[::20])
    expect(moved <= 3 * kept["effector"]["sigma_m"], f"effector beside by {moved}, promised {kept['effector']}")
    scale = write_readings(bench.folder / "same.csv", rows_of(out), (300, 301), 1e-5, random.Random(1), (complex(0.1, 0), 0.3))
    bench.bad("does not determine", out, "--effector", scale, "--free-frame")  # two readings of the same point


def fusion(bench):
    """The wrong encoder is named, by every way to run; the key is for four encoders only; an image has the part only if named."""
    scene = bench.nominal.parent / "five_bar_fusion.toml"
    for joint, name in enumerate(("theta11", "theta12", "theta21", "theta22")):
        for size in (-0.5, -0.2, -0.1, 0.1, 0.2, 0.5):  # a slipped coupling, a lost tooth: never a wrong name
            bias = [size if i == joint else 0.0 for i in range(4)]
            run = bench.run("sim", scene, "--json", "--set", "limits.closure=0.01", "--set",
                            f'effects=[{{type="noise", sigma=3e-4}}, {{type="bias", angle={bias}}}]')
            told = json.loads(run.stdout)["supervisor"] if run.stdout else {}
            expect([f["name"] for f in told.get("faults", [])] == ["loop_not_closed"] and told.get("odd_encoder") == name, f"{name} is off by {size}: {told}")
        bias = [0.04 if i == joint else 0.0 for i in range(4)]
        wrong = ["--set", f'effects=[{{type="bias", angle={bias}}}]', "--json"]
        run = bench.run("sim", scene, *wrong)
        told = json.loads(run.stdout)["supervisor"] if run.stdout else {}
        expect(run.returncode == 1 and [f["name"] for f in told.get("faults", [])] == ["loop_not_closed"] and told.get("odd_encoder") == name, f"{name} is off: {told}")
        run = bench.run("hil", scene, *wrong)
        expect(run.returncode == 1 and f"the encoder of {name} contradicts" in run.stderr, f"hil, {name} is off: {run.stderr}")
        run = bench.run("sim", scene, *wrong, "--set", "limits.closure=0.05")
        expect(run.returncode == 0 and "odd_encoder" not in run.stdout, f"{name} is off, within the limit: {run.stderr}")
    for what, change in (("encoder_sigma", "control.encoder_sigma=0.0"), ("encoder_sigma", "control.encoder_sigma=[1e-4, 1e-4]")):
        bench.refused(bench.run("sim", scene, "--set", change), what)
    bench.refused(bench.run("sim", bench.arm, "--set", "control.encoder_sigma=1e-4"), "is for a five_bar")
    fused, plain = bench.run("bake", scene), bench.run("bake", bench.nominal)
    expect("part::closure_projection" in fused.stdout and "part::" not in plain.stdout and plain.returncode == 0, "the part in a baked scene")


if __name__ == "__main__":
    main(Bench, accuracy, table, eccentric, closed_loop, arm, fusion, four_starts, hostile)
