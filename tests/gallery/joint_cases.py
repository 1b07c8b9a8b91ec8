"""Hard cases of one joint, judged by closed forms. Each returns what the program reaches, what the usual method reaches, and curves."""
import math

from run import SCENES, WHEEL, column, digits, worst
from usual import Arm, march, rk4

INERTIA = 1e-3  # kg m2, of the wheel
ARM = {"l1": 0.30, "l2": 0.25, "lg1": 0.15, "lg2": 0.11, "m1": 1.2, "m2": 0.8, "J1": 1e-2, "J2": 4.5e-3}  # of rr_line.toml


def sine_torque(amp, omega):
    return f"control.torque=[{{offset=0.0, terms=[{{amp={amp}, omega={omega}}}]}}, {{offset=0.0, terms=[]}}]"


def constant_torque(value):
    return f"control.torque=[{{offset={value}, terms=[]}}, {{offset=0.0, terms=[]}}]"


def effect(text):
    return "effects=[{" + text + "}]"


def spring(stiffness, damping, rotor):
    """A gear spring at joint 1; that of joint 2 is so soft that it passes nothing."""
    return f'type="joint_flexibility", stiffness=[{stiffness}, 1e-15], damping=[{damping}, 0.0], rotor_inertia={rotor}'


def root(f, low, high):
    """Where f changes its sign, by bisection to rounding."""
    positive = f(low) > 0.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if (f(middle) > 0.0) == positive else (low, middle)
    return 0.5 * (low + high)


class Pieces:
    """A motion in pieces, each a function of t that returns (angle, rate)."""

    def __init__(self):
        self.pieces = []

    def add(self, begin, motion):
        self.pieces.append((begin, motion))

    def __call__(self, t):
        return next(motion for begin, motion in reversed(self.pieces) if begin <= t)(t)


def stick_slip_exact(amp, omega, friction, end):
    """Wheel under amp sin(omega t) with dry friction, from rest."""
    out, t, angle, scan = Pieces(), 0.0, 0.0, 1e-5
    while t < end:
        out.add(t, lambda _, angle=angle: (angle, 0.0))  # it holds until the torque exceeds the friction
        excess = lambda u: abs(amp * math.sin(omega * u)) - friction
        while excess(t) <= 0.0 and t < end:
            t += scan
        begin = root(excess, t - scan, t) if excess(t - scan) <= 0.0 else t
        way = math.copysign(1.0, amp * math.sin(omega * t))

        def slip(u, begin=begin, way=way, angle=angle):
            d, wave = u - begin, amp / omega
            rate = (wave * (math.cos(omega * begin) - math.cos(omega * u)) - way * friction * d) / INERTIA
            turned = wave * (math.cos(omega * begin) * d - (math.sin(omega * u) - math.sin(omega * begin)) / omega)
            return angle + (turned - way * friction * d * d / 2) / INERTIA, rate
        out.add(begin, slip)
        t = begin + scan
        while way * slip(t)[1] > 0.0 and t < end:
            t += scan
        t = root(lambda u: slip(u)[1], t - scan, t) if t < end else end
        angle = slip(t)[0]
    return out


def stick_slip(program):
    amp, omega, friction = 0.08, 20.0, 0.05
    exact = stick_slip_exact(amp, omega, friction, 1.0)
    ours = program.rows(WHEEL, sine_torque(amp, omega), effect(f'type="coulomb_friction", torque=[{friction}, 0.0]'),
                        "simulation.duration=1", "simulation.accuracy=1e-8", 'simulation.accuracy_of="trajectory"')
    sign = lambda w: (w > 0) - (w < 0)
    usual = march(lambda t, y: [y[1], (amp * math.sin(omega * t) - friction * sign(y[1])) / INERTIA], [0.0, 0.0], 1.0, 1e-3)
    shown = 0.168, 0.2
    return {"ours": worst(column(ours, "theta1"), lambda t: exact(t)[0]), "usual": max(abs(y[0] - exact(t)[0]) for t, y in usual),
            "curves": [("exact", [(t, exact(t)[1]) for t, _ in usual if shown[0] <= t <= shown[1]]),
                       ("event_driven", column(ours, "theta1_rate", *shown)),
                       ("RK4 with sign(rate)", [(t, y[1]) for t, y in usual if shown[0] <= t <= shown[1]])]}


