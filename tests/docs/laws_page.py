#!/usr/bin/python3
"""Laws against each other: docs/laws.md, docs/laws.csv and docs/images/laws_*.svg. Python's standard library only.

usage: laws_page.py ESMC             makes all runs (some minutes on two cores), then writes numbers, text and pictures
       laws_page.py --redraw         writes text and pictures anew from the numbers kept in docs/laws.csv
       laws_page.py ESMC --observer  makes the table of laws beside a disturbance observer
       laws_page.py ESMC --check     runs a few of the settings again; numbers, text and pictures must be what is kept

Every sentence between the markers of docs/laws.md is made here from the numbers."""
import re
import sys
from pathlib import Path

import laws_figures
import laws_study as study
import page

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE, KEPT, BOARDS = DOCS / "laws.md", DOCS / "laws.csv", DOCS / "boards.md"
QUIET = (0.004, 0.008, 0.02)         # N m per tick
ANY = float("inf")
BUDGETS = (0.0025, 0.004, 0.008, 0.02, ANY)  # N m per tick
LEVEL = 1.1                          # a factor below which two numbers count as equal
OURS = ("esmc", "esmc_projected")
WORLD = {"ideal": "ideal", "encoders": "16-bit encoders, 1 ms delay", "friction": "encoders, delay, friction"}
MECHANISM = {"exact": "exact", "joined": "exact, start joined", "masses": "masses ±20 %", "lengths": "masses ±20 %, lengths ±1 %"}


# Like is compared with like: an integral takes away what no gain of a law without one can, whatever else the law is.
INTEGRAL = tuple(law for law in study.LAWS if study.LAWS[law][1] == "super_twisting")
PLAIN = tuple(law for law in study.LAWS if law not in INTEGRAL)
MINE = tuple(law for law in PLAIN if study.LAWS[law][0] in OURS)
OTHERS = tuple(law for law in PLAIN if law not in MINE)
DEFAULT = (("esmc implicit",), ("ctc",))


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
    return "any activity" if budget == ANY else f"<= {budget:g} N m"


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
        least = self.best(INTEGRAL if law in INTEGRAL else PLAIN, condition, 0.02)[0]
        return sum(e <= 2 * least and a <= 0.02 for e, a, _ in self.points(law, condition)) / len(study.settings(law))


class Comparison:
    """ESMC and the other laws in one condition, within one bound of the activity: the best setting of each side."""

    def __init__(self, s, condition, budget, mine=MINE, others=OTHERS):
        self.condition, self.budget = condition, budget
        self.mine, self.others = s.best(mine, condition, budget), s.best(others, condition, budget)
        # Who is worse may use a little more activity: a setting that just misses the bound decides nothing.
        freed_mine, freed_others = s.best(mine, condition, LEVEL * budget), s.best(others, condition, LEVEL * budget)
        if self.mine and (freed_others is None or freed_others[0] > LEVEL * self.mine[0]):
            self.verdict = "ahead"
        elif self.others and (freed_mine is None or freed_mine[0] > LEVEL * self.others[0]):
            self.verdict = "behind"
        else:
            self.verdict = "level"
        self.ratio = f"{self.others[0] / self.mine[0]:.3g}" if self.mine and self.others else ""

    def cell(self):
        if not self.mine and not self.others:
            return ""
        said = self.verdict if self.verdict == "level" else f"**{self.verdict}**"
        return f"{said} {self.ratio}".strip()

    def words(self):
        who = lambda b: f"{code(b[3])} {sizes(b[0])}" if b else "no setting"
        return f"{WORLD[self.condition[0]]}; {MECHANISM[self.condition[1]]}; {budget_name(self.budget)}: {who(self.mine)}, others {who(self.others)}"


def comparisons(s, *sides):
    return [c for condition in study.CONDITIONS for budget in BUDGETS if (c := Comparison(s, condition, budget, *sides)).mine or c.others]


