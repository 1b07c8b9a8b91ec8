"""Hard cases of the five-bar and of its control, judged by golden data, by arithmetic of 50 digits and by a model of the tests' own."""
import json
import math
import struct
from decimal import Decimal, getcontext
from fractions import Fraction

from run import ROOT, SCENES, column, digits
from usual import FiveBar, march, rk4, solve

getcontext().prec = 50
CIRCLE = SCENES / "five_bar_circle.toml"
FALL = [0.33914579427821183820, 1.85318013531281830819, 1.31276054418215195822, 1.48475269532538599760]  # start of problem B4
FREE = ["control.law=none", 'reference={type="hold"}', f"initial.joints={FALL}"]


def joints(row):
    return [row[n] for n in ("theta11", "theta12", "theta21", "theta22")]


def closure_drift(program):
    """Ten seconds of free motion, through every singularity on its way."""
    plant = FiveBar()
    begin = plant.from_joints(FALL) + [0.0] * 4
    rows = program.rows(CIRCLE, *FREE, "simulation.duration=10", "simulation.step=1e-3")
    gap = lambda a: math.hypot(*plant.gap(a))
    ours = [(r["t"], gap(plant.from_joints(joints(r)))) for r in rows]
    plain = [(t, gap(y[:4])) for t, y in march(plant.free(), begin, 10.0, 1e-3)]
    baumgarte = [(t, gap(y[:4])) for t, y in march(plant.free(100.0), begin, 10.0, 1e-3)]
    return {"ours": max(v for _, v in ours), "usual": max(v for _, v in baumgarte),
            "curves": [("nothing", digits(plain)), ("projection", digits(ours)), ("Baumgarte, 100 1/s", digits(baumgarte))]}


# Problem B4 at 0.25 s in quadruple precision: x, y, theta11, theta12, theta21, theta22.
GOLDEN_FALL = (-0.01349935527164578566, 0.06458494073116901118, -2.22637410112360593504, 3.73679171077824686325, 0.18873371917602579560,
               2.68678616236967082441)


def fall(program):
    """Falls through type 1 at 0.2 s and type 2 later."""
    golden = program.summary(CIRCLE, *FREE, "simulation.duration=0.25", "simulation.accuracy=1e-10")["final_state"]["q"]
    summary, rows = program.summary(CIRCLE, *FREE, "simulation.duration=1", "simulation.step=1e-4", log=True)
    if summary["energy"]["relative_error"] > 1e-9:
        golden = [math.nan] * 6
    plant = FiveBar()
    a = plant.from_joints(FALL)
    minimal = march(plant.minimal(-1), [a[0], a[2], 0.0, 0.0], 1.0, 1e-4, lambda y: max(map(abs, y)) < 1e4)
    height = lambda y: plant.bar["l1"] * math.sin(y[0]) + plant.bar["l2"] * math.sin(plant.passive(y[0], y[1], -1)[0])
    lost = minimal[-1][0] < 0.99
    return {"ours": max(abs(a - b) for a, b in zip(golden, GOLDEN_FALL)), "usual": math.inf if lost else 0.0,
            "curves": [("dependent coordinates", column(rows, "y")), ("two base angles alone", [(t, height(y)) for t, y in minimal])]}


def relative(got, want):
    flat = lambda v: [float(x) for item in v for x in (item if isinstance(item, list) else [item])]
    got, want = flat(got), flat(want)
    return math.sqrt(sum((g - w)**2 for g, w in zip(got, want)) / sum(w * w for w in want))


def near_type1(program):
    """Accelerations at poses ever nearer to a stretched leg, against golden data of 25 digits."""
    file = ROOT / "tests/reference/fiver_near_type1.json"
    golden = json.loads(file.read_text(encoding="utf-8"))["cases"]
    ours, usual = [], []
    for case, got in zip(golden, program.eval(file)["cases"]):
        near = math.log10(min(abs(case["singularity"]["sin_theta12"]), abs(case["singularity"]["sin_theta22"])))
        ours.append((near, relative(got["forward"]["pdot"], case["forward"]["pdot"])))
        usual.append((near, case["double_ref"]["forward_xdd"]))
    return {"ours": max(v for _, v in ours), "usual": max(v for _, v in usual),
            "curves": [("base-joint form", digits(sorted(ours))), ("(x, y) form in double", digits(sorted(usual)))]}