def arm_friction(program):
    """The arm falls; dry friction in both joints."""
    friction, golden = (0.5, 0.2), (-2.158441, -0.707371)
    arm = Arm(9.8, **ARM)
    sets = ["control.law=none", 'reference={type="hold"}', "initial.joints=[0.3, 0.7]", "simulation.duration=1.001",
            effect(f'type="coulomb_friction", torque={list(friction)}'), 'simulation.accuracy_of="trajectory"']
    ours, fine = (program.rows(SCENES / "rr_line.toml", *sets, f"simulation.accuracy={asked}") for asked in (1e-6, 1e-9))

    def motion(_, y):
        rates = y[2], y[3] - y[2]
        f1, f2 = (f * ((w > 0) - (w < 0)) for f, w in zip(friction, rates))
        return arm.acceleration(y, f2 - f1, -f2)
    usual = march(motion, [0.3, 1.0, 0.0, 0.0], 1.0, 1e-3)
    end, y = ours[1000], usual[-1][1]
    off = [(f["t"], (r["theta1"] - f["theta1"], r["theta2"] - f["theta2"])) for r, f in zip(ours, fine)]
    usual_off = [(t, (y[0] - f["theta1"], y[1] - y[0] - f["theta2"])) for (t, y), f in zip(usual, fine)]
    return {"ours": max(abs(end["theta1"] - golden[0]), abs(end["theta2"] - golden[1])),
            "usual": max(abs(y[0] - golden[0]), abs(y[1] - y[0] - golden[1])),
            "curves": [(label, digits([(t, max(map(abs, v))) for t, v in points[1:]])) for label, points in
                       (("event_driven", off), ("RK4 with sign(rate)", usual_off))]}


def breakaway(program):
    """The torque rises to 0.06 N m within a minute; friction holds 0.05."""
    amp, omega, friction = 0.06, math.pi / 120.0, 0.05
    slips = math.asin(friction / amp) / omega
    sets = [sine_torque(amp, omega), f"simulation.duration={math.ceil(slips) + 0.5}"]
    ours = program.rows(WHEEL, *sets, effect(f'type="coulomb_friction", torque=[{friction}, 0.1]'), "simulation.accuracy=1e-6")
    soft = effect(f'type="coulomb_friction", torque=[{friction}, 0.1], regularised=1e-2')
    usual = program.rows(WHEEL, *sets, soft, "simulation.step=2.5e-4")
    moved = lambda rows: max(abs(r["theta1"]) for r in rows if r["t"] <= slips)
    started = next(r["t"] for r in ours if r["theta1_rate"] != 0.0)
    return {"ours": moved(ours) if abs(started - slips) <= 1e-3 else math.inf, "usual": moved(usual),
            "curves": [("event_driven", column(ours, "theta1", 0, slips)), ("tanh(rate / 0.01)", column(usual, "theta1", 0, slips))]}


def accumulation_exact(t):
    """Bounces between a torque of 10 rad/s2 and a stop of restitution 1/2, from the stop at 1 rad/s: at rest after 0.4 s."""
    begin, speed = 0.0, 1.0
    while t >= begin + 2 * speed / 10.0:
        begin, speed = begin + 2 * speed / 10.0, speed / 2
        if speed < 1e-17:
            return 0.5
    return 0.5 - speed * (t - begin) + 5.0 * (t - begin)**2


def accumulation(program):
    stops = 'type="end_stops", lower=[-1.0, -9.0], upper=[0.5, 9.0], restitution=0.5'
    sets = [constant_torque(0.01), "initial.joints=[0.5, 1.0]", "initial.joint_rates=[-1.0, 1.0]", "simulation.duration=0.6"]
    ours = program.rows(WHEEL, *sets, effect(stops), "simulation.accuracy=1e-8", 'simulation.accuracy_of="trajectory"')
    usual = program.rows(WHEEL, *sets, effect(stops + ", stiffness=2000.0"), "simulation.step=1e-3")
    at_rest = all(r["theta1_rate"] == 0.0 for r in ours if r["t"] > 0.401)
    return {"ours": worst(column(ours, "theta1"), accumulation_exact) if at_rest else math.inf,
            "usual": worst(column(usual, "theta1"), accumulation_exact),
            "curves": [("exact", [(r["t"], accumulation_exact(r["t"])) for r in ours]), ("event_driven", column(ours, "theta1")),
                       ("spring of 2000 N m/rad, RK4", column(usual, "theta1"))]}