def verdicts(found):
    out = "| environment | mechanism | " + " | ".join("any" if b == ANY else f"<= {b:g}" for b in BUDGETS) + " |\n|---|---" + "|---" * len(BUDGETS) + "|\n"
    for condition in study.CONDITIONS:
        cells = {c.budget: c.cell() for c in found if c.condition == condition}
        out += f"| {WORLD[condition[0]]} | {MECHANISM[condition[1]]} | " + " | ".join(cells.get(b, "") for b in BUDGETS) + " |\n"
    return out


def span(values):
    low, high = min(values), max(values)
    low, high = f"{low:.3g}", f"{high:.3g}"
    return low if low == high else f"{low} to {high}"


def sentences(s, counted):
    found = comparisons(s)
    where = {v: [c for c in found if c.verdict == v] for v in ("ahead", "level", "behind")}
    count = lambda v: sum(c.condition[1] == "joined" for c in where[v])
    yield (f"**Summary** for laws without an integral: in {len(where['level'])} of {len(found)} comparisons (environment, mechanism, bound on the activity) "
           f"the best setting of ESMC and the best of the other laws are level, within {100 * (LEVEL - 1):.0f} %; ESMC is ahead in {len(where['ahead'])} and behind in "
           f"{len(where['behind'])}. With a joined start it is ahead in {count('ahead')} of "
           f"{sum(c.condition[1] == 'joined' for c in found)} and behind in {count('behind')}.")
    lines = lambda of: "".join(f"\n  * {c.words()}" for c in of) or " nowhere."
    yield "**Where ESMC wins**:" + lines(where["ahead"])
    yield ("**Where another law is better**:" + lines(where["behind"]) + " That holds for laws alone: beside a disturbance observer "
           "the best settings of `ctc` and of ESMC [are level](#beside-a-disturbance-observer), and as good as an integral.")
    share = lambda law: " and ".join(f"{100 * a / b:.0f} %" for a, b in zip(counted[law], counted["esmc"]))
    yield (f"**A tie favours `smc`, which is cheaper**: `smc` takes {share('smc')} of the instructions of `esmc` per tick (M4F, M7), `ctc` {share('ctc')}, "
           f"`esmc_projected` {share('esmc_projected')}.")
    alone = comparisons(s, *DEFAULT)
    at = lambda verdict: listed(budget_name(b) for b in BUDGETS if any(c.verdict == verdict and c.budget == b for c in alone)) \
        if any(c.verdict == verdict for c in alone) else "no bound"
    count = lambda verdict: sum(c.verdict == verdict for c in alone)
    yield (f"**The default alone**, `esmc` `implicit`, whose stiffness is not chosen, against `ctc` with a search for both poles "
           f"([table](#the-default-alone)): ahead in {count('ahead')} of {len(alone)} (at {at('ahead')}), behind in {count('behind')} (at {at('behind')}).")
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
    yield ("**`implicit` or a chosen layer**: the best error of `esmc` `implicit`, whose stiffness follows from tick and `delay_ticks`, over "
           "that of `esmc` `saturation` with a search for its layer: " + listed(parts) + ".")
    for other, said in (("super_twisting", "An integral, `super_twisting`"), ("implicit_coupled", "All channels together, `implicit_coupled`")):
        parts = []
        for world in study.WORLDS:
            values = [s.best((f"esmc {other}",), (world, m))[0] / s.best(("esmc implicit",), (world, m))[0] for m in study.MECHANISMS if m != "lengths"]
            parts.append(f"{span(values)} ({WORLD[world]})")
        lengths = span([s.best((f"esmc {other}",), (w, "lengths"))[0] / s.best(("esmc implicit",), (w, "lengths"))[0] for w in study.WORLDS])
        yield f"**{said}**: the best error of `esmc` with it over that with `implicit` is {listed(parts)}; with wrong lengths {lengths}."
    values = [s.best(("esmc super_twisting",), c)[0] / s.best(("smc super_twisting",), c)[0] for c in study.CONDITIONS]
    yield (f"**With an integral in both** the best error of `esmc` is {span(values)} times that of `smc`. The integral helps, not the number of "
           "surfaces; [a disturbance observer](#beside-a-disturbance-observer) does for every law what the integral does for these.")
    parts = []
    for world in study.WORLDS:
        sign, smooth = s.best(("esmc sign",), (world, "exact")), s.best(("esmc implicit",), (world, "exact"))
        parts.append(f"{sizes(sign[0])} at {sign[1]:.2g} N m per tick against {sizes(smooth[0])} at {smooth[1]:.2g} ({WORLD[world]})")
    yield "**`sign`** against `implicit`, exact mechanism, each at its best: " + "; ".join(parts) + "."
    values = [s.best(("ctc",), c)[0] / s.best(MINE, c)[0] for c in study.CONDITIONS]
    yield f"**`ctc`**, with a search for both poles, reaches {span(values)} times the best error of ESMC without an integral."
    values = [s.best(("pd",), c)[0] / s.best(MINE, c)[0] for c in study.CONDITIONS]
    yield f"**`pd`**, which needs no model, reaches {span(values)} times the best error of ESMC without an integral."
    for world in study.WORLDS:
        pair = {m: [c.cell() or "none" for b in BUDGETS for c in [Comparison(s, (world, m), b)]] for m in ("exact", "joined")}
        changed = [f"{budget_name(b)} {x.replace('*', '')}, joined {y.replace('*', '')}"
                   for b, x, y in zip(BUDGETS, pair["exact"], pair["joined"]) if x.split()[0] != y.split()[0]]
        yield (f"**Effect of the start** ({WORLD[world]}): " +
               ("the verdict is the same without the jump at the start." if not changed else "the verdict differs at " + "; ".join(changed) + "."))
    for world in study.WORLDS:
        exact, masses, both = (s.best(PLAIN, (world, m))[0] for m in ("exact", "masses", "lengths"))
        yield (f"**Cost of a wrong model** ({WORLD[world]}): the smallest error of any law without an integral is {sizes(exact)} with the exact mechanism, "
               f"{sizes(masses)} with wrong masses, {sizes(both)} with wrong lengths as well.")