def exact_lift(angle, bar, base):
    """Symmetric pose of given base angle: half distance of the elbows, height of the effector above them, in 50 digits."""
    c, term = Decimal(0), Decimal(1)
    x = Decimal(Fraction(angle).numerator) / Decimal(Fraction(angle).denominator)
    for n in range(1, 60):
        c += term
        term *= -x * x / ((2 * n - 1) * (2 * n))
    half = Decimal(str(base)) + Decimal(str(bar["l1"])) * c
    return half, (Decimal(str(bar["l2"]))**2 - half**2).sqrt()


def newton(plant, a1, b1, guess, residual):
    """The usual assembly: Newton's iteration on closure from a pose nearby, until the gap is below the residual."""
    a = [a1, guess[0], b1, guess[1]]
    for _ in range(100):
        gap = plant.gap(a)
        if math.hypot(*gap) < residual:
            break
        jac = plant.jacobian(a)
        step = solve([[jac[0][1], jac[0][3]], [jac[1][1], jac[1][3]]], [-g for g in gap])
        if step is None:
            return a
        a[1], a[3] = a[1] + step[0], a[3] + step[1]
    return a


def assembly(program):
    """Assembly at poses ever nearer to type 2, where the two solutions meet; error times |D2|, which is the pose's own condition."""
    plant = FiveBar()
    l1, l2, base = plant.bar["l1"], plant.bar["l2"], plant.base
    ours, usual, weighed = [], [], []
    for k in range(1, 8):
        lift = 0.5 * 10.0**-k  # D2 = 2 sin cos of the distal bar
        angle = math.acos((l2 * math.sqrt(1.0 - lift * lift) - base) / l1)
        half, up = exact_lift(angle, plant.bar, base)
        truth = math.atan2(float(up), -float(half))  # of leg 1's distal bar; its mirror image in leg 2
        near = 2 * float(up * half) / l2**2
        row = program.rows(CIRCLE, "control.law=none", 'reference={type="hold"}', f"initial.joints=[{angle!r}, {angle!r}]",
                           "limits.min_abs_sin_type2=0", "simulation.duration=1e-3")[0]
        off = abs(row["theta11"] + row["theta12"] - truth)
        a = newton(plant, angle, math.pi - angle, (truth - 0.05, math.pi - truth + 0.05), 1e-10)
        ours.append((math.log10(near), off))
        weighed.append(off * near)
        usual.append((math.log10(near), abs(a[1] - truth)))
    return {"ours": max(weighed), "usual": max(10.0**t * v for t, v in usual),
            "curves": [("closed form", digits(sorted(ours))), ("Newton to 1e-10 m", digits(sorted(usual)))]}


def light_bars(program):
    """Free motion of an effector of 0.1 kg on bars of a microgram."""
    light = {"m1": 1e-9, "m2": 1e-9, "J1": 2e-12, "J2": 7e-12}
    leg = "mechanism.leg={l1=0.12, l2=0.16, lg1=0.06, lg2=0.068, " + ", ".join(f"{k}={v}" for k, v in light.items()) + "}"
    plant, end = FiveBar(effector=0.1, **light), 0.15
    begin = plant.from_joints(FALL) + [0.0] * 4
    rows = program.rows(CIRCLE, *FREE, leg, "mechanism.effector_mass=0.1", f"simulation.duration={end}", "simulation.accuracy=1e-9",
                        'simulation.accuracy_of="trajectory"')
    truth = {round(t, 9): y[0] for t, y in march(plant.free(), begin, end, 2e-4)}
    penalty = march(plant.penalty(1e3, 0.0), begin, end, 1e-3)
    return {"ours": max(abs(r["theta11"] - truth[round(r["t"], 9)]) for r in rows),
            "usual": math.inf if penalty[-1][0] < end - 1e-9 else max(abs(y[0] - truth[round(t, 9)]) for t, y in penalty),
            "curves": [("reference", sorted(truth.items())), ("multipliers", column(rows, "theta11")), ("closure by a spring", [(t, y[0]) for t, y in penalty])]}


def ill_posed(program):
    """Ten seconds of chaotic free motion: what two answers of one method, both called good, differ by. The program must refuse."""
    sets = [*FREE, "simulation.duration=10"]
    accepted = [a for a in (1e-2, 1e-4, 1e-6) if program.refusal(CIRCLE, *sets, f"simulation.accuracy={a}").find("ill_posed") < 0]
    coarse, fine = (program.rows(CIRCLE, *sets, f"simulation.step={h}") for h in (1e-3, 5e-4))
    shown = [(label, column(rows, "theta21", 0, 5)) for label, rows in (("RK4 at 0.5 ms", fine), ("RK4 at 1 ms", coarse))]
    return {"ours": math.inf if accepted else 0.0, "usual": max(abs(a["theta21"] - b["theta21"]) for a, b in zip(coarse, fine)), "curves": shown}


