#!/usr/bin/python3
"""Pictures of docs/effects.md: what each effect looks like on one joint. Python's standard library only.

usage: effect_figures.py ESMC              runs everything and compares with docs/images
       effect_figures.py ESMC --update     draws the pictures anew

Every curve is a run of tests/docs/effects_bench.toml with --set, listed below."""
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import page

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "tests/docs/effects_bench.toml"
IMAGES = ROOT / "docs/images"
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 640, 260, 62, 12, 30, 40
COLOURS = ("#9a9a9a", "#1f5fa8", "#c8541a")
POINTS = 500
NEAR = 0.6  # of a pixel: other compilers and libraries may round differently

HOLD = ['reference={type="joint_sine", offset=[0.0, 1.5], amplitude=[0.0, 0.0], omega=[1.0, 1.0]}']
ESMC_LAW = ['control.law="esmc"', "control.lambda=30.0", "control.gain=40.0"]
PUSH = ['control.law="open_loop"', "control.torque=[{offset=0.5, terms=[]}, {offset=0.0, terms=[]}]"]


def effects(*tables):
    return ["effects=[" + ", ".join("{" + t + "}" for t in tables) + "]"]


STIFF = ["control.kp=2000.0", "control.kd=60.0"]
BLOW = 'type="external_force", force=[0.0, 40.0], from=0.2, to=0.22'
# name, vertical axis, from and to (s), curves: label, --set values, value of a row
FIGURES = [
    ("coulomb_friction", "joint angle, rad", 0.0, 4.0, [
        ("reference", [], lambda r: r["theta1_ref"]),
        ("without", [], lambda r: r["theta1"]),
        ("coulomb_friction", effects('type="coulomb_friction", torque=[2.0, 0.1]'), lambda r: r["theta1"])]),
    ("joint_flexibility", "joint angle after a blow, rad", 0.1, 1.2, [
        ("without", HOLD + STIFF + effects(BLOW), lambda r: r["theta1"]),
        ("joint_flexibility", HOLD + STIFF + effects(BLOW, 'type="joint_flexibility", stiffness=150.0, damping=0.1, rotor_inertia=0.01'),
         lambda r: r["theta1"])]),
    ("backlash", "rotor less joint, mrad", 0.0, 4.0, [
        ("without", [], lambda r: 1e3 * (r["theta1_meas"] - r["theta1"])),
        ("backlash", effects('type="backlash", gap=0.01, stiffness=2000.0, damping=1.0, rotor_inertia=0.01'),
         lambda r: 1e3 * (r["theta1_meas"] - r["theta1"]))]),
    ("end_stops", "joint angle under a constant torque, rad", 0.0, 2.5, [
        ("end_stops", PUSH + effects('type="end_stops", lower=[-1.0, -3.0], upper=[0.5, 3.0], restitution=0.6'),
         lambda r: r["theta1"])]),
    ("torque_saturation", "torque, N m", 0.0, 0.6, [
        ("commanded", effects('type="torque_saturation", limit=1.0'), lambda r: r["tau1_cmd"]),
        ("torque_saturation", effects('type="torque_saturation", limit=1.0'), lambda r: r["tau1"])]),
    ("torque_ripple", "joint rate, rad/s", 1.0, 3.0, [
        ("without", [], lambda r: r["theta1_rate"]),
        ("torque_ripple", effects('type="torque_ripple", amplitude=0.5, per_turn=84.0'), lambda r: r["theta1_rate"])]),
    ("encoder", "joint rate, rad/s", 0.3, 1.0, [
        ("true", effects('type="encoder", bits=11'), lambda r: r["theta1_rate"]),
        ("read through encoder", effects('type="encoder", bits=11'), lambda r: r["theta1_rate_meas"])]),
    ("compute_delay", "torque, N m", 0.5, 0.7, [
        ("control.delay_ticks = 2", ESMC_LAW + ["control.delay_ticks=2"] + effects('type="compute_delay", time=2e-3'),
         lambda r: r["tau1"]),
        ("compute_delay", ESMC_LAW + ["control.delay_ticks=0"] + effects('type="compute_delay", time=2e-3'),
         lambda r: r["tau1"])]),
    ("thermal_limit", "torque, N m", 0.0, 4.0, [
        ("without", [], lambda r: r["tau1"]),
        ("thermal_limit", effects('type="thermal_limit", continuous=0.2, time_constant=0.5'), lambda r: r["tau1"])]),
]


