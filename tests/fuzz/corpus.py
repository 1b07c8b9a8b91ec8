"""Kept inputs of a target: a text file with one input per line, in base64."""

import base64
import hashlib
from pathlib import Path


def unpack(packed, folder):
    """Writes the inputs into an empty or new folder; how many there are."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.iterdir():
        old.unlink()
    lines = Path(packed).read_text(encoding="ascii").split() if Path(packed).is_file() else []
    for line in lines:
        data = base64.b64decode(line, validate=True)
        (folder / hashlib.sha1(data).hexdigest()).write_bytes(data)
    return len(lines)


def pack(folder, packed):
    """Smallest first; how many and how large."""
    inputs = sorted((f.read_bytes() for f in Path(folder).iterdir()), key=lambda d: (len(d), d))
    Path(packed).parent.mkdir(parents=True, exist_ok=True)
    Path(packed).write_text("".join(base64.b64encode(d).decode() + "\n" for d in inputs if d), encoding="ascii")
    return len(inputs), Path(packed).stat().st_size