def circle_torque(t):
    """Base torques that the reference of the circle scene needs, by inverse dynamics of the tests' model; the program's signs."""
    plant, speed, radius = FiveBar(), 10.0, 0.07
    c, s = math.cos(speed * t), math.sin(speed * t)
    path = ((radius * c, 0.17 + radius * s), (-radius * speed * s, radius * speed * c), (-radius * speed**2 * c, -radius * speed**2 * s))
    return minimum_norm(plant, *bars_of(plant, *path), motors=(0, 2))


def bars_of(plant, at, v, acc):
    """Bar angles, rates, accelerations of an effector's motion, elbows outwards."""
    l1, l2 = plant.bar["l1"], plant.bar["l2"]
    angle, rate, second = [], [], []
    for base, side in ((plant.base, 1.0), (-plant.base, -1.0)):
        dx, dy = at[0] - base, at[1]
        r = math.hypot(dx, dy)
        p = math.atan2(dy, dx) - side * math.acos((l1 * l1 + r * r - l2 * l2) / (2 * l1 * r))
        q = math.atan2(dy - l1 * math.sin(p), dx - l1 * math.cos(p))
        jac = lambda: [[-l1 * math.sin(p), -l2 * math.sin(q)], [l1 * math.cos(p), l2 * math.cos(q)]]
        w = solve(jac(), list(v))
        bend = [acc[0] + l1 * math.cos(p) * w[0]**2 + l2 * math.cos(q) * w[1]**2, acc[1] + l1 * math.sin(p) * w[0]**2 + l2 * math.sin(q) * w[1]**2]
        angle, rate, second = angle + [p, q], rate + w, second + solve(jac(), bend)
    return angle, rate, second


def minimum_norm(plant, a, w, acc, motors=(0, 1, 2, 3)):
    """Torques of the motors for the acceleration, of least norm; counter-clockwise."""
    m, r = plant.mass_and_force(a, w)
    need = [sum(x * y for x, y in zip(row, acc)) - f for row, f in zip(m, r)]
    joint = lambda f: [f[0] + f[1], f[1], f[2] + f[3], f[3]]  # bar moments to joint torques
    jac = plant.jacobian(a)
    fixed, free = joint(need), [joint(row) for row in jac]
    idle = [k for k in range(4) if k not in motors] or list(range(4))
    if len(idle) == 4:  # least squares over the two multipliers
        normal = [[sum(x * y for x, y in zip(g, h)) for h in free] for g in free]
        mu = solve(normal, [-sum(x * y for x, y in zip(g, fixed)) for g in free])
    else:  # the idle joints have no torque
        mu = solve([[free[0][k], free[1][k]] for k in idle], [-fixed[k] for k in idle])
    return [fixed[k] + mu[0] * free[0][k] + mu[1] * free[1][k] for k in range(4)]


def change(points):
    return sum(abs(b[1] - a[1]) for a, b in zip(points, points[1:])) / (len(points) - 1)


def torque_case(program, usual_sets, ours_sets, labels):
    """Change of torque per tick after 0.3 s, in multiples of what the motion itself needs."""
    runs = [column(program.rows(CIRCLE, "simulation.duration=1", *sets), "tau11", 0.3) for sets in (ours_sets, usual_sets)]
    need = [(t, circle_torque(t)[0]) for t, _ in runs[0]]
    window = lambda points: [(t, v) for t, v in points if 0.5 <= t <= 0.6]
    ours, usual = (change(r) / change(need) for r in runs)
    return {"ours": ours, "usual": usual, "curves": [("needed", window(need)), (labels[0], window(runs[0])), (labels[1], window(runs[1]))]}


def sign_chatter(program):
    return torque_case(program, ["control.reaching=sign"], ["control.reaching=implicit"], ("implicit", "sign(s)"))


def delay(program):
    late = 'effects=[{type="compute_delay", time=2e-3}]'
    return torque_case(program, [late, "control.delay_ticks=0"], [late, "control.delay_ticks=2"], ("delay_ticks = 2", "delay_ticks = 0"))