def fronts(s):
    out = ["| environment | mechanism | laws on the front, with the number of settings |", "|---|---|---|"]
    for w, m in study.CONDITIONS:
        members = sorted(s.on_front((w, m)).items(), key=lambda item: -item[1])
        out.append(f"| {WORLD[w]} | {MECHANISM[m]} | " + ", ".join(f"{code(law)} {n}" for law, n in members) + " |")
    return "\n".join(out) + "\n"


def second_name(law, value):
    return f"{ {'gain': 'k', 'rate': 'L', 'pole': 'mu'}[study.LAWS[law][2]]} {value:g}"


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
    columns = []
    for board in ("mps2-an386", "mps2-an500"):
        counted = page.part(BOARDS, f"count {board}")
        columns.append({m[1]: int(m[2]) for m in re.finditer(r"^\| `(\w+)` \| \d+ \| (\d+) \|", counted, re.M)})
    return {law: (columns[0][law], columns[1][law]) for law in columns[0]}


def costs(s, counted):
    out = "| law | M4F, float | M7, double | best error: " + " | ".join(f"{WORLD[w]}" for w in study.WORLDS) + " |\n|---|---|---|---|---|---|\n"
    for law, (four, seven) in counted.items():
        kind = [name for name in PLAIN if study.LAWS[name][0] == law]
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
    out = "## Results\n\n" + "".join(f"* {line}\n" for line in sentences(s, counted))
    out += ("\n### Ratio of best errors\n\nBest error of the other laws over best error of ESMC (`esmc` and `esmc_projected`, any reaching), all without an integral; above 1 ESMC is better. For bounds on the "
            f"activity in N m per tick. Level: within {100 * (LEVEL - 1):.0f} %, where the worse may use {100 * (LEVEL - 1):.0f} % more activity.\n\n")
    out += verdicts(comparisons(s)) + "\n### The default alone\n\nThe same for `esmc` `implicit` and `ctc`; no number: one of them has no setting as quiet.\n\n"
    out += verdicts(comparisons(s, *DEFAULT)) + "\n### The front of all laws\n\n" + (
        f"A setting is on the front if no other one is as good in both and {100 * (LEVEL - 1):.0f} % better in one.\n\n") + fronts(s)
    for world in study.WORLDS:
        out += (f"\n### Environment: {WORLD[world]}\n\n![Error against torque activity](images/laws_{world}.svg)\n\n"
                f"Smallest error of each law, its activity (N m per tick) and setting; bold: within {100 * (LEVEL - 1):.0f} % of the smallest "
                "of all.\n\n" + table(s, world))
    out += ("\n### Sensitivity to tuning\n\nShare of a law's settings within twice the smallest error of any law with, or without, an integral like itself, at no more than 0.02 N m per "
            "tick; " + listed(MECHANISM[m] for m in study.MECHANISMS) + ".\n\n" + robust(s))
    return out + "\n### Time per tick\n\n" + (
        "Instructions of a whole tick, mean, counted in the emulator with `implicit` "
        "([boards.md](boards.md#instructions-per-tick)), beside the smallest error with any reaching but `super_twisting`, whose ticks take more ([reaching.md](reaching.md)), mechanisms in the same order.\n\n") + costs(s, counted)


