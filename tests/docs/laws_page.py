#!/usr/bin/python3
"""Laws against each other: docs/laws.md, docs/laws.csv and docs/images/laws_*.svg. Python's standard library only.

usage: laws_page.py ESMC             makes all runs (some minutes on two cores), then writes numbers, text and pictures
       laws_page.py --redraw         writes text and pictures anew from the numbers kept in docs/laws.csv
       laws_page.py ESMC --check     runs a few of the settings again; numbers, text and pictures must be what is kept

Every sentence between the markers of docs/laws.md is made here from the numbers."""
import re
import sys
from pathlib import Path

import laws_figures
import laws_study as study

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE, KEPT, BOARDS = DOCS / "laws.md", DOCS / "laws.csv", DOCS / "boards.md"
BEGIN, END = "<!-- study -->\n", "<!-- /study -->"
ANY = float("inf")
BUDGETS = (0.004, 0.008, 0.02, ANY)  # N m per tick
LEVEL = 1.1                          # a factor below which two numbers count as equal
OURS = ("esmc", "esmc_projected")
WORLD = {"ideal": "ideal", "encoders": "16-bit encoders, 1 ms delay", "friction": "encoders, delay, friction"}
MECHANISM = {"exact": "exact", "joined": "exact, start joined", "masses": "masses ±20 %", "lengths": "masses ±20 %, lengths ±1 %"}


def ours(law):
    return study.LAWS[law][0] in OURS


def code(law):
    return " ".join(f"`{w}`" for w in law.split())


def listed(words):
    words = list(words)
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def sizes(metres):
    if metres == ANY:
        return "fault"
    for unit, factor in (("mm", 1e3), ("um", 1e6), ("nm", 1e9)):
        if metres * factor >= 0.1:
            break
    return f"{metres * factor:.3g} {unit}"


def budget_name(budget):
    return "any" if budget == ANY else f"<= {budget:g}"


class Study:
    """Questions to the numbers. The error of a setting is that of its 95 % sample, or of its only run; the activity that
    of its median."""

    def __init__(self, scores):
        self.scores = scores

    def points(self, law, condition):
        """(error, activity, setting) of all settings whose 95 % sample ends without a fault."""
        rows = [(self.scores[(law, *condition, *s)], s) for s in study.settings(law)]
        return sorted((v[1], v[2], s) for v, s in rows if v[1] < ANY)

    def front(self, law, condition):
        """Those of a law that no other setting of it beats in both, by falling error."""
        out = []
        for error, activity, s in self.points(law, condition):
            if not out or activity < out[-1][1]:
                out.append((error, activity, s))
        return out

    def best(self, laws, condition, budget=ANY):
        """Smallest error at an activity within the budget: (error, activity, setting, law), or None."""
        found = [(*p, law) for law in laws for p in self.points(law, condition) if p[1] <= budget]
        return min(found, default=None)

    def on_front(self, condition):
        """{law: how many of its settings no setting of any law beats: as good in both, better by LEVEL in one}."""
        every = [p[:2] for law in study.LAWS for p in self.points(law, condition)]
        beaten = lambda e, a: any(x <= e and y <= a and (x * LEVEL <= e or y * LEVEL <= a) for x, y in every)
        count = {law: sum(not beaten(e, a) for e, a, _ in self.points(law, condition)) for law in study.LAWS}
        return {law: n for law, n in count.items() if n}

    def near_best(self, law, condition):
        """Share of its settings within twice the smallest error that any law reaches, below 0.02 N m per tick."""
        least = self.best(study.LAWS, condition, 0.02)[0]
        return sum(e <= 2 * least and a <= 0.02 for e, a, _ in self.points(law, condition)) / len(study.settings(law))


def ratio(s, condition, budget):
    """(best of the others) / (best of ESMC): above 1 ESMC is better. None where neither has anything in the budget."""
    mine = s.best(filter(ours, study.LAWS), condition, budget)
    others = s.best((law for law in study.LAWS if not ours(law)), condition, budget)
    if mine is None or others is None:
        return None if mine is others else (ANY if others is None else 0.0), mine, others
    return others[0] / mine[0], mine, others


def verdict(value):
    if value is None:
        return "nobody"
    if value > LEVEL:
        return "**ahead**"
    return "behind" if value < 1 / LEVEL else "level"