class Play:
    """Rotor and wheel with play between them, no friction: twist in closed form between contacts; the start is in mid-gap at rest."""
    rotor, gap, stiffness = 1e-4, 0.02, 200.0

    def __init__(self, amp, omega, end):
        self.amp, self.omega, self.twist = amp, omega, Pieces()
        t, x, v, scan = 0.0, 0.0, 0.0, 2e-5
        while t < end:
            flank = (x > 0) - (x < 0) if abs(x) >= 0.5 * self.gap - 1e-12 and x * v > 0 else 0
            piece = self.piece(t, x, v, flank)
            self.twist.add(t, piece)
            inside = lambda u, piece=piece: 0.5 * self.gap - abs(piece(u)[0])
            u = t + scan
            while u < end and (inside(u) > 0.0) == (flank == 0):
                u += scan
            if u >= end:
                break
            t = root(inside, u - scan, u)
            x, v = piece(t)
            x = math.copysign(0.5 * self.gap, x)

    def piece(self, t0, x0, v0, flank):
        """x'' = (amp / rotor) sin(omega t) - w2 (x - flank gap / 2), w2 = 0 in the gap."""
        drive, omega, rest = self.amp / self.rotor, self.omega, 0.5 * flank * self.gap
        w2 = self.stiffness * (1 / self.rotor + 1 / INERTIA) if flank else 0.0
        forced = drive / (w2 - omega * omega)
        a = x0 - rest - forced * math.sin(omega * t0)
        b = v0 - forced * omega * math.cos(omega * t0)
        w = math.sqrt(w2)

        def motion(t):
            d, s, c = t - t0, forced * math.sin(omega * t), forced * omega * math.cos(omega * t)
            if not flank:
                return a + b * d + s, b + c
            return rest + a * math.cos(w * d) + b / w * math.sin(w * d) + s, b * math.cos(w * d) - a * w * math.sin(w * d) + c
        return motion

    def centre(self, t):
        """Common centre of inertia, which the torque alone moves."""
        return self.amp / (self.rotor + INERTIA) * (t / self.omega - math.sin(self.omega * t) / self.omega**2)

    def wheel(self, t):
        return self.centre(t) - self.rotor / (self.rotor + INERTIA) * self.twist(t)[0]

    def twist_of(self, t, wheel):
        """Rotor less wheel in mrad, of the wheel's angle alone."""
        return 1e3 * (self.centre(t) - wheel) * (self.rotor + INERTIA) / self.rotor


def backlash(program):
    amp, omega, end = 0.05, 30.0, 0.4
    exact = Play(amp, omega, end + 0.01)
    gear = spring(Play.stiffness, 0.0, Play.rotor) + f'}}, {{type="backlash", gap={Play.gap}'
    sets = [sine_torque(amp, omega), effect(gear), f"simulation.duration={end}"]
    ours = program.rows(WHEEL, *sets, "simulation.accuracy=1e-8", 'simulation.accuracy_of="trajectory"')
    usual = program.rows(WHEEL, *sets, "simulation.step=1e-3")
    return {"ours": worst(column(ours, "theta1"), exact.wheel), "usual": worst(column(usual, "theta1"), exact.wheel),
            "curves": [("exact", [(r["t"], 1e3 * exact.twist(r["t"])[0]) for r in ours if r["t"] >= 0.2])] +
            [(label, [(r["t"], exact.twist_of(r["t"], r["theta1"])) for r in rows if r["t"] >= 0.2])
             for label, rows in (("event_driven", ours), ("RK4 through the corners", usual))]}


