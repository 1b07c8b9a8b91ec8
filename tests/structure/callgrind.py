"""What callgrind says of a program, by function: instructions of its own, and calls of it with all that they call."""
import re
import subprocess
import tempfile
from pathlib import Path


def read(lines):
    """({function: instructions of its own}, {function: [calls, instructions with all they call]})."""
    names, own, calls, here, callee, pending = {}, {}, {}, None, None, 0
    for line in lines:
        if m := re.match(r"(c?fn)=\((\d+)\)(?: (.*))?", line):
            if m[3]:
                names[m[2]] = m[3]
            if m[1] == "fn":
                here = names[m[2]]
            else:
                callee = names[m[2]]
        elif m := re.match(r"calls=(\d+)", line):
            pending = int(m[1])
        elif here and re.match(r"[+\-*\d]", line):
            cost = int(line.split()[-1])
            if pending:  # the line after `calls`: what these cost
                entry = calls.setdefault(callee, [0, 0])
                entry[0] += pending
                entry[1] += cost
                pending = 0
            else:
                own[here] = own.get(here, 0) + cost
    return own, calls


def profile(*command):
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "calls"
        subprocess.run(["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", *command], stdout=subprocess.DEVNULL,
                       stderr=subprocess.DEVNULL, check=True)
        return read(out.read_text(encoding="utf-8", errors="replace").splitlines())


def self_test():
    text = ("fn=(1) main\n10 5\ncfn=(2) auto called<Law>()\ncalls=4 7\n10 4000\ncfn=(3) other\ncalls=9 1\n10 9\ncfn=(2)\ncalls=1 7\n11 1500\n"
            "fn=(2)\n+3 1000\n* 40\n")
    own, calls = read(text.splitlines())
    assert own == {"main": 5, "auto called<Law>()": 1040}, own
    assert calls == {"auto called<Law>()": [5, 5500], "other": [9, 9]}, calls