def type2_two_motors(program):
    sets = ["control.motors=base", "control.torque_limit=2", "drives.nodes=[1,2]", "sensors.nodes=[3,4]"]
    ours, ours_rows = program.summary(SCENES / "five_bar_type2.toml", *sets, log=True)
    usual, usual_rows = program.summary(SCENES / "five_bar_type2.toml", *sets, "limits.min_abs_sin_type2=0", log=True)
    named = [f["name"] for f in ours["supervisor"]["faults"]] == ["type2_singularity"]
    return {"ours": ours["torque"]["saturated_ticks"] if named else math.inf, "usual": usual["torque"]["saturated_ticks"],
            "curves": [("limit on D2 of 0.05", column(ours_rows, "tau11", 0.28, 0.36)), ("none", column(usual_rows, "tau11", 0.28, 0.36))]}


def clipped_loop(limit):
    """The line through type 2 under computed torque, four motors, torques of least norm clipped at the limit: (t, error in mm, torque)."""
    plant, tick, rate, out = FiveBar(), 2e-3, 40.0, []
    a, w, _ = bars_of(plant, (0.0, 0.13), (0.0, 0.0), (0.0, 0.0))
    y = a + w
    tip = lambda y: (plant.base + 0.12 * math.cos(y[0]) + 0.16 * math.cos(y[1]), 0.12 * math.sin(y[0]) + 0.16 * math.sin(y[1]))
    for n in range(300):
        s = n / 300.0
        at, v, acc = (0.13 * (1 - s**3 * (10 - 15 * s + 6 * s * s)), -0.13 / 0.6 * 30 * s * s * (1 - s)**2,
                      -0.13 / 0.36 * 60 * s * (1 - s) * (1 - 2 * s))
        x, z = tip(y)
        vx = -0.12 * math.sin(y[0]) * y[4] - 0.16 * math.sin(y[1]) * y[5]
        vy = 0.12 * math.cos(y[0]) * y[4] + 0.16 * math.cos(y[1]) * y[5]
        wanted = (-2 * rate * vx - rate**2 * x, acc + 2 * rate * (v - vy) + rate**2 * (at - z))
        try:
            torque = minimum_norm(plant, *bars_of(plant, (x, z), (vx, vy), wanted))
        except ValueError:
            break
        torque = [max(-limit, min(limit, u)) for u in torque]
        out.append((n * tick, 1e3 * math.hypot(x, z - at), torque[0]))
        for _ in range(2):
            y = rk4(lambda _, s: s[4:] + plant.acceleration(s[:4], s[4:], torque, 100.0), 0.0, y, tick / 2)
    return out


def four_motors(program):
    """Limits just above what the line through type 2 needs."""
    rows = program.rows(SCENES / "five_bar_type2.toml", "control.torque_limit=0.075", "simulation.duration=0.6")
    off = [(r["t"], 1e3 * math.hypot(r["x"] - r["x_ref"], r["y"] - r["y_ref"])) for r in rows]
    usual = [(t, e) for t, e, _ in clipped_loop(0.075)]
    free = [(t, e) for t, e, _ in clipped_loop(1.0)]
    return {"ours": max(v for _, v in off), "usual": max(v for _, v in usual),
            "curves": [("least norm, no limits", digits(free[1:])), ("within limits", digits(off[1:])), ("least norm, clipped", digits(usual[1:]))]}


def single(x):
    return struct.unpack("f", struct.pack("f", x))[0]


def float_clock(program):
    """A reference in 32-bit floats after days: ours is printed by float_clock.cpp, which is the controller's own code."""
    turn = 2 * Decimal("3.14159265358979323846264338327950288419716939937511")
    ours, usual = {}, {}
    for n, line in enumerate(program.beside("tests/float_clock").split()):
        tick, *at = map(float, line.split(","))
        phase = float(Decimal(int(tick)) * Decimal("0.01") % turn)
        exact = 0.07 * math.cos(phase), 0.17 + 0.07 * math.sin(phase)
        naive = single(10.0 * single(single(tick) * single(1e-3)))
        other = single(0.07 * math.cos(naive)), single(0.17 + 0.07 * math.sin(naive))
        seconds = math.log10((tick - n % 20) * 1e-3)  # the worst of each twenty ticks
        ours[seconds] = max(ours.get(seconds, 0.0), math.dist(at, exact))
        usual[seconds] = max(usual.get(seconds, 0.0), math.dist(other, exact))
    return {"ours": max(ours.values()), "usual": max(usual.values()),
            "curves": [("phase in 2^-64 turns", digits(sorted(ours.items()))), ("time in float", digits(sorted(usual.items())))]}
