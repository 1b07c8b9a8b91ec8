#!/usr/bin/env python3
"""No function of the product is longer than 60 lines, but for at most ten named ones.

A function counts from the first line of its signature (after `template <...>`) to its closing brace; lambdas and local classes
are lines of the function around them. --list prints the longest functions; --self-test proves that the count is right.
"""

import pathlib
import re
import sys
import tempfile
from typing import NamedTuple

from sources import PRODUCT, ROOT, code_of, cpp_files

LIMIT = 60
EXCEPTIONS_MAX = 10

# (file, name of the function): why it is better in one piece
EXCEPTIONS = {}


class Function(NamedTuple):
    name: str
    line: int
    length: int


class Token(NamedTuple):
    text: str
    line: int


TOKEN = re.compile(r"operator\s*(?:\(\s*\)|\[\s*\]|[-+*/%^&|~!=<>,]+)|[A-Za-z_]\w*|\d[\w.']*|::|->|&&|\S")
CLOSING = {"(": ")", "[": "]", "{": "}"}
TYPES = {"class", "struct", "union", "enum"}
# Words before a parenthesis that is not a list of parameters.
NO_PARAMETERS = {"alignas", "decltype", "explicit", "noexcept", "requires", "__attribute__", "static_assert"}
# What stands directly before the body of a function whose signature has neither a trailing return type nor a requires clause.
BEFORE_BODY = {")", "}", "const", "noexcept", "override", "final", "volatile", "mutable", "try", "&", "&&"}


