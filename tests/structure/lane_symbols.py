#!/usr/bin/env python3
"""Files that are compiled for instructions which not every machine has must define nothing but their one entry: of a function
that several files define the linker takes any, and a machine without AVX would run into it.
Usage: lane_symbols.py NM OBJECT..., or --self-test"""

import re
import subprocess
import sys

OWN = re.compile(r"esmc::host::lane_kernel_avx\w+\(.*\)$")


def violations(listing):
    """Of the output of nm -C --defined-only: global and weak symbols that are not the entry; and a missing entry."""
    rows = [line.split(maxsplit=2) for line in listing.splitlines() if len(line.split(maxsplit=2)) == 3]
    visible = [name for _, kind, name in rows if kind.isupper() or kind in "uvw"]
    found = [f"{name} is visible to the linker" for name in visible if not OWN.match(name)]
    return found if any(OWN.match(name) for name in visible) else [*found, "no entry"]


def self_test():
    entry = "0000000000000000 T esmc::host::lane_kernel_avx512(esmc::host::LaneSettings const&)\n"
    cases = [
        (entry, 0),
        (entry + "0000000000000010 t esmc::host::LaneLoop<...>::run(...)\n", 0),
        (entry + "0000000000000010 W std::array<double, 2ul>::operator[](unsigned long)\n", 1),
        (entry + "0000000000000010 V guard variable for x\n", 1),
        (entry + "0000000000000010 u y\n", 1),
        (entry + "0000000000000010 T esmc::arc_tangent2(double, double)\n", 1),
        ("", 1),
    ]
    failed = [listing for listing, n in cases if len(violations(listing)) != n]
    print(f"{len(cases) - len(failed)} of {len(cases)} listings judged rightly")
    return 1 if failed else 0


def main():
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    nm, objects = sys.argv[1], sys.argv[2:]
    failed = 0 if objects else 1
    for name in objects:
        listing = subprocess.run([nm, "-C", "--defined-only", name], check=True, capture_output=True, text=True).stdout
        for violation in violations(listing):
            print(f"{name}: {violation}")
            failed = 1
    return failed


if __name__ == "__main__":
    sys.exit(main())