def verdicts(s):
    out = ["| world | mechanism | activity, N m per tick | best of ESMC | best of the others | others / ESMC | ESMC is |",
           "|---|---|---|---|---|---|---|"]
    where = {"**ahead**": [], "level": [], "behind": [], "nobody": []}
    said = lambda b: "none" if b is None else f"{code(b[3])} {sizes(b[0])}"
    for condition in study.CONDITIONS:
        for budget in BUDGETS:
            value, mine, others = ratio(s, condition, budget)
            where[verdict(value)].append((condition, budget, value))
            number = "" if value in (None, ANY, 0.0) else f"{value:.2f}"
            out.append(f"| {WORLD[condition[0]]} | {MECHANISM[condition[1]]} | {budget_name(budget)} | {said(mine)} | {said(others)} "
                       f"| {number} | {verdict(value)} |")
    return "\n".join(out) + "\n", where


def cases(found):
    """The same in words: world, mechanism, budgets."""
    rows = {}
    for condition, budget, _ in found:
        rows.setdefault(condition, []).append(budget_name(budget))
    return "".join(f"  * {WORLD[w]}; {MECHANISM[m]}: {', '.join(b)} N m\n" for (w, m), b in rows.items()) or "  * nowhere\n"


def span(values):
    low, high = min(values), max(values)
    return f"{low:.2f}" if f"{low:.2f}" == f"{high:.2f}" else f"{low:.2f} to {high:.2f}"


def sentences(s, where):
    total = sum(map(len, where.values())) - len(where["nobody"])
    yield (f"Of {total} comparisons (world, mechanism, bound on the activity) the best setting of ESMC is ahead in "
           f"{len(where['**ahead**'])}, level in {len(where['level'])}, behind in {len(where['behind'])}; "
           f"level is within {100 * (LEVEL - 1):.0f} %.")
    yield "**ESMC wins**, by the factor in the table:\n" + cases(where["**ahead**"]).rstrip("\n")
    yield "**ESMC does not win**: another law is better:\n" + cases(where["behind"]).rstrip("\n")
    parts = []
    for world in study.WORLDS:
        values = [s.best(("esmc implicit",), (world, m))[0] / s.best((o,), (world, m))[0]
                  for m in study.MECHANISMS for o in ("esmc_projected implicit", "smc implicit")]
        parts.append(f"{span(values)} ({WORLD[world]})")
    yield ("**18 surfaces or 2**: the best error of `esmc` `implicit` over that of `esmc_projected` and `smc` with the same reaching "
           "is " + listed(parts) + ".")
    parts = []
    for world in study.WORLDS:
        values = [s.best(("esmc implicit",), (world, m))[0] / s.best(("esmc saturation",), (world, m))[0] for m in study.MECHANISMS]
        parts.append(f"{span(values)} ({WORLD[world]})")
    yield ("**`implicit` or a layer of one's own**: the best error of `esmc` `implicit`, which takes its stiffness from tick and told delay, over "
           "that of `esmc` `saturation`, whose layer was searched for: " + listed(parts) + ".")
    parts = []
    for world in study.WORLDS:
        sign, smooth = s.best(("esmc sign",), (world, "exact")), s.best(("esmc implicit",), (world, "exact"))
        parts.append(f"{sizes(sign[0])} at {sign[1]:.2g} N m per tick against {sizes(smooth[0])} at {smooth[1]:.2g} ({WORLD[world]})")
    yield "**`sign`** against `implicit`, exact mechanism, each at its best: " + "; ".join(parts) + "."
    values = [s.best(("ctc",), c)[0] / s.best(filter(ours, study.LAWS), c)[0] for c in study.CONDITIONS]
    yield f"**`ctc`**, with both of its poles searched for, reaches {span(values)} times the best error of ESMC."
    values = [s.best(("pd",), c)[0] / s.best(filter(ours, study.LAWS), c)[0] for c in study.CONDITIONS]
    yield f"**`pd`**, which needs no model, reaches {span(values)} times the best error of ESMC."
    factor = lambda c, b: "none" if (value := ratio(s, c, b)[0]) in (None, ANY, 0.0) else f"{value:.2f}"
    for world in study.WORLDS:
        parts = [f"{factor((world, 'exact'), b)} and {factor((world, 'joined'), b)} ({budget_name(b)} N m)" for b in BUDGETS]
        yield (f"**What the start does** ({WORLD[world]}): others / ESMC with the scene's start and with a joined one is " + listed(parts) + ".")
    for world in study.WORLDS:
        exact, masses, both = (s.best(study.LAWS, (world, m))[0] for m in ("exact", "masses", "lengths"))
        yield (f"**What a wrong model costs** ({WORLD[world]}): the smallest error of any law is {sizes(exact)} with the exact mechanism, "
               f"{sizes(masses)} with wrong masses, {sizes(both)} with wrong lengths as well.")


