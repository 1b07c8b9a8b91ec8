"""Hook of the site: a link out of docs/ leads to the repository, which is not part of the site. Its text stays, with the path."""
import re

OUTSIDE = re.compile(r"\[([^\]]+)\]\(\.\./([^)\s#]+)[^)]*\)")


def on_page_markdown(markdown, **_):
    return OUTSIDE.sub(lambda m: m[1] if m[2] in m[1] else f"{m[1]} (`{m[2]}`)", markdown)