def without_directives(code):
    """Preprocessor directives blanked: a macro may hold half a brace."""
    return re.sub(r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*", lambda m: re.sub(r"[^\n]", " ", m[0]), code, flags=re.M)


def tokens_of(text):
    code = without_directives(code_of(text))
    line, end = 1, 0
    for match in TOKEN.finditer(code):
        line += code.count("\n", end, match.start())
        end = match.start()
        yield Token(match[0], line)


def partners(tokens):
    """The index of the other bracket, for each bracket; a ValueError where they do not match."""
    other, opened = {}, []
    for index, token in enumerate(tokens):
        if token.text in CLOSING:
            opened.append(index)
        elif token.text in CLOSING.values():
            if not opened or CLOSING[tokens[opened[-1]].text] != token.text:
                raise ValueError(f"{token.line}: a bracket without a partner")
            other[index] = opened.pop()
            other[other[index]] = index
    if opened:
        raise ValueError(f"{tokens[opened[-1]].line}: a bracket without a partner")
    return other


def after_angles(tokens, other, index):
    """The index after the template parameters or arguments that begin at tokens[index], a `<`."""
    depth = 0
    while index < len(tokens):
        text = tokens[index].text
        if text in CLOSING:
            index = other[index]
        depth += (text == "<") - (text == ">")
        index += 1
        if depth == 0:
            break
    return index


class Reader:
    """Functions of one file, the outermost ones."""

    def __init__(self, text):
        self.tokens = list(tokens_of(text))
        self.other = partners(self.tokens)

    def text(self, index):
        return self.tokens[index].text if 0 <= index < len(self.tokens) else ""

    def functions(self, start=0, stop=None):
        """Of a namespace or class whose content is tokens[start:stop]."""
        stop = len(self.tokens) if stop is None else stop
        head = index = start
        while index < stop:
            text = self.text(index)
            if text == ";" or (text == ":" and self.text(index - 1) in ("public", "private", "protected")):
                head = index + 1
            elif text in ("(", "["):
                yield from self.lambdas(index)
                index = self.other[index]
            elif text == "{":
                end = self.other[index]
                kind, first, name = self.kind(head, index)
                if kind == "scope":
                    yield from self.functions(index + 1, end)
                elif kind == "function":
                    yield Function(name, self.tokens[first].line, self.tokens[end].line - self.tokens[first].line + 1)
                else:
                    yield from self.lambdas(index)
                if kind != "value":
                    head = end + 1
                index = end
            index += 1

    def lambdas(self, opening):
        """Of an initialiser or a list of arguments, which starts at the bracket tokens[opening]."""
        index = opening if self.text(opening) == "{" and self.lambda_start(opening) is not None else opening + 1
        while index < self.other[opening]:
            if self.text(index) == "{" and (first := self.lambda_start(index)) is not None:
                end = self.other[index]
                yield Function("lambda", self.tokens[first].line, self.tokens[end].line - self.tokens[first].line + 1)
                index = end
            index += 1

    def lambda_start(self, brace):
        """The `[` of the lambda whose body starts at tokens[brace], if there is one."""
        index = brace - 1
        while self.text(index) not in (")", "]", "(", "[", "{", "}", ";", "=", ",", ""):  # specifiers, return type
            index -= 1
        if self.text(index) == ")":
            index = self.other[index] - 1
            if self.text(index) == ">":  # template parameters
                while index > 0 and self.text(index) != "]":
                    index -= 1
        if self.text(index) != "]":
            return None
        first = self.other[index]
        before = self.text(first - 1)
        return None if re.fullmatch(r"\w+|[])>]", before) and before != "return" else first

    def kind(self, head, brace):
        """Of a brace after tokens[head:brace]: scope, function (with its first token and name) or value."""
        first = head
        while self.text(first) == "template":
            first = after_angles(self.tokens, self.other, first + 1)
        before = self.text(brace - 1)
        if self.text(first) == "catch" or self.is_requires_expression(brace):
            return "value", first, ""
        words, index = [], first  # at the head's own level: what is in brackets or angles is left out
        while index < brace:
            text = self.text(index)
            words.append((text, index))
            if text in CLOSING:
                index = self.other[index]
                words.append((self.text(index), index))
            elif text == "<":
                index = after_angles(self.tokens, self.other, index) - 1
            index += 1
        texts = [w for w, _ in words]
        if not texts or "namespace" in texts or texts == ["extern"]:
            return "scope", first, ""
        return self.kind_of_declaration(words, texts, first, brace)

    def is_requires_expression(self, brace):
        """Whether `requires {` or `requires (parameters) {`; a requires clause after a signature is not."""
        if self.text(brace - 1) == "requires":
            return True
        index = self.other[brace - 1] - 1 if self.text(brace - 1) == ")" else -1
        return self.text(index) == "requires" and self.text(index - 1) not in (")", "const", "noexcept")

    def kind_of_declaration(self, words, texts, first, brace):
        lists = [p for p, w in enumerate(texts) if w == "(" and p > 0 and texts[p - 1] not in NO_PARAMETERS
                 and re.fullmatch(r"[A-Za-z_]\w*|operator.*|<|\)", texts[p - 1], re.S)]
        equals = texts.index("=") if "=" in texts else len(texts)
        if any(w in TYPES for w in texts[:equals]):
            base = texts.index(":") if ":" in texts else len(texts)
            if not any(p < base for p in lists):
                return "scope", first, ""
        if not lists or equals < lists[0]:
            begin = self.lambda_start(brace)
            return ("value", first, "") if begin is None else ("function", first, texts[max(equals - 1, 0)])
        name = self.name_before(words[lists[0]][1])
        tail = texts[lists[0] + 1:]
        in_body = texts[-1] in BEFORE_BODY or "->" in tail or ("requires" in tail and ":" not in tail)
        return ("function" if in_body else "value"), first, name

    def name_before(self, index):
        """The qualified name that ends before tokens[index], without template arguments."""
        index = self.before_angles(index) - 1
        name = [re.sub(r"\s", "", self.text(index))]
        while self.text(index - 1) in ("::", "~"):
            index -= 1
            name.insert(0, self.text(index))
            before = self.before_angles(index) - 1
            if name[0] == "::" and re.fullmatch(r"\w+", self.text(before)):
                index = before
                name.insert(0, self.text(index))
        return "".join(name)

    def before_angles(self, index):
        """The index of the `<` of template arguments that end before tokens[index], or index."""
        depth = 0
        for place in range(index - 1, -1, -1):
            depth += (self.text(place) == ">") - (self.text(place) == "<")
            if depth == 0:
                return place if place < index - 1 else index
        return index


def functions_of(text):
    return list(Reader(text).functions())


def violations(root, files, exceptions):
    unused = set(exceptions)
    if len(exceptions) > EXCEPTIONS_MAX:
        yield f"function_length.py: {len(exceptions)} exceptions, at most {EXCEPTIONS_MAX}"
    for file in files:
        try:
            found = functions_of((root / file).read_text(encoding="utf-8"))
        except ValueError as problem:
            yield f"{file}:{problem}: this file cannot be counted"
            continue
        for function in found:
            if function.length <= LIMIT:
                continue
            if (file, function.name) in exceptions:
                unused.discard((file, function.name))
            else:
                yield f"{file}:{function.line}: {function.name} has {function.length} lines, more than {LIMIT}"
    for file, name in sorted(unused):
        yield f"function_length.py: {file} has no long function {name}; remove its exception"


def lines(count):
    return "  x();\n" * count


# Code, and the name and length of each function in it.
JUDGED = [
    ("int f() { return 1; }", [("f", 1)]),
    ("int f(int a,\n      int b) {\n  return a;\n}", [("f", 4)]),
    ("template <class T = int>\n  requires(sizeof(T) > 1)\nint f(T a) {\n}", [("f", 3)]),
    ("template <class T>\nauto f(T a) -> std::vector<T> {\n}", [("f", 2)]),
    ("template <class T>\nvoid f(T a)\n  requires(T::x < 3)\n{\n}", [("f", 4)]),
    ("A::A(int x)\n    : a_{x}, b_(x), C<int>{x} {\n}", [("A::A", 3)]),
    ("A::A() try : a_(1) {\n} catch (...) {\n}", [("A::A", 2)]),
    ("A<T>::~A() {\n}", [("A::~A", 2)]),
    ("struct A : B<C(int)> {\n  A() = default;\n  explicit A(int x) : a{x} {}\n  int a{3};\n};", [("A", 1)]),
    ("struct alignas(16) A final {\n  int f() const noexcept(true) override {\n  }\n};", [("f", 2)]),
    ("enum class E : int { a, b };\nstruct A f() {\n}", [("f", 2)]),
    ("struct A {\n bool operator()(int a) const {\n }\n A& operator=(const A&) {\n }\n"
     " bool operator<(const A& o) const { return a < o.a; }\n};", [("operator()", 2), ("operator=", 2), ("operator<", 1)]),
    ("struct A {\n operator int() const {\n }\n};", [("int", 2)]),
    ("namespace a::b {\nnamespace {\nvoid f() {\n}\n}  // namespace\n}", [("f", 2)]),
    ('extern "C" {\nvoid f() {\n}\n}\nextern "C" void g() {\n}', [("f", 2), ("g", 2)]),
    ("const auto f = [](int a) {\n  return a;\n};", [("f", 3)]),
    ("const Row rows[] = {\n  {1, [](int a) -> int {\n    return a;\n  }},\n  {2, [=] { return 1; }}};",
     [("lambda", 3), ("lambda", 1)]),
    ("void f() {\n  g([&] {\n    x();\n  });\n  struct B {\n    void h() {\n    }\n  };\n}", [("f", 9)]),
    ("constexpr int table[f(3)]{1, 2};\nstd::array<int, f(3)> b{};\nint c{f(1)};\ndecltype(c) d{};", []),
    ("template <class T>\nconcept C = requires(T t) {\n  { t.f() } -> std::same_as<int>;\n};", []),
    ("template <class T>\n  requires requires(T t) { t.f(); }\nvoid f(T t) {\n}", [("f", 3)]),
    ("// void f() {\n/* { */ const char* a = \"{\"; const char b = '{';\n#define F \\\n  {\nint f() {\n}", [("f", 2)]),
    ('auto a = R"x( { " )x";\nint f() {\n}', [("f", 2)]),
    ("[[nodiscard]] int f() { return 1'000; }\n__attribute__((naked)) void g() {\n}", [("f", 1), ("g", 2)]),
    (f"void f() {{\n{lines(58)}}}", [("f", 60)]),
    (f"void f() {{\n{lines(59)}}}", [("f", 61)]),
]


def self_test():
    failed = 0

    def judge(good, message):
        nonlocal failed
        failed += not good
        if not good:
            print(f"function_length.py: {message}")

    for code, expected in JUDGED:
        found = [(f.name, f.length) for f in functions_of(code)]
        judge(found == expected, f"should find {expected}, found {found} in\n{code}")
    with tempfile.TemporaryDirectory() as scratch:
        root = pathlib.Path(scratch)
        names = ["a.cpp", "half.cpp", "long.cpp"]
        for name, code in zip(names, (f"void f() {{\n{lines(58)}}}", "void f() {", f"void f() {{\n{lines(59)}}}")):
            (root / name).write_text(code, encoding="utf-8")
        found = list(violations(root, names, {}))
        judge(len(found) == 2 and found[0].startswith("half.cpp:1:") and found[1].startswith("long.cpp:1: f has 61"),
              f"should find half.cpp and long.cpp, found {found}")
        judge(not list(violations(root, ["long.cpp"], {("long.cpp", "f"): "why"})), "an exception does not help")
        judge(list(violations(root, ["a.cpp"], {("a.cpp", "f"): "why"})), "an exception of no use is not noticed")
        judge(list(violations(root, [], {("long.cpp", str(i)): "why" for i in range(EXCEPTIONS_MAX + 1)})),
              "too many exceptions are not noticed")
    print(f"{len(JUDGED) + 4 - failed} of {len(JUDGED) + 4} cases judged rightly")
    return failed


def main():
    options = sys.argv[1:]
    files = cpp_files(ROOT, *PRODUCT)
    if options == ["--self-test"]:
        return int(bool(self_test()))
    if options == ["--list"]:
        found = [(f.length, f"{file}:{f.line} {f.name}") for file in files for f in functions_of((ROOT / file).read_text())]
        for length, place in sorted(found, reverse=True)[:50]:
            print(f"{length:4} {place}")
        return 0
    if options:
        print("usage: function_length.py [--list | --self-test]", file=sys.stderr)
        return 2
    found = list(violations(ROOT, files, EXCEPTIONS))
    for violation in found:
        print(violation)
    return int(bool(found) or not files)


if __name__ == "__main__":
    sys.exit(main())