def fronts(s):
    out = ["| world | mechanism | on the front, with how many settings |", "|---|---|---|"]
    for w, m in study.CONDITIONS:
        members = sorted(s.on_front((w, m)).items(), key=lambda item: -item[1])
        out.append(f"| {WORLD[w]} | {MECHANISM[m]} | " + ", ".join(f"{code(law)} {n}" for law, n in members) + " |")
    return "\n".join(out) + "\n"


def second_name(law, value):
    return f"{'k' if study.LAWS[law][2] == 'gain' else 'mu'} {value:g}"


def table(s, world):
    head = "| law | " + " | ".join(f"{MECHANISM[m]} | at | with" for m in study.MECHANISMS) + " |\n|---" + "|---" * (3 * len(study.MECHANISMS)) + "|\n"
    least = {m: s.best(study.LAWS, (world, m))[0] for m in study.MECHANISMS}
    rows = ""
    for law in study.LAWS:
        rows += f"| {code(law)} "
        for m in study.MECHANISMS:
            found = s.best((law,), (world, m))
            if found is None:
                rows += "| faults | | "
                continue
            error, activity, (slope, second), _ = found
            said = f"**{sizes(error)}**" if error <= LEVEL * least[m] else sizes(error)
            rows += f"| {said} | {activity:.2g} | lambda {slope:g}, {second_name(law, second)} "
        rows += "|\n"
    return head + rows


def robust(s):
    out = "| law | " + " | ".join(WORLD[w] for w in study.WORLDS) + " |\n|---" + "|---" * len(study.WORLDS) + "|\n"
    for law in study.LAWS:
        out += f"| {code(law)} | " + " | ".join(
            ", ".join(f"{100 * s.near_best(law, (w, m)):.0f} %" for m in study.MECHANISMS) for w in study.WORLDS) + " |\n"
    return out


def instructions():
    """{law: (M4F, M7)}: mean per tick, from the counted tables of boards.md."""
    text = BOARDS.read_text(encoding="utf-8")
    columns = []
    for board in ("mps2-an386", "mps2-an500"):
        counted = text.split(f"<!-- count {board} -->")[1].split("<!-- /count")[0]
        columns.append({m[1]: int(m[2]) for m in re.finditer(r"^\| `(\w+)` \| \d+ \| (\d+) \|", counted, re.M)})
    return {law: (columns[0][law], columns[1][law]) for law in columns[0]}


def costs(s, counted):
    out = "| law | M4F, float | M7, double | best error: " + " | ".join(f"{WORLD[w]}" for w in study.WORLDS) + " |\n|---|---|---|---|---|---|\n"
    for law, (four, seven) in counted.items():
        kind = [name for name in study.LAWS if study.LAWS[name][0] == law]
        errors = " | ".join(", ".join(sizes(s.best(kind, (w, m))[0]) for m in study.MECHANISMS) for w in study.WORLDS)
        out += f"| `{law}` | {four} | {seven} | {errors} |\n"
    dear, cheap = counted["esmc"], counted["smc"]
    return out + (f"\n`esmc` takes {dear[0] / cheap[0]:.2f} (M4F) and {dear[1] / cheap[1]:.2f} (M7) times the instructions of `smc`.\n")


def figures(s):
    laws = {name: (laws_figures.COLOURS[kind], reaching or kind) for name, (kind, reaching, _) in study.LAWS.items()}
    for world in study.WORLDS:
        panels = []
        for m in study.MECHANISMS:
            flat = lambda rows: [(activity, error) for error, activity, _ in rows]
            panels.append((MECHANISM[m], {law: flat(s.points(law, (world, m))) for law in laws},
                           {law: flat(s.front(law, (world, m))) for law in laws}))
        yield f"laws_{world}.svg", laws_figures.picture(f"Error against torque activity: {WORLD[world]}", laws, panels)


