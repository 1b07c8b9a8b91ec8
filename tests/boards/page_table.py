"""A table of a page that a program makes: between <!-- NAME --> and <!-- /NAME -->."""
from pathlib import Path


def check(page, name, table, update):
    """0 if the page has this table, or got it (`update`)."""
    text = Path(page).read_text(encoding="utf-8")
    begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    head, rest = text.split(begin)
    old, tail = rest.split(end)
    print(table)
    if update:
        Path(page).write_text(head + begin + table + end + tail, encoding="utf-8")
    elif old != table:
        print(f"{Path(page).name} says otherwise; regenerate it with --update:\n{old}")
        return 1
    return 0
