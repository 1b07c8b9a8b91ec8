"""Plants and usual methods of the gallery, written apart from the program: bars by their angles against the x axis, closure by
multipliers, Gauss elimination. Python's standard library only."""
import math


def solve(a, b):
    """a x = b by elimination with row pivots; both are used up. None where a is singular to rounding."""
    n = len(b)
    for k in range(n):
        p = max(range(k, n), key=lambda i: abs(a[i][k]))
        if not abs(a[p][k]) > 0.0:
            return None
        a[k], a[p], b[k], b[p] = a[p], a[k], b[p], b[k]
        for i in range(k + 1, n):
            f = a[i][k] / a[k][k]
            if f != 0.0:
                row, top = a[i], a[k]
                for j in range(k, n):
                    row[j] -= f * top[j]
                b[i] -= f * b[k]
    for k in range(n - 1, -1, -1):
        b[k] = (b[k] - sum(a[k][j] * b[j] for j in range(k + 1, n))) / a[k][k]
    return b


def rk4(f, t, y, h):
    def moved(k, part):
        return [u + part * h * v for u, v in zip(y, k)]
    k1 = f(t, y)
    k2 = f(t + h / 2, moved(k1, 0.5))
    k3 = f(t + h / 2, moved(k2, 0.5))
    k4 = f(t + h, moved(k3, 1.0))
    return [u + h / 6 * (a + 2 * b + 2 * c + d) for u, a, b, c, d in zip(y, k1, k2, k3, k4)]


def march(f, y, end, h, valid=lambda y: all(map(math.isfinite, y))):
    """[(t, y)] at every step of RK4, up to the end or to the last state that is valid."""
    out = [(0.0, y)]
    for n in range(round(end / h)):
        try:
            y = rk4(f, n * h, y, h)
        except (ValueError, OverflowError, TypeError, ZeroDivisionError):
            break
        if not valid(y):
            break
        out.append(((n + 1) * h, y))
    return out


class Arm:
    """Two bars in a row: l1, l2, lg1, lg2, m1, m2, J1, J2; a point mass at the tip; state (a1, a2, w1, w2)."""

    def __init__(self, gravity, l1, l2, lg1, lg2, m1, m2, J1, J2, tip=0.0):
        self.l1, self.l2 = l1, l2
        self.m11, self.m22 = J1 + m1 * lg1**2 + (m2 + tip) * l1**2, J2 + m2 * lg2**2 + tip * l2**2
        self.c = m2 * l1 * lg2 + tip * l1 * l2
        self.g1, self.g2 = gravity * (m1 * lg1 + (m2 + tip) * l1), gravity * (m2 * lg2 + tip * l2)

    def terms(self, a1, a2, w1, w2, q1=0.0, q2=0.0, load=0.0):
        """m11, m12, m22 and right sides, of generalised forces q1, q2 on the bars and a point mass at the tip (no gravity on it)."""
        c = self.c + load * self.l1 * self.l2
        s = c * math.sin(a2 - a1)
        return (self.m11 + load * self.l1**2, c * math.cos(a2 - a1), self.m22 + load * self.l2**2,
                q1 + s * w2**2 - self.g1 * math.cos(a1), q2 - s * w1**2 - self.g2 * math.cos(a2))

    def acceleration(self, y, q1, q2, load=0.0):
        m11, m12, m22, r1, r2 = self.terms(*y, q1, q2, load)
        d = m11 * m22 - m12 * m12
        return [y[2], y[3], (m22 * r1 - m12 * r2) / d, (m11 * r2 - m12 * r1) / d]


BAR = {"l1": 0.12, "l2": 0.16, "lg1": 0.06, "lg2": 0.068, "m1": 0.1, "m2": 0.1, "J1": 2e-4, "J2": 7e-4}