def gear_spring(program):
    """A step of torque on the rotor behind a stiff gear spring with damping: two exponentials, complex ones."""
    rotor, stiffness, damping, tau = 1e-4, 1e6, 1.0, 0.1
    w2, decay = stiffness * (1 / rotor + 1 / INERTIA), damping * (1 / rotor + 1 / INERTIA) / 2
    swing, both = math.sqrt(w2 - decay * decay), rotor + INERTIA

    def twist(t):
        rest = tau / rotor / w2
        return rest - rest * math.exp(-decay * t) * (math.cos(swing * t) + decay / swing * math.sin(swing * t))
    exact = lambda t: tau / both * t * t / 2 - rotor / both * twist(t)
    gear = spring(stiffness, damping, rotor)
    ours = program.rows(WHEEL, constant_torque(tau), effect(gear), "simulation.duration=0.1",
                        "simulation.accuracy=1e-9", 'simulation.accuracy_of="trajectory"')

    def pair(_, y):
        force = stiffness * (y[1] - y[0]) + damping * (y[3] - y[2])
        return [y[2], y[3], force / INERTIA, (tau - force) / rotor]
    usual = [(t, y[0]) for t, y in march(pair, [0.0] * 4, 0.1, 1e-3)]
    return {"ours": worst(column(ours, "theta1"), exact), "usual": worst(usual, exact),
            "curves": [("exact", [(r["t"], exact(r["t"])) for r in ours]), ("radau5", column(ours, "theta1")),
                       ("RK4", usual)]}


def stiff_friction(program):
    """Friction smoothed over 1e-4 rad/s under less torque than it holds: the rate creeps, with a time constant of 2 us."""
    amp, omega, friction, soft = 0.04, 10.0, 0.05, 1e-4

    def exact(t):  # the slow solution: w = soft atanh((torque - I w') / friction), its derivative by the same without w'
        x = amp / friction * math.sin(omega * t)
        slope = soft * amp / friction * omega * math.cos(omega * t) / (1 - x * x)
        return soft * math.atanh(x - INERTIA * slope / friction)
    ours = program.rows(WHEEL, sine_torque(amp, omega), effect(f'type="coulomb_friction", torque=[{friction}, 0.0], regularised={soft}'),
                        "simulation.duration=0.3", "simulation.integrator=radau5", "simulation.step=1e-3")
    usual = march(lambda t, y: [y[1], (amp * math.sin(omega * t) - friction * math.tanh(y[1] / soft)) / INERTIA], [0.0, 0.0], 0.3, 1e-3)
    settled = [(t, v) for t, v in column(ours, "theta1_rate") if t > 0.002]
    late = [(t, y[1]) for t, y in usual if t > 0.002]
    scaled = lambda points: [(t, math.log10(abs(v))) for t, v in points]
    return {"ours": worst(settled, exact), "usual": worst(late, exact),
            "curves": [("exact", scaled([(t, exact(t)) for t, _ in settled])), ("radau5", scaled(settled)), ("RK4", scaled(late))]}


def payload_jump(program):
    """The arm takes up a payload between two ticks and lets it go again."""
    load, taken, freed, end, torque = 0.5, 0.20037, 0.60063, 1.0, (0.6, 0.2)
    arm = Arm(0.0, **ARM)

    def motion(t, y):
        return arm.acceleration(y, torque[0] - torque[1], torque[1], load if taken <= t < freed else 0.0)
    truth, t, y = {}, 0.0, [0.3, 1.0, 0.0, 0.0]
    instants = sorted({n * 1e-3 for n in range(1001)} | {taken, freed})
    for low, high in zip(instants, instants[1:]):  # ten steps from instant to instant, none across a jump
        truth[round(low, 9)] = y[0]
        on = load if taken <= low < freed else 0.0
        for n in range(10):
            y = rk4(lambda _, s: arm.acceleration(s, torque[0] - torque[1], torque[1], on), t, y, (high - low) / 10)
    ours = program.rows(SCENES / "rr_line.toml", "control.law=open_loop", f"control.torque=[{{offset={torque[0]}}}, {{offset={torque[1]}}}]",
                        'reference={type="hold"}', "initial.joints=[0.3, 0.7]", "mechanism.gravity=0", "simulation.integrator=rk4",
                        "limits.joint_speed=1000", "simulation.step=1e-3", f"simulation.duration={end}",
                        effect(f'type="payload", mass={load}, from={taken}, to={freed}'))
    usual = march(motion, [0.3, 1.0, 0.0, 0.0], end, 1e-3)
    off = [(t, abs(v - truth[round(t, 9)])) for t, v in column(ours, "theta1")]
    usual_off = [(t, abs(y[0] - truth[round(t, 9)])) for t, y in usual if round(t, 9) in truth]
    return {"ours": max(v for _, v in off), "usual": max(v for _, v in usual_off),
            "curves": [("RK4 that stops at jumps", digits(off)), ("RK4 across them", digits(usual_off))]}
