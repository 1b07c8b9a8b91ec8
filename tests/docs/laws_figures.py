"""Pictures of docs/laws.md: error against torque activity, logarithmic, a panel for each mechanism of a world. Used by laws_page.py."""
import math

# Colour says the law (Okabe and Ito's palette, told apart by colour-blind eyes), the marker says the reaching.
COLOURS = {"esmc": "#0072b2", "esmc_projected": "#56b4e9", "smc": "#009e73", "ctc": "#d55e00", "pd": "#000000"}
PANEL, GAP, LEFT, TOP, HEIGHT, BELOW, RIGHT = 420, 24, 72, 66, 300, 72, 14


def marker(shape, x, y, colour, size):
    """An SVG element; open shapes where the law has no reaching."""
    s = size
    if shape == "implicit":
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{s:g}" fill="{colour}"/>'
    if shape == "saturation":
        return f'<rect x="{x - s:.1f}" y="{y - s:.1f}" width="{2 * s:g}" height="{2 * s:g}" fill="{colour}"/>'
    if shape == "implicit_coupled":
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{1.4 * s:g}" fill="none" stroke="{colour}" stroke-width="1.3"/>'
    path = {"super_twisting": f"M{x:.1f} {y - 1.4 * s:.1f}v{2.8 * s:g}M{x - 1.4 * s:.1f} {y:.1f}h{2.8 * s:g}",
            "tanh": f"M{x - s:.1f} {y + s:.1f}h{2 * s:g}l{-s:g} {-2 * s:g}z",
            "sign": f"M{x - s:.1f} {y - s:.1f}l{2 * s:g} {2 * s:g}m{-2 * s:g} 0l{2 * s:g} {-2 * s:g}",
            "ctc": f"M{x - 1.3 * s:.1f} {y:.1f}l{1.3 * s:g} {-1.3 * s:g}l{1.3 * s:g} {1.3 * s:g}l{-1.3 * s:g} {1.3 * s:g}z",
            "pd": f"M{x - s:.1f} {y - s:.1f}h{2 * s:g}l{-s:g} {2 * s:g}z"}[shape]
    return f'<path d="{path}" fill="{colour if shape == "tanh" else "none" if shape in ("sign", "super_twisting") else "#ffffff"}" stroke="{colour}" stroke-width="1.3"/>'


def decades(low, high):
    return range(math.floor(low), math.ceil(high) + 1)


def panel(left, top, title, scale_x, scale_y, laws, points, fronts):
    """points: {law: [(activity, error)]}, all of them, faint; fronts: the same, of each law its own front, joined."""
    x0, x1 = scale_x
    y0, y1 = scale_y
    x = lambda v: left + (math.log10(v) - x0) / (x1 - x0) * PANEL
    y = lambda v: top + (y1 - math.log10(v)) / (y1 - y0) * HEIGHT
    out = [f'<text x="{left + PANEL / 2:.0f}" y="{top - 8}" text-anchor="middle" font-weight="bold">{title}</text>']
    for d in decades(x0 - 1, x1):
        if x0 <= d <= x1:
            out += [f'<path d="M{x(10**d):.1f} {top}V{top + HEIGHT}" stroke="#e4e4e4"/>',
                    f'<text x="{x(10**d):.1f}" y="{top + HEIGHT + 16}" text-anchor="middle">{10.0**d:g}</text>']
        for part in (2, 5) if x1 - x0 < 3.5 else ():
            if x0 <= d + math.log10(part) <= x1:
                at = x(part * 10.0**d)
                out += [f'<path d="M{at:.1f} {top}V{top + HEIGHT}" stroke="#f2f2f2"/>',
                        f'<text x="{at:.1f}" y="{top + HEIGHT + 16}" text-anchor="middle" fill="#777777">{part * 10.0**d:g}</text>']
    for d in decades(y0, y1):
        if y0 <= d <= y1:
            out.append(f'<path d="M{left} {y(10**d):.1f}H{left + PANEL}" stroke="#e4e4e4"/>')
    out.append(f'<rect x="{left}" y="{top}" width="{PANEL}" height="{HEIGHT}" fill="none" stroke="#9a9a9a"/>')
    out.append(f'<text x="{left + PANEL / 2:.0f}" y="{top + HEIGHT + 36}" text-anchor="middle">torque activity, N m per tick</text>')
    for law, (colour, _) in laws.items():
        dots = "".join(f"M{x(a):.1f} {y(e):.1f}h0" for a, e in points[law])
        out.append(f'<path d="{dots}" stroke="{colour}" stroke-width="3" stroke-linecap="round" opacity="0.25"/>')
    for law, (colour, shape) in laws.items():
        line = " ".join(f"{x(a):.1f},{y(e):.1f}" for a, e in fronts[law])
        out.append(f'<polyline fill="none" stroke="{colour}" stroke-width="1" points="{line}"/>')
        out += [marker(shape, x(a), y(e), colour, 3.2) for a, e in fronts[law]]
    return out


def picture(title, laws, panels):
    """laws: {name: (colour, shape)}; panels: title, points, fronts as `panel` takes them. Scales are shared."""
    every = [p for _, points, _ in panels for law in points.values() for p in law]
    pad = 0.08
    scale_x = (math.log10(min(a for a, _ in every)) - pad, math.log10(max(a for a, _ in every)) + pad)
    scale_y = (math.log10(min(e for _, e in every)) - pad, math.log10(max(e for _, e in every)) + pad)
    width = LEFT + 2 * PANEL + GAP + RIGHT
    height = TOP + (len(panels) + 1) // 2 * (HEIGHT + BELOW) - 26
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="12">',
           f"<title>{title}</title>", f'<rect width="{width}" height="{height}" fill="#ffffff"/>']
    step = (width - LEFT - RIGHT) / 5
    for k, (law, (colour, shape)) in enumerate(laws.items()):
        left, top = LEFT + (k % 5) * step, 14 + 18 * (k // 5)
        out += [f'<path d="M{left:.0f} {top}h22" stroke="{colour}"/>', marker(shape, left + 11, top, colour, 3.6),
                f'<text x="{left + 28:.0f}" y="{top + 4}">{law}</text>']
    for k, (name, points, fronts) in enumerate(panels):
        top = TOP + k // 2 * (HEIGHT + BELOW)
        if k % 2 == 0:
            for d in decades(*scale_y):
                if scale_y[0] <= d <= scale_y[1]:
                    at = top + (scale_y[1] - d) / (scale_y[1] - scale_y[0]) * HEIGHT
                    out.append(f'<text x="{LEFT - 6}" y="{at + 4:.1f}" text-anchor="end">{10.0**d:g}</text>')
            out.append(f'<text transform="translate(14 {top + HEIGHT // 2}) rotate(-90)" text-anchor="middle">settled error, m rms</text>')
        out += panel(LEFT + k % 2 * (PANEL + GAP), top, name, scale_x, scale_y, laws, points, fronts)
    return "\n".join(out) + "\n</svg>\n"