class FiveBar:
    """Four bars by their angles, counter-clockwise from the x axis: leg 1 at (+base, 0), then leg 2 at (-base, 0)."""

    def __init__(self, base=0.05, gravity=9.8, effector=0.0, **bar):
        self.bar, self.base = {**BAR, **bar}, base
        self.legs = Arm(gravity, **self.bar, tip=effector), Arm(gravity, **self.bar)

    @staticmethod
    def from_joints(theta):
        """Bar angles of the program's joint angles, whose leg 2 counts clockwise from the -x axis."""
        return [theta[0], theta[0] + theta[1], math.pi - theta[2], math.pi - theta[2] - theta[3]]

    def gap(self, a):
        l1, l2 = self.bar["l1"], self.bar["l2"]
        return [2 * self.base + l1 * (math.cos(a[0]) - math.cos(a[2])) + l2 * (math.cos(a[1]) - math.cos(a[3])),
                l1 * (math.sin(a[0]) - math.sin(a[2])) + l2 * (math.sin(a[1]) - math.sin(a[3]))]

    def jacobian(self, a):
        l1, l2 = self.bar["l1"], self.bar["l2"]
        signed = ((l1, a[0]), (l2, a[1]), (-l1, a[2]), (-l2, a[3]))
        return [[-l * math.sin(p) for l, p in signed], [l * math.cos(p) for l, p in signed]]

    def curvature(self, a, w):
        """Second derivative of the gap without the accelerations."""
        l1, l2 = self.bar["l1"], self.bar["l2"]
        signed = ((l1, a[0], w[0]), (l2, a[1], w[1]), (-l1, a[2], w[2]), (-l2, a[3], w[3]))
        return [-sum(l * math.cos(p) * v * v for l, p, v in signed), -sum(l * math.sin(p) * v * v for l, p, v in signed)]

    def mass_and_force(self, a, w, torque=(0.0,) * 4):
        """4 x 4 mass matrix and right side; torques of the joints, counter-clockwise, leg 1 then leg 2."""
        m, r = [[0.0] * 4 for _ in range(4)], [0.0] * 4
        for k in (0, 2):
            m[k][k], m[k][k + 1], m[k + 1][k + 1], r[k], r[k + 1] = self.legs[k // 2].terms(
                a[k], a[k + 1], w[k], w[k + 1], torque[k] - torque[k + 1], torque[k + 1])
            m[k + 1][k] = m[k][k + 1]
        return m, r

    def acceleration(self, a, w, torque=(0.0,) * 4, alpha=0.0):
        """By multipliers; alpha: Baumgarte's feedback of the gap (1/s), 0: none."""
        m, r = self.mass_and_force(a, w, torque)
        jac, bend, gap = self.jacobian(a), self.curvature(a, w), self.gap(a)
        left = [m[i] + [jac[0][i], jac[1][i]] for i in range(4)] + [jac[0] + [0.0, 0.0], jac[1] + [0.0, 0.0]]
        speed = [sum(g * v for g, v in zip(row, w)) for row in jac]
        return solve(left, r + [-b - 2 * alpha * v - alpha * alpha * g for b, v, g in zip(bend, speed, gap)])[:4]

    def free(self, alpha=0.0):
        """Right-hand side of free motion, state (angles, rates)."""
        return lambda t, y: y[4:] + self.acceleration(y[:4], y[4:], alpha=alpha)

    def penalty(self, stiffness, damping):
        """Free motion with a spring and damper in place of the joint at the effector."""
        def f(t, y):
            a, w = y[:4], y[4:]
            m, r = self.mass_and_force(a, w)
            jac = self.jacobian(a)
            force = [stiffness * g + damping * sum(x * v for x, v in zip(row, w)) for g, row in zip(self.gap(a), jac)]
            return w + solve(m, [r[i] - jac[0][i] * force[0] - jac[1][i] * force[1] for i in range(4)])
        return f

    def passive(self, a1, b1, side):
        """Distal bar angles of given proximal ones by cutting two circles; ValueError where they do not meet."""
        l1, l2 = self.bar["l1"], self.bar["l2"]
        ex, ey, fx, fy = self.base + l1 * math.cos(a1), l1 * math.sin(a1), -self.base + l1 * math.cos(b1), l1 * math.sin(b1)
        dx, dy = (fx - ex) / 2, (fy - ey) / 2
        h = math.sqrt(l2 * l2 / (dx * dx + dy * dy) - 1.0)
        x, y = ex + dx - side * h * dy, ey + dy + side * h * dx
        return math.atan2(y - ey, x - ex), math.atan2(y - fy, x - fx)

    def minimal(self, side):
        """Free motion in the two base angles alone, state (a1, b1, rates): the usual minimal coordinates."""
        def f(t, y):
            a2, b2 = self.passive(y[0], y[1], side)
            a = [y[0], a2, y[1], b2]
            jac = self.jacobian(a)
            w2, v2 = solve([[jac[0][1], jac[0][3]], [jac[1][1], jac[1][3]]],
                           [-(jac[0][0] * y[2] + jac[0][2] * y[3]), -(jac[1][0] * y[2] + jac[1][2] * y[3])])
            acceleration = self.acceleration(a, [y[2], w2, y[3], v2])
            return [y[2], y[3], acceleration[0], acceleration[2]]
        return f