def ticks(low, high):
    span = high - low
    step = 10.0 ** len(str(int(span))) if span >= 1 else 1.0
    while span / step < 3.5:
        step /= 2 if str(step).strip("0.")[:1] in ("1", "2") else 2.5
    first = int(low / step) - 1
    return [k * step for k in range(first, first + 40) if low - 1e-12 <= k * step <= high + 1e-12]


def svg(title, vertical, start, end, curves, horizontal="t, s"):
    """curves: label and points (t, value); a cross marks the end of a curve that stops early."""
    values = [v for _, points in curves for _, v in points]
    low, high = min(values), max(values)
    pad = 0.06 * (high - low or 1.0)
    low, high = low - pad, high + pad
    x = lambda t: LEFT + (t - start) / (end - start) * (WIDTH - LEFT - RIGHT)
    y = lambda v: HEIGHT - BOTTOM - (v - low) / (high - low) * (HEIGHT - TOP - BOTTOM)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="12">',
           f"<title>{title}</title>", f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>']
    for t in ticks(start, end):
        out += [f'<path d="M{x(t):.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="#e4e4e4"/>',
                f'<text x="{x(t):.1f}" y="{HEIGHT - BOTTOM + 16}" text-anchor="middle">{t:g}</text>']
    for v in ticks(low, high):
        out += [f'<path d="M{LEFT} {y(v):.1f}H{WIDTH - RIGHT}" stroke="#e4e4e4"/>',
                f'<text x="{LEFT - 6}" y="{y(v) + 4:.1f}" text-anchor="end">{v:g}</text>']
    out += [f'<text x="{(LEFT + WIDTH - RIGHT) / 2:.0f}" y="{HEIGHT - 6}" text-anchor="middle">{horizontal}</text>',
            f'<text transform="translate(14 {(TOP + HEIGHT - BOTTOM) / 2:.0f}) rotate(-90)" text-anchor="middle">{vertical}</text>']
    at = LEFT
    for (label, points), colour in zip(curves, COLOURS[3 - len(curves):]):
        out += [f'<path d="M{at} 16h18" stroke="{colour}" stroke-width="2"/>', f'<text x="{at + 23}" y="20">{label}</text>']
        at += 40 + 7 * len(label)
        path = " ".join(f"{x(t):.1f},{y(v):.1f}" for t, v in points)
        out.append(f'<polyline fill="none" stroke="{colour}" stroke-width="1.5" points="{path}"/>')
        if points[-1][0] < end - 0.02 * (end - start):
            out.append(f'<path d="M{x(points[-1][0]) - 5:.1f} {y(points[-1][1]) - 5:.1f}l10 10m-10 0l10 -10" stroke="{colour}" stroke-width="2"/>')
    return "\n".join(out) + "\n</svg>\n"


def draw(esmc, name, vertical, start, end, curves):
    drawn = []
    for label, sets, value in curves:
        inside = [r for r in page.run(esmc, "sim", SCENE, *sets, log=True)[1] if start <= r["t"] <= end]
        drawn.append((label, [(r["t"], value(r)) for r in inside[::max(1, len(inside) // POINTS)]]))
    return svg(name, vertical, start, end, drawn)


def same(a, b):
    number = re.compile(r"-?\d+(?:\.\d+)?")
    if number.sub("#", a) != number.sub("#", b):
        return False
    return all(abs(float(m) - float(n)) <= NEAR for m, n in zip(number.findall(a), number.findall(b)))


def main():
    arguments = [a for a in sys.argv[1:] if a != "--update"]
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    text = (ROOT / "docs/effects.md").read_text(encoding="utf-8")
    failed = 0
    with ThreadPoolExecutor(2) as pool:
        pictures = list(pool.map(lambda figure: draw(arguments[0], *figure), FIGURES))
    for (name, *_), picture in zip(FIGURES, pictures):
        file = IMAGES / f"effect_{name}.svg"
        if "--update" in sys.argv:
            file.write_text(picture, encoding="utf-8")
        elif not file.is_file() or not same(file.read_text(encoding="utf-8"), picture):
            failed += 1
            print(f"{file.relative_to(ROOT)} is not what the program does: effect_figures.py ESMC --update")
        if f"(images/{file.name})" not in text:
            failed += 1
            print(f"docs/effects.md does not show {file.name}")
    print(f"{len(FIGURES)} pictures, {failed} problems")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
