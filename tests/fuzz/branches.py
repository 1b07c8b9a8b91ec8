"""What inputs reach of the source: which conditions were true and which false, by clang's own count.

Edges of a program depend on what the optimiser made of it, and each instantiation of a template has its own; here a condition
is what the source text says, in whichever instantiation."""

import fnmatch
import json
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/structure"))
from coverage import gather, violations  # noqa: E402

FOLDERS = ("firmware", "hal", "host_sim/scene", "host_sim/record")
# Of these targets other folders: what others link of the drives is not what they are for, and the cycle behind a clock has its own targets.
OWN = {"drives": (*FOLDERS, "host_sim/drives"), "clock": ("boards",)}


UNREACHED = Path(__file__).with_name("unreached.txt")


def explained(target, missing):
    """What is missing and has no line in unreached.txt, and the lines there that are not missing any more."""
    def key(text):
        file, what = re.fullmatch(r"([^:]+):\d+:\d+: (never .*)", text).groups()
        return file, what
    known = set()
    for line in UNREACHED.read_text(encoding="utf-8").splitlines():
        if not line or line.startswith("#"):
            continue
        targets, file, what, _ = (part.strip() for part in line.split(" | ", 3))
        if any(fnmatch.fnmatch(target, t) for t in targets.split()):
            known.add((file, what))
    found = {key(m) for m in missing}
    return [m for m in missing if key(m) not in known], sorted(f"{f}: {w}" for f, w in known - found)


def tools(program):
    """llvm-profdata and llvm-cov of the clang that made it, or those without a number."""
    version = subprocess.run(["readelf", "-p", ".comment", program], capture_output=True, text=True, check=True).stdout
    number = next((w.split(".")[0] for line in version.splitlines() if "clang" in line for w in line.split() if w[0].isdigit()), "")
    found = lambda name: next(n for n in (f"{name}-{number}", name) if any((Path(d) / n).exists() for d in os.environ["PATH"].split(":")))  # noqa: E731
    return found("llvm-profdata"), found("llvm-cov")


def measure(program, folder):
    """({outcome reached}, {outcome of a function that ran}, [text of what is not reached]) of all inputs of a folder."""
    folders = OWN.get(Path(program).name.removeprefix("fuzz_").removesuffix("_branches"), FOLDERS)
    raw, merged = folder.parent / "branches.profraw", folder.parent / "branches.profdata"
    subprocess.run([program, "-runs=0", folder], env=os.environ | {"LLVM_PROFILE_FILE": str(raw)}, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL, check=True)
    profdata, cov = tools(program)
    subprocess.run([profdata, "merge", "-sparse", raw, "-o", merged], check=True)
    text = subprocess.run([cov, "export", program, f"-instr-profile={merged}"], capture_output=True, check=True).stdout
    functions = [f for f in json.loads(text)["data"][0]["functions"] if f["count"] > 0]
    lines, branches = gather(functions, ROOT, folders)
    reached, all_ = set(), set()
    for file, of_file in branches.items():
        for place, counts in of_file.items():
            for outcome, count in enumerate(counts):
                all_.add((file, place, outcome))
                if count > 0:
                    reached.add((file, place, outcome))
    missing = [v for v in violations(lines, branches, ROOT, folders) if "never true" in v or "never false" in v]
    return reached, all_, missing
