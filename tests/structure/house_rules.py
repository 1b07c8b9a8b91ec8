#!/usr/bin/env python3
"""Rules for firmware/ that no compiler flag expresses, looked for in the code without comments and strings.

--self-test puts each violation into a copy of a header and expects it to be found at the right line.
"""

import pathlib
import re
import sys
import tempfile

from sources import code_of

# name, pattern, files excepted (fullmatch of the path), what to do instead
RULES = [
    ("new", r"\b(new|delete)\b(?!\s*;)", None, "no heap"),
    ("std::vector", r"\bstd\s*::\s*(vector|deque|list|map|set|unordered_map|unordered_set)\b", None, "fixed sizes"),
    ("std::function", r"\bstd\s*::\s*(function|bind|any)\b", None, "a template parameter"),
    ("std::string", r"\bstd\s*::\s*(string|string_view|to_string|ostringstream|stringstream)\b", None, "no text"),
    ("smart pointer", r"\bstd\s*::\s*(unique_ptr|shared_ptr|make_unique|make_shared)\b", None, "no heap"),
    ("malloc", r"\b(malloc|calloc|realloc|free|alloca)\s*\(", None, "no heap"),
    ("throw", r"\b(throw|try|catch)\b", None, "return what is wrong"),
    ("dynamic_cast", r"\b(dynamic_cast|typeid|virtual)\b", None, "a template parameter"),
    ("printf", r"\b(f|s|sn|v)?printf\b|\b(f?puts|putchar|fwrite)\s*\(", None, "no output"),
    ("iostream", r"\b(iostream|std\s*::\s*(cout|cerr|clog|ostream|istream))\b", None, "no output"),
    ("dynamic Eigen", r"\b(Eigen\s*::\s*Dynamic|(Matrix|Vector|Array)X+[dfi]?\b)", None, "fixed sizes"),
    ("mutable static", r"\b(static|thread_local)\s+(?!constexpr\b|const\b|consteval\b|inline\s+constexpr\b|_?assert)"
                       r"(?=[^;{()]*[;{=])(?![^;{=]*\()", None, "constants only; state belongs to an object"),
    ("mutable", r"\bmutable\b", None, "const means constant"),
    ("double", r"\bdouble\b", r"firmware/numeric/elementary\.hpp|firmware/cycle/instances(_\w+)?\.[ch]pp", "S(...)"),
    ("double literal", r"(?<!S\()(?<!S\(-)(?<![\w.])(\d+\.\d*|\.\d+|\d+e[+-]?\d+|\d+\.\d*e[+-]?\d+)(?![\w.])",
     r"firmware/numeric/elementary\.hpp", "S(0.5)"),
    ("todo", r"\b(TODO|FIXME|XXX)\b", None, "do it"),
]


def searched_code(text):
    """The text with comments, literals and `= delete`, which is no heap, blanked, line for line."""
    return re.sub(r"=\s*delete\b", lambda m: " " * len(m[0]), code_of(text))


def violations(root):
    found = sorted(f for f in (root / "firmware").rglob("*") if f.suffix in (".hpp", ".cpp", ".h", ".c", ".in"))
    if not found:
        yield "firmware: gone or empty, the rules would pass for ever"
    for file in found:
        place = file.relative_to(root).as_posix()
        raw = file.read_text(encoding="utf-8")
        text = searched_code(raw)
        for name, pattern, excepted, instead in RULES:
            if excepted and re.fullmatch(excepted, place):
                continue
            searched = raw if name == "todo" else text
            for match in re.finditer(pattern, searched):
                line = searched.count("\n", 0, match.start()) + 1
                shown = raw.splitlines()[line - 1].strip()
                yield f"{place}:{line}: {name}: {shown}  ({instead})"


SEEDED = [
    ("new", "int* p = new int;"), ("new", "void f(int* p) { delete p; }"), ("std::vector", "std::vector<int> v;"),
    ("std::function", "std::function<void()> f;"), ("std::string", "std::string s;"),
    ("smart pointer", "std::unique_ptr<int> p;"), ("malloc", "void* p = malloc(3);"), ("throw", "void f() { throw 1; }"),
    ("throw", "void f() { try { } catch (...) { } }"), ("dynamic_cast", "auto* p = dynamic_cast<A*>(q);"),
    ("dynamic_cast", "auto& i = typeid(q);"), ("dynamic_cast", "struct A { virtual void f(); };"),
    ("printf", 'void f() { std::printf("x"); }'), ("iostream", "#include <iostream>"),
    ("dynamic Eigen", "Eigen::VectorXd v;"), ("dynamic Eigen", "Eigen::Matrix<float, Eigen::Dynamic, 1> v;"),
    ("mutable static", "int f() { static int n = 0; return ++n; }"), ("mutable static", "static float last;"),
    ("mutable static", "static S last{};"), ("mutable static", "thread_local int n;"), ("mutable", "mutable int n;"),
    ("double", "double x;"), ("double literal", "float f() { return 0.5; }"), ("double literal", "float x = 1e-3;"),
    ("todo", "// TODO later"),
    (None, "// a new double, thrown: std::vector\n/* throw\n new */ const char* t = \"new double throw\";"),
    (None, "struct A { A() = delete; static constexpr int n = 3; static int f(int a); static A g() { return {}; } };"),
    (None, "static_assert(1.5F > 1 && 0x1p-3F < 1'000);\nbool try_send(int newest);  // new"),
    (None, "template <class S> S f() { return S(0.5) * S(-1.5) + S(6.283185307179586476925286766559L); }"),
]


def self_test():
    failed = 0
    with tempfile.TemporaryDirectory() as scratch:
        file = pathlib.Path(scratch, "firmware", "some.hpp")
        file.parent.mkdir()
        for rule, code in SEEDED:
            file.write_text("#pragma once\n\n" + code + "\n", encoding="utf-8")
            found = list(violations(pathlib.Path(scratch)))
            good = any(v.startswith(f"firmware/some.hpp:3: {rule}:") for v in found) if rule else not found
            if not good:
                failed += 1
                print(f"house_rules.py: should find {rule or 'nothing'} in: {code}\nfound {found}")
        file.unlink()
        if not list(violations(pathlib.Path(scratch))):
            failed += 1
            print("house_rules.py: does not notice that firmware/ is empty")
    print(f"{len(SEEDED) + 1 - failed} of {len(SEEDED) + 1} seeded cases judged rightly")
    return failed


def main():
    arguments = sys.argv[1:]
    if arguments == ["--self-test"]:
        return 1 if self_test() else 0
    if arguments:
        print("house_rules.py: usage: house_rules.py [--self-test]", file=sys.stderr)
        return 2
    found = list(violations(pathlib.Path(__file__).resolve().parents[2]))
    for violation in found:
        print(violation)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
