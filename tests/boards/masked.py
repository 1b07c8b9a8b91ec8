#!/usr/bin/python3
"""How long an image masks interrupts: not at all, or for a few instructions in a row.

usage: masked.py ELF NUMBER
       masked.py --self-test

NUMBER, of the chip's manual: the interrupt whose vector is the handler, alone. Refused: writes of PRIMASK, BASEPRI or FAULTMASK, and a `cpsid` without its `cpsie` within INSTRUCTIONS that neither branch nor wait.
So few take less than Fdcan::masked_us_max at any clock of the boards, even if each waits a microsecond for a peripheral."""
import pathlib
import re
import struct
import subprocess
import sys
import tempfile

INSTRUCTIONS = 32
BRANCH = re.compile(r"b(?!ic|fi|fc|kpt)[a-z]*(\.[nw])?|cbn?z|tb[bh]|wf[ei]|svc")


def wrong(listing):
    """What masks for too long; the number of sections that do not."""
    found, sections, since = [], 0, None
    for line in listing.splitlines():
        m = re.match(r"\s*([0-9a-f]+):\t([^\t]+)(?:\t(.*))?", line)
        if not m:
            if since and re.match(r"[0-9a-f]+ <", line):
                found.append(f"{since[0]}: interrupts stay masked to the end of the function")
                since = None
            continue
        at, code, rest = m[1], m[2].strip(), m[3] or ""
        if code == "msr" and re.match(r"(?i)(primask|basepri|faultmask)", rest):
            found.append(f"{at}: {code} {rest}")
        elif code == "cpsid":
            since = [at, 0]
        elif code == "cpsie" and since:
            since, sections = None, sections + 1
        elif since:
            since[1] += 1
            if since[1] > INSTRUCTIONS or BRANCH.fullmatch(code) or re.search(r"\bpc\}", rest):
                found.append(f"{since[0]}: interrupts masked, {code} at {at}")
                since = None
    return found, sections


def vectors(elf, handler):
    """Numbers of the interrupts that have this handler."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["arm-none-eabi-objcopy", "-O", "binary", elf, f"{folder}/flash"], check=True)
        words = struct.unpack("<166I", pathlib.Path(folder, "flash").read_bytes()[:4 * 166])
    return [i - 16 for i, word in enumerate(words) if word == handler | 1]


def main(elf, number):
    listing = subprocess.run(["arm-none-eabi-objdump", "-d", "--no-show-raw-insn", elf], capture_output=True, text=True, check=True).stdout
    handler = re.search(r"^([0-9a-f]+) <esmc_can_interrupt>:", listing, re.M)
    numbers = vectors(elf, int(handler[1], 16)) if handler else []
    print(f"interrupt {numbers}")
    if numbers != [int(number)]:
        return 1
    found, sections = wrong(listing)
    print("\n".join(found) or f"interrupts are masked in {sections} places, for {INSTRUCTIONS} instructions at most")
    return 1 if found else 0


def self_test():
    def text(*instructions):
        return "08000000 <f>:\n" + "\n".join(f" {0x8000000 + 2 * i:x}:\t{code}" for i, code in enumerate(instructions)) + "\n\n08001000 <g>:\n 8001000:\tnop\n"
    load = "ldr\tr3, [r0, #0]"
    cases = (((load, "b.n\t8000000 <f>", "bx\tlr"), 0, 0), (("cpsid\tf", load, "bics\tr3, r1", "cpsie\tf"), 0, 1),
             (("cpsid\ti", load, "bne.n\t8000002 <f+2>", "cpsie\ti"), 1, 0), (("cpsid\ti", "bl\t8001000 <g>", "cpsie\ti"), 1, 0),
             (("cpsid\ti", *[load] * 33, "cpsie\ti"), 1, 0), (("cpsid\ti", load), 1, 0), (("msr\tPRIMASK, r0", "bx\tlr"), 1, 0),
             (("cpsid\ti", "cbz\tr0, 8000000 <f>", "cpsie\ti"), 1, 0), (("msr\tBASEPRI, r0",), 1, 0), (("msr\tMSP, r0",), 0, 0))
    failed = [c for c, bad, good in cases if (len(wrong(text(*c))[0]), wrong(text(*c))[1]) != (bad, good)]
    print(f"{len(cases) - len(failed)} of {len(cases)}", *failed)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(self_test() if sys.argv[1:] == ["--self-test"] else main(*sys.argv[1:]))
