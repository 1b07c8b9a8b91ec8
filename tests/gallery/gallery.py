#!/usr/bin/python3
"""The hard cases of gallery.toml: each against its criterion, a usual method beside it, with a picture. Python's standard library only.

usage: gallery.py ESMC --row NAME   one case: the program meets the criterion, the usual method does not
       gallery.py ESMC              all of them, and docs/gallery.md and its pictures are what comes out
       gallery.py ESMC --update     writes page and pictures
       gallery.py --self-test       a case that fails is found, one that proves nothing too"""
import math
import re
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(HERE), str(ROOT / "tests/docs")]

import joint_cases  # noqa: E402
import mechanism_cases  # noqa: E402
import page  # noqa: E402
from effect_figures import same as same_picture, svg  # noqa: E402
from run import Program  # noqa: E402

PAGE, IMAGES = ROOT / "docs/gallery.md", ROOT / "docs/images"
POINTS = 250
DIVERGED = 1e6  # of anything that is measured here


def case_list():
    with open(HERE / "gallery.toml", "rb") as file:
        return tomllib.load(file)



def judged(name, row, result):
    """Problems of one case: the criterion not met, or met by the usual method as well."""
    if not result["ours"] <= row["most"]:
        yield f"{name}: {row['what']} is {result['ours']:.3g} {row['unit']}, allowed {row['most']:g}"
    if result["usual"] <= row["most"]:
        yield f"{name}: the usual method meets the criterion, too: {result['usual']:.3g} {row['unit']}"


