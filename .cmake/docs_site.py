"""Hooks of the site. A link out of docs/ leads to the repository, which is not part of the site: its text stays, with the path. An
equation that a sentence names, like [F29], becomes a link to the page that has it."""
import re

OUTSIDE = re.compile(r"\[([^\]]+)\]\(\.\./([^)\s#]+)[^)]*\)")
CODE = re.compile(r"(^```.*?^```$|^    [^\n]*$|`[^`\n]+`)", re.M | re.S)
EQUATION = re.compile(r"(?<![\\\[])\[(F(?:[1-9]|[1-3]\d)b?)\](?![(\]])")


def on_page_markdown(markdown, page, **_):
    text = OUTSIDE.sub(lambda m: m[1] if m[2] in m[1] else f"{m[1]} (`{m[2]}`)", markdown)
    if page.file.src_uri == "model.md":
        return text
    parts = CODE.split(text)
    parts[::2] = [EQUATION.sub(r"[\\[\1\\]](model.md#\1)", part) for part in parts[::2]]
    return "".join(parts)