def text(s, counted):
    rows, where = verdicts(s)
    out = "## What the numbers say\n\n" + "".join(f"* {line}\n" for line in sentences(s, where))
    out += "\n### Who is ahead\n\n" + rows + "\n### The front of all laws\n\n" + (
        f"A setting is on it if no other is as good in both and {100 * (LEVEL - 1):.0f} % better in one.\n\n") + fronts(s)
    for world in study.WORLDS:
        out += (f"\n### World: {WORLD[world]}\n\n![Error against torque activity](images/laws_{world}.svg)\n\n"
                f"Smallest error of each law, its activity (N m per tick) and setting; bold: within {100 * (LEVEL - 1):.0f} % of the smallest "
                "of all.\n\n" + table(s, world))
    out += ("\n### How easily it is mistuned\n\nShare of a law's settings that come within twice the smallest error of any law, at no more than 0.02 N m per "
            "tick; " + listed(MECHANISM[m] for m in study.MECHANISMS) + ".\n\n" + robust(s))
    return out + "\n### Time per tick\n\n" + (
        "Instructions of a whole tick, mean, counted in the emulator with `implicit` "
        "([boards.md](boards.md#instructions-per-tick)), beside the smallest error with any reaching, mechanisms in the same order.\n\n") + costs(s, counted)


def write(scores):
    s = Study(scores)
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    PAGE.write_text(before + BEGIN + text(s, instructions()) + END + rest.split(END)[1], encoding="utf-8")
    for name, picture in figures(s):
        (DOCS / "images" / name).write_text(picture, encoding="utf-8")


def check(esmc, scores):
    """What is wrong with what is kept."""
    s = Study(scores)
    wanted = [(law, w, "exact", *s.best((law,), (w, "exact"))[2]) for law in study.LAWS for w in study.WORLDS]
    wanted += [(law, "ideal", "lengths", *s.best((law,), ("ideal", "lengths"))[2]) for law in study.LAWS]
    wanted += [(law, "friction", "masses", *s.best((law,), ("friction", "masses"))[2]) for law in ("esmc implicit", "ctc")]
    now = study.measure(esmc, [(*w[:4], (w[4],)) for w in wanted])
    for key, values in now.items():
        if values != scores[key]:
            yield f"docs/laws.csv: {key}: {scores[key]} is kept, the program computes {values}"
    kept = PAGE.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0]
    part = "\n### Time per tick\n"  # boards.md has a test of its own, and instructions change with every change of the code
    if text(s, instructions()).split(part)[0] != kept.split(part)[0]:
        yield "docs/laws.md: the text is not what docs/laws.csv says: laws_page.py --redraw"
    stated = {m[1]: (int(m[2]), int(m[3])) for m in re.finditer(r"^\| `(\w+)` \| (\d+) \| (\d+) \|", kept.split(part)[1], re.M)}
    for law, counted in instructions().items():
        if law not in stated or any(abs(a - b) > 0.03 * b for a, b in zip(stated[law], counted)):
            yield f"docs/laws.md: instructions of {law} are {counted} in docs/boards.md: laws_page.py --redraw"
    for name, picture in figures(s):
        file = DOCS / "images" / name
        if not file.is_file() or file.read_text(encoding="utf-8") != picture:
            yield f"docs/images/{name} is not what docs/laws.csv says: laws_page.py --redraw"


def main():
    arguments = sys.argv[1:]
    if arguments == ["--redraw"]:
        write(study.read(KEPT))
        return 0
    if len(arguments) == 2 and arguments[1] == "--check":
        problems = list(check(arguments[0], study.read(KEPT)))
        print("\n".join(problems) or "docs/laws.md, its numbers and pictures are what the program does")
        return 1 if problems else 0
    if len(arguments) != 1 or arguments[0].startswith("-"):
        print(__doc__, file=sys.stderr)
        return 2
    shown = sys.stderr.isatty()
    say = lambda done, of: print(f"\r{done} of {of} sweeps", end="", file=sys.stderr) if shown else None
    study.write(KEPT, study.measure(arguments[0], study.everything(), say))
    write(study.read(KEPT))
    return 0


if __name__ == "__main__":
    sys.exit(main())