def framed(curves):
    """Thinned; the last curve, the usual method's, is cut off where it leaves the picture of the others by their own height."""
    thin = [(label, points[::max(1, len(points) // POINTS)]) for label, points in curves]
    others = [v for _, points in thin[:-1] for _, v in points]
    low, high = min(others), max(others)
    room = (high - low) or max(abs(v) for _, v in thin[-1][1])
    label, points = thin[-1]
    if max(abs(v) for _, v in points) > 50 * room + max(abs(low), abs(high)):  # diverges
        out = next(k for k, (_, v) in enumerate(points) if not low - room <= v <= high + room)
        points = [(t, min(max(v, low - room), high + room)) for t, v in points[:out + 1]]
    return thin[:-1] + [(label, points)]


def picture(name, row, curves):
    curves = framed(curves)
    times = [t for _, points in curves for t, _ in points]
    return svg(row["title"], row["y"], min(times), max(times), curves, row.get("x", "t, s"))


def number(value, unit):
    if not value < DIVERGED:
        return "diverges"
    return f"{value:.2g} {unit}".strip()


def limit(row):
    return f"{row['most']:g} {row['unit']}".strip()


def table(rows, results):
    out = "| case | measured | at most | here | usual method |\n|---|---|---|---|---|\n"
    for name, row in rows.items():
        r = results[name]
        anchor = re.sub(r"[^a-z0-9 -]", "", row["title"].lower()).replace(" ", "-")
        unit = "" if row["unit"] == "m, rad" else row["unit"]
        out += (f"| [{row['title']}](#{anchor}) | {row['what']} | {limit(row)} | {number(r['ours'], unit)} | "
                f"{number(r['usual'], unit)} |\n")
    return out


def section(name, row):
    tests = ", ".join(f"`{t}`" for t in [f"gallery.{name}", *row["tests"]])
    return (f"\n### {row['title']}\n\n{row['case']}\n\n* Usual: {row['usual']}\n* Here: {row['ours']}\n"
            f"* Criterion: {row['what']}, at most {limit(row)}: {row['why']}. Judge: {row['judge']}.\n"
            f"* Tests: {tests}\n\n![{row['alt']}](images/gallery_{name}.svg)\n")


def same_text(shown, made):
    """Equal but for numbers of measured columns, which may differ by a tenth; what is below 1e-8 is rounding and free."""
    pattern = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")
    if pattern.sub("#", shown) != pattern.sub("#", made):
        return False
    pairs = zip(map(float, pattern.findall(shown)), map(float, pattern.findall(made)))
    return all(abs(a - b) <= max(1e-8, 0.1 * abs(a)) for a, b in pairs)


def known_tests():
    """Names of unit tests, and of tests and targets in CMake."""
    units = "".join(f.read_text(encoding="utf-8") for f in (ROOT / "tests/unit").glob("*.cpp"))
    cmake = (ROOT / "tests/CMakeLists.txt").read_text(encoding="utf-8")
    names = {f"{suite}.{name}" for suite, name in re.findall(r"^TEST(?:_F|_P)?\((\w+), (\w+)\)", units, re.M)}
    names |= set(re.findall(r"(?:add_test\(NAME|long_test_if_sanitized\(|long_test\(|unit_test\(|add_custom_target\()\s*([\w.]+)", cmake))
    return names | {f"cli.{n}" for line in re.findall(r"(?:set\(|list\(APPEND )checks ([^)]*)\)", cmake) for n in line.split()} | {
        f"cli.{n}" for n in re.findall(r"cli_command\((\w+)", cmake)}


def check_page(rows, results, update):
    _, shown, tail = page.cut(PAGE.read_text(encoding="utf-8"), "gallery")
    made = table(rows, results) + "".join(section(n, r) for n, r in rows.items()) + "\n"
    if update:
        page.put(PAGE, {"gallery": made})
    elif not same_text(shown, made):
        yield "docs/gallery.md is not what comes out: gallery.py ESMC --update"
    for name, row in rows.items():
        file, drawn = IMAGES / f"gallery_{name}.svg", picture(name, row, results[name]["curves"])
        if update:
            file.write_text(drawn, encoding="utf-8")
        elif not file.is_file() or not same_picture(file.read_text(encoding="utf-8"), drawn):
            yield f"{file.relative_to(ROOT)} is not what comes out: gallery.py ESMC --update"
    named = {t for row in rows.values() for t in row["tests"]}
    named |= {t for cell in re.findall(r"\| (`\S+`(?:, `\S+`)*) \|$", tail, re.M) for t in re.findall(r"`([^`]+)`", cell)}
    for test in sorted(named - known_tests()):
        yield f"there is no test {test}"


def self_test():
    row = {"what": "error", "unit": "rad", "most": 1e-8}
    good, bad = {"ours": 1e-9, "usual": 1e-3}, {"ours": 2e-8, "usual": 1e-3}
    expected = [(good, 0), (bad, 1), ({"ours": math.nan, "usual": math.inf}, 1), ({"ours": 1e-9, "usual": 1e-9}, 1), ({"ours": 1, "usual": 0}, 2)]
    failed = sum(len(list(judged("case", row, result))) != count for result, count in expected)
    failed += same_text("a 1.5 rad", "a 1.8 rad") + same_text("a 1 rad", "b 1 rad") + (not same_text("a 1.5e-12", "a 3e-15"))
    print(f"{failed} of {len(expected) + 3} seeded cases misjudged")
    return 1 if failed else 0


def main():
    arguments = sys.argv[1:]
    if arguments == ["--self-test"]:
        return self_test()
    rows = case_list()
    if len(arguments) == 3 and arguments[1] == "--row" and arguments[2] in rows:
        rows = {arguments[2]: rows[arguments[2]]}
    elif len(arguments) != 1 and arguments[1:] != ["--update"]:
        print(__doc__, file=sys.stderr)
        return 2
    program = Program(arguments[0])
    find = lambda name: getattr(joint_cases, name, None) or getattr(mechanism_cases, name)
    with ThreadPoolExecutor(2) as pool:
        results = dict(zip(rows, pool.map(lambda name: find(name)(program), rows)))
    found = [p for name, row in rows.items() for p in judged(name, row, results[name])]
    if "--row" not in arguments:
        found += check_page(rows, results, "--update" in arguments)
    for name, row in rows.items():
        print(f"{name}: here {number(results[name]['ours'], row['unit'])}, at most {row['most']:g}; usual {number(results[name]['usual'], row['unit'])}")
    print(*found, f"{len(rows)} cases, {len(found)} problems", sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
