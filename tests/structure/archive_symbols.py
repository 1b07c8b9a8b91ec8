#!/usr/bin/env python3
"""What a control archive may need from the outside, and what it may hold.

Undefined symbols: its own (_ZN4esmc..., _ZNK4esmc...), the four memory functions a compiler calls by itself, the
square root, and what --allow names. Everything else fails, so the heap, exceptions, RTTI, stdio, the rest of libm
and the guards of static locals fail by being unknown; the report says which kind it is. Held: no object in a
writable section, no vtable or type_info, no constructor that runs before main.

With --self-test the objects of the violations below are compiled and each must be found.
"""

import argparse
import pathlib
import re
import subprocess
import sys
import tempfile

ALLOWED = re.compile(r"(_ZNK?4esmc.*|mem(cpy|move|set|cmp)|sqrtf?|_GLOBAL_OFFSET_TABLE_)$")
KINDS = [
    ("heap", r"(malloc|calloc|realloc|free|aligned_alloc|posix_memalign|_Zn[wa].*|_Zd[la].*)$"),
    ("static local", r"(__cxa_guard_.*|_ZGV.*|__cxa_atexit|__dso_handle)$"),
    ("exception", r"(__cxa_.*|_Unwind_.*|__gxx_personality.*|_ZSt\d+__throw.*|_ZSt9terminatev|abort|__assert_fail)$"),
    ("RTTI", r"(_ZT[ISV].*|__dynamic_cast|_ZTVN10__cxxabiv.*)$"),
    ("stdio", r"(.*printf.*|puts|putchar|f?write|fputs|fopen|stdout|stderr|_ZSt4cout|_ZNSo.*|_ZStls.*)$"),
    ("libm", r"(sin|cos|tan|asin|acos|atan2?|sinh|cosh|tanh|exp2?|log(2|10)?|pow|f?mod|hypot|cbrt|fma|sincos)f?l?$"),
]
WRITABLE = re.compile(r"(\.data(?!\.rel\.ro)|\.bss|\.tdata|\.tbss|\*COM\*|COMMON)")
STARTUP = re.compile(r"\s(\.init_array|\.ctors|\.preinit_array)")


def kind_of(symbol):
    return next((kind for kind, pattern in KINDS if re.match(pattern, symbol)), "unknown function")


def run(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def rows(nm, archive):
    """(name, class, section) of every symbol."""
    for line in run(nm, "--format=sysv", archive).splitlines():
        column = [c.strip() for c in line.split("|")]
        if len(column) == 7 and column[0] != "Name":
            yield column[0], column[2], column[6]


def violations(nm, objdump, archive, allow=None):
    symbols = list(rows(nm, archive))
    if not symbols:
        return [("empty", f"{archive} has no symbols: nothing was checked")]
    defined = {name for name, kind, _ in symbols if kind not in "Uwv"}
    found = []
    for name, kind, section in symbols:
        if name in defined and kind in "Uwv":
            continue
        if kind in "Uwv":
            if not ALLOWED.match(name) and not (allow and re.fullmatch(allow, name)):
                found.append((kind_of(name), f"needs {name}"))
            continue
        if name.startswith(("_ZTI", "_ZTS", "_ZTV")):
            found.append(("RTTI", f"holds {name}"))
        if name.startswith("_ZGV"):
            found.append(("static local", f"holds {name}"))
        if WRITABLE.match(section) or kind in "BDbdCSGsg":
            found.append(("writable data", f"holds {name} in {section}"))
    if STARTUP.search(run(objdump, "-h", archive)):
        found.append(("startup code", "has constructors that run before main"))
    return sorted(set(found))


# kind, source: each must be reported with its kind, and the last must not be reported at all.
SEEDED = [
    ("heap", "void* f() { return new int; }"),
    ("heap", "#include <stdlib.h>\nvoid* f() { return malloc(3); }"),
    ("heap", "void f(int* p) { delete[] p; }"),
    ("exception", "void f() { throw 1; }"),
    ("exception", "#include <vector>\nint f(std::vector<int>& v) { return v.at(3); }"),
    ("RTTI", "#include <typeinfo>\nstruct A { virtual ~A(); };\nconst std::type_info& f() { return typeid(A); }"),
    ("RTTI", "struct A { virtual void f(); };\nvoid A::f() {}"),
    ("RTTI", "struct A { virtual ~A(); }; struct B : A {};\nB* f(A* a) { return dynamic_cast<B*>(a); }"),
    ("stdio", "#include <stdio.h>\nvoid f(int i) { printf(\"%d\", i); }"),
    ("libm", "#include <math.h>\ndouble f(double x) { return sin(x); }"),
    ("libm", "#include <math.h>\nfloat f(float y, float x) { return atan2f(y, x); }"),
    ("static local", "int g();\nint f() { static int once = g(); return once; }"),
    ("writable data", "int counter; int f() { return ++counter; }"),
    ("writable data", "static int counter = 7; int f() { return ++counter; }"),
    ("writable data", "int f() { static int counter; return ++counter; }"),
    ("writable data", "inline int counter = 7; int f() { return ++counter; }"),
    ("writable data", "template <class T> struct A { static T v; }; template <class T> T A<T>::v = 1;\n"
                      "int f() { return ++A<int>::v; }"),
    ("writable data", "thread_local int counter; int f() { return ++counter; }"),
    ("startup code", "int g(); extern const int once; const int once = g();"),
    ("unknown function", "extern \"C\" void clock_somehow(); void f() { clock_somehow(); }"),
    (None, "#include <math.h>\n#include <string.h>\nextern const double table[3];\n"
           "const double table[3] = {1, 2, 3};\n"
           "double f(double x, int i) { return sqrt(x) + sqrtf(3.0f) + table[i]; }\n"
           "namespace esmc { int other(); int mine() { return other(); } }\n"
           "void g(char* a, const char* b, int n) { memcpy(a, b, (unsigned)n); }"),
]


def self_test(nm, objdump, cxx):
    failed = 0
    with tempfile.TemporaryDirectory() as scratch:
        for i, (kind, source) in enumerate(SEEDED):
            file = pathlib.Path(scratch, f"case{i}.cpp")
            file.write_text(source)
            made = file.with_suffix(".o")
            run(cxx, "-std=c++20", "-O1", "-c", str(file), "-o", str(made))
            found = violations(nm, objdump, str(made))
            good = kind in {k for k, _ in found} if kind else not found
            if not good:
                failed += 1
                print(f"archive_symbols.py: should find {kind or 'nothing'} in\n{source}\nfound {found}")
    print(f"{len(SEEDED) - failed} of {len(SEEDED)} seeded objects judged rightly")
    return failed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("archives", nargs="*")
    parser.add_argument("--nm", default="nm")
    parser.add_argument("--objdump", default="objdump")
    parser.add_argument("--cxx", default="c++")
    parser.add_argument("--allow", help="regular expression of further symbols that may be undefined")
    parser.add_argument("--self-test", action="store_true")
    options = parser.parse_args()
    if options.self_test:
        return 1 if self_test(options.nm, options.objdump, options.cxx) else 0
    if not options.archives:
        parser.error("no archive given: nothing would be checked")
    failed = False
    for archive in options.archives:
        for kind, what in violations(options.nm, options.objdump, archive, options.allow):
            failed = True
            print(f"{archive}: {kind}: {what}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
