#!/usr/bin/python3
"""The deepest stack of an image, from the call graph that the compiler wrote beside each object (-fcallgraph-info=su).

usage: stack_bound.py ELF BUILD_FOLDER
       stack_bound.py --self-test

Sums the frames along every path from esmc_reset, and adds those of the interrupt that may come on top. Refused: recursion, calls through pointers, frames whose size is known at run
time only, unknown functions. One exception: what the controller calls through a pointer is an optional part, a function
of namespace esmc::part, or nothing (null). Such a call counts as one of every part that is in the image; without any it calls none.
Frames of the C library's few functions are read from their instructions. On top comes what an exception pushes.
Exit 1 where the bound is above what the image reserves."""
import re
import subprocess
import sys
from pathlib import Path

EXCEPTION = 112  # 26 registers with the FPU's, and 8 for alignment
HANDLER = "esmc_can_interrupt"
GUARD = 256      # the lowest part of the reserve must stay unused
INDIRECT = "__indirect_call"                # as gcc names the target of a call through a pointer
PART = re.compile(r"_ZN4esmc4part")         # mangled: functions of esmc::part
CALLER = re.compile(r"_Z+NK?4esmc10ControllerI")  # and of esmc::Controller, lambdas within them too
RELAY = re.compile(r"_ZN4esmc4part12elbow_rotorsI")  # the one part that calls another, `behind` it


class Refused(Exception):
    pass


def read_graph(texts):
    """{function: (bytes, kind)}, {function: set of called}. Definitions carry their file before their name, calls may not; of
    functions of one name, templates or not, the largest frame and all calls count."""
    frames, calls = {}, {}
    for text in texts:
        for m in re.finditer(r'node: \{ title: "([^"]+)" label: "([^"]*)"', text):
            size = re.search(r"\\n(\d+) bytes \(([^)]*)\)", m[2])
            if size:
                name = m[1].rpartition(":")[2]
                old, kind = frames.get(name, (0, "static"))
                frames[name] = (max(old, int(size[1])), size[2] if kind == "static" else kind)
        for m in re.finditer(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text):
            calls.setdefault(m[1].rpartition(":")[2], set()).add(m[2].rpartition(":")[2])
    return frames, calls


def with_parts(calls, image):
    """The same calls, where those through pointers in the controller, and in the part that calls another one, are of all optional parts
    in the image; of the latter not of itself, for `behind` is never the part that `reach` is."""
    parts = {f for f in image if PART.match(f)}
    return {f: (called - {INDIRECT}) | parts - {f} if INDIRECT in called and (CALLER.match(f) or RELAY.match(f)) else called
            for f, called in calls.items()}


def library_frame(listing):
    """Bytes that a function of the C library pushes, and the functions it calls."""
    if called := re.search(r"\tblx\t.*", listing):
        raise Refused(f"a library function that calls through a pointer: {called[0]}")
    words = 0
    for m in re.finditer(r"\t(?:push|stmdb\tsp!,|v?push)(?:\.w)?\t?\s*\{([^}]*)\}", listing):
        for part in m[1].split(","):
            ends = re.fullmatch(r"\s*[rsd](\d+)-[rsd](\d+)\s*", part)
            words += (int(ends[2]) - int(ends[1]) + 1 if ends else 1) * (2 if part.strip().startswith("d") else 1)
    local = sum(int(m[1]) for m in re.finditer(r"\tsub\tsp, (?:sp, )?#(\d+)", listing))
    single = 4 * len(re.findall(r"\tstr(?:\.w)?\t\w+, \[sp, #-4\]!", listing))
    return 4 * words + local + single, set(re.findall(r"\tb(?:l|\.w)\t[0-9a-f]+ <(\w+)>", listing))


def bound(frames, calls, start, library):
    """(bytes, path) of the deepest path from `start`; `library(name)`: bytes and calls of what the graph does not know."""
    known = {}

    def deepest(f, above):
        if f in above:
            raise Refused("recursion: " + " -> ".join(above[above.index(f):] + [f]))
        if f in known:
            return known[f]
        if f == INDIRECT:
            raise Refused("a call through a pointer in " + above[-1])
        (size, kind), called = frames.get(f, (0, "static")), calls.get(f, ())
        if f not in frames:
            if "esmc" in f:
                raise Refused(f"{f} is not in the call graph: was all of it compiled with -fcallgraph-info=su?")
            size, called = library(f)
        if kind != "static" and "bounded" not in kind:
            raise Refused(f"a frame of unknown size: {f} ({kind})")
        best = max((deepest(c, above + [f]) for c in called), default=(0, []))
        known[f] = (size + best[0], [(f, size)] + best[1])
        return known[f]

    return deepest(start, [])


def run(*command):
    return subprocess.run([str(c) for c in command], capture_output=True, text=True, check=True).stdout