def beside_row(esmc, law):
    """Smallest errors of a law alone, and beside the best observer, within bounds on the activity."""
    cells = []
    for bandwidths in ((0.0,), () if law in INTEGRAL else study.OBSERVERS[1:]):
        points = [(e, a, b) for b in bandwidths for e, a in study.observed(esmc, law, b)]
        for budget in QUIET:
            error, _, bandwidth = min((p for p in points if p[1] <= budget), default=(None, 0, 0))
            cells.append("" if error is None else sizes(error) + (f" ({bandwidth:g}/s)" if bandwidth else ""))
    return f"| {code(law)} | " + " | ".join(cells) + " |\n"


def beside(esmc, laws=study.OBSERVED):
    head = "| law | " + " | ".join(f"{who}, {budget_name(b)}" for who in ("alone", "with observer") for b in QUIET) + " |\n"
    return head + "|---" * (1 + 2 * len(QUIET)) + "|\n" + "".join(beside_row(esmc, law) for law in laws)


def write(scores):
    s = Study(scores)
    page.put(PAGE, {"study": text(s, instructions())})
    for name, picture in figures(s):
        (DOCS / "images" / name).write_text(picture, encoding="utf-8")


def check(esmc, scores):
    """What is wrong with what is kept."""
    s = Study(scores)
    wanted = [(law, w, "exact", *s.best((law,), (w, "exact"))[2]) for law in study.LAWS for w in study.WORLDS]
    wanted += [(law, "ideal", "lengths", *s.best((law,), ("ideal", "lengths"))[2]) for law in study.LAWS]
    wanted += [(law, "friction", "masses", *s.best((law,), ("friction", "masses"))[2]) for law in ("esmc implicit", "ctc")]
    wanted += [(law, w, "exact", *study.settings(law)[20]) for law in study.LAWS for w in ("ideal", "encoders")]  # any of the others
    now = study.measure(esmc, [(*w[:4], (w[4],)) for w in dict.fromkeys(wanted)])
    for key, values in now.items():
        if values != scores[key]:
            yield f"docs/laws.csv: {key}: {scores[key]} is kept, the program computes {values}"
    if (row := beside_row(esmc, "ctc")) not in page.part(PAGE, "observer"):
        yield f"docs/laws.md: the row of ctc beside an observer is now {row}: laws_page.py ESMC --observer"
    kept = page.part(PAGE, "study")
    stated = {m[1]: (int(m[2]), int(m[3])) for m in re.finditer(r"^\| `(\w+)` \| (\d+) \| (\d+) \|", kept, re.M)}
    if stated.keys() != instructions().keys() or text(s, stated) != kept:
        yield "docs/laws.md: the text is not what docs/laws.csv says: laws_page.py --redraw"
    # boards.md has a test of its own, and instructions change a little with every change of the code.
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
    if len(arguments) == 2 and arguments[1] == "--observer":
        page.put(PAGE, {"observer": beside(arguments[0])})
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
