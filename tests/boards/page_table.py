"""A table of a page that a program makes: between <!-- NAME --> and <!-- /NAME -->."""
import re
from pathlib import Path

NUMBER = r"\b\d+\b"


def same(old, new, rounding):
    """Whether two lines have the same words, and whole numbers that differ by `rounding` at most."""
    return re.sub(NUMBER, "", old) == re.sub(NUMBER, "", new) and all(
        abs(int(a) - int(b)) <= rounding for a, b in zip(re.findall(NUMBER, old), re.findall(NUMBER, new)))


def check_some(page, name, table, _=False, rounding=0):
    """0 if the page has all lines of this table, and maybe more."""
    text = Path(page).read_text(encoding="utf-8")
    old = text.split(f"<!-- {name} -->\n")[1].split(f"<!-- /{name} -->")[0].splitlines()
    missing = [line for line in table.splitlines() if not any(same(o, line, rounding) for o in old)]
    print(table)
    if missing:
        print(f"{Path(page).name} does not have:", *missing, sep="\n")
    return int(bool(missing))


def check(page, name, table, update, rounding=0):
    """0 if the page has this table, or got it (`update`)."""
    text = Path(page).read_text(encoding="utf-8")
    begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    head, rest = text.split(begin)
    old, tail = rest.split(end)
    print(table)
    if update:
        Path(page).write_text(head + begin + table + end + tail, encoding="utf-8")
    elif old.count("\n") != table.count("\n") or not all(
            same(o, t, rounding) for o, t in zip(old.splitlines(), table.splitlines())):
        print(f"{Path(page).name} says otherwise; regenerate it with --update:\n{old}")
        return 1
    return 0