def of_image(elf, folder):
    """(bytes at most, path, bytes reserved); raises Refused."""
    frames, calls = read_graph(p.read_text() for p in sorted(Path(folder).rglob("*.ci"))
                               if "boards/CMakeFiles" not in str(p) or f"/{Path(elf).stem}.dir/" in str(p))  # not of other images
    symbols = {n: int(a, 16) for a, n in re.findall(r"^([0-9a-f]+) \w (\S+)$", run("arm-none-eabi-nm", elf), re.M)}
    calls = with_parts(calls, symbols)
    # Of a function that several objects have the linker took one; what only another one calls is not in the image.
    # A function may have several names, a constructor always has: the graph knows the frame of one of them.
    framed = {symbols[f]: f for f in frames if f in symbols}
    calls = {f: {framed.get(symbols.get(c), c) for c in called if c == INDIRECT or c in symbols} for f, called in calls.items()}

    def library(name):
        listing = run("arm-none-eabi-objdump", "-d", f"--disassemble={name}", "--no-show-raw-insn", elf)
        if f"<{name}>:" not in listing:
            raise Refused(f"{name}: no instructions")
        size, called = library_frame(listing)
        return size, called - {name}

    total, path = bound(frames, calls, "esmc_reset", library)
    if HANDLER in symbols:
        total += EXCEPTION + bound(frames, calls, HANDLER, library)[0]
    if len(path) < 5:
        raise Refused(f"the call graph ends after {path[-1][0]}")
    return total + EXCEPTION, path, symbols["esmc_stack_top"] - symbols["esmc_stack_bottom"] - GUARD


def main(elf, folder):
    try:
        total, path, reserved = of_image(elf, folder)
    except Refused as e:
        print(e)
        return 1
    for name, size in path:
        print(f"{size:6} {name[:100]}")
    print(f"at most {total} of {reserved} bytes, {EXCEPTION} of them for an exception")
    return 0 if total <= reserved else 1


def self_test():
    node = 'node: {{ title: "{0}" label: "x\\n{0}\\n{1} bytes ({2})" }}\n'
    edge = 'edge: {{ sourcename: "{}" targetname: "{}" label: "x" }}\n'
    tree = node.format("a", 8, "static") + node.format("b", 100, "static") + node.format("file.cpp:c", 16, "static")
    tree += edge.format("a", "b") + edge.format("a", "c") + edge.format("c", "leaf")
    deepest = bound(*read_graph([tree]), "a", lambda name: (200, set()))
    wrong = [] if deepest == (224, [("a", 8), ("c", 16), ("leaf", 200)]) else [f"deepest path {deepest}"]
    # An image with a controller that calls through a pointer: no part in it, two of them, a part that does the same, somebody else.
    tick, big, small = "_ZNK4esmc10ControllerINS_2RrIfEEE3actEv", "_ZN4esmc4part3bigINS_2RrIfEEEEvv", "_ZN4esmc4part5smallEv"
    relay = "_ZN4esmc4part12elbow_rotorsINS_2RrIfEEEEvv"
    frames = {"a": (8, "static"), tick: (16, "static"), big: (64, "static"), small: (4, "static"), relay: (32, "static")}
    plain = {"a": {tick}, tick: {INDIRECT}}
    for what, calls, image, want in (("no part", plain, {tick}, 24), ("two parts", plain, {tick, big, small}, 88),
                                     ("a small part", plain, {tick, small}, 28),
                                     ("the part that calls another", plain | {relay: {INDIRECT}}, {tick, relay, big}, 120),
                                     ("of a part", plain | {big: {INDIRECT}}, {tick, big}, None),
                                     ("of another", {"a": {INDIRECT}}, {big}, None),
                                     ("around", plain | {big: {tick}}, {tick, big}, None)):
        try:
            got = bound(frames, with_parts(calls, image), "a", lambda name: (0, set()))[0]
        except Refused:
            got = None
        if got != want:
            wrong.append(f"a call through a pointer, {what}: {got}, not {want}")
    for what, more in (("recursion", edge.format("b", "a")), ("pointer", edge.format("b", INDIRECT)),
                       ("a function of ours that is not in the graph", edge.format("b", "esmc_other")),
                       ("dynamic", node.format("d", 8, "dynamic") + edge.format("b", "d"))):
        try:
            bound(*read_graph([tree + more]), "a", lambda name: (200, set()))
            wrong.append(f"{what} was not refused")
        except Refused:
            pass
    listing = "\tpush\t{r4, r5, r7, lr}\n\tvpush\t{d8-d9}\n\tsub\tsp, #24\n\tstr.w\tlr, [sp, #-4]!\n"
    if library_frame(listing + "\tbl\t800d2e4 <memset>\n") != (4 * 4 + 8 * 2 + 24 + 4, {"memset"}):
        wrong.append(f"frame {library_frame(listing)}")
    print("\n".join(wrong) if wrong else "13 of 13")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(self_test() if sys.argv[1:] == ["--self-test"] else main(*sys.argv[1:]))
