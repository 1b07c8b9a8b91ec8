"""Mutants of a header, found in clang's syntax tree.

A mutant is one small change: an operator, a constant, a negated condition, a deleted statement, another result. Nothing in
comments, strings and static assertions is changed, nothing that only the type system sees (template arguments)."""

import dataclasses
import json
import re
import subprocess
import sys

sys.setrecursionlimit(100000)

SWAPS = {"<": ("<=", ">="), "<=": ("<", ">"), ">": (">=", "<="), ">=": (">", "<"), "==": ("!=",), "!=": ("==",),
         "+": ("-",), "-": ("+",), "*": ("/",), "/": ("*",), "%": ("*",), "<<": (">>",), ">>": ("<<",), "&": ("|",),
         "|": ("&",), "^": ("&",)}
COMPOUND = {"+=": "-=", "-=": "+=", "*=": "/=", "/=": "*=", "%=": "*=", "|=": "&=", "&=": "|=", "^=": "|=", "<<=": ">>=", ">>=": "<<="}
NAMES = {"min": "max", "max": "min"}
ARITHMETIC = {"+": "add", "-": "subtract", "*": "multiply", "/": "divide"}  # of matrices as well: mutant.hpp
STATEMENTS = {"BinaryOperator", "CompoundAssignOperator", "CallExpr", "CXXMemberCallExpr", "CXXOperatorCallExpr",
              "UnaryOperator", "ExprWithCleanups"}
SKIPPED = {"StaticAssertDecl", "ConceptDecl", "ClassTemplateSpecializationDecl", "ClassTemplatePartialSpecializationDecl",
           "CXXDefaultArgExpr", "CXXDefaultInitExpr", "RequiresExpr", "ConceptSpecializationExpr", "TemplateArgument",
           "NonTypeTemplateParmDecl", "TemplateTypeParmDecl", "TypeAliasDecl", "UsingDecl"}


@dataclasses.dataclass
class Mutant:
    file: str
    begin: int        # of what is replaced, in the file
    end: int
    text: str         # what replaces it
    form: str         # how it is chosen at run time; "" if it cannot be
    line: int = 0
    source: str = ""  # function and line, without indentation: what does not change when others are edited
    change: str = ""  # old -> new, on one line
    function: str = ""
    folded: bool = False  # the compiler has to evaluate its function somewhere
    number: int = -1

    @property
    def chosen(self):
        return f"::mutant::Folded{{{self.number}}}" if self.folded else str(self.number)

    @property
    def key(self):
        return self.file, self.source, self.change

    def __str__(self):
        return f"{self.file}:{self.line}: {self.change}"


def one_line(text):
    return " ".join(re.sub(r"//[^\n]*", "", text).split())


class Reader:
    """Mutants of one file."""

    def __init__(self, root, file, flags, cxx):
        self.root, self.file = root, file
        self.text = (root / file).read_text(encoding="utf-8")
        if not self.text.isascii():
            sys.exit(f"{file}: offsets are bytes: keep it ASCII")
        self.found = {}
        self.idle = set()
        self.enumerators = {}
        command = [cxx, *flags, f"-I{root}", "-fsyntax-only", "-x", "c++", str(root / file), "-Xclang", "-ast-dump=json",
                   "-Xclang", "-ast-dump-filter=esmc"]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        if run.returncode != 0:
            sys.exit(f"{file} does not compile:\n{run.stderr[-2000:]}")
        at, decoder = 0, json.JSONDecoder()
        while (at := run.stdout.find("{", at)) >= 0:
            tree, at = decoder.raw_decode(run.stdout, at)
            self.place, self.seen = None, str(root / file)
            self.locate(tree)
            self.enums(tree)
            self.visit(tree, {"constant": False, "result": None, "body": False, "function": ""})

    # ---- the tree -------------------------------------------------------------------------------------------------

    def locate(self, node):
        """clang names the file of a location only where it differs from the one before."""
        if isinstance(node, list):
            for n in node:
                self.locate(n)
        elif isinstance(node, dict):
            if "offset" in node:
                self.place = node.get("file", self.place)
                node["here"] = self.place == self.seen
            for key, value in node.items():
                if key != "includedFrom":
                    self.locate(value)

    def enums(self, node):
        if node.get("kind") == "EnumDecl":
            all_ = [n for n in node.get("inner", ()) if n["kind"] == "EnumConstantDecl"]
            for i, n in enumerate(all_):
                self.enumerators[n["id"]] = (n["name"], all_[(i + 1) % len(all_)]["name"])
        for n in node.get("inner", ()):
            self.enums(n)

    def extent(self, node):
        r = node.get("range", {})
        b, e = r.get("begin", {}), r.get("end", {})
        if not b.get("here") or not e.get("here"):
            return None
        return b["offset"], e["offset"] + e["tokLen"]

    def add(self, begin, end, text, form, old=None, new=None):
        if (begin, end, text) in self.found:
            return
        m = Mutant(self.file, begin, end, text, form, function=self.function)
        m.line = self.text.count("\n", 0, begin) + 1
        m.source = self.function + self.text.splitlines()[m.line - 1].strip()
        m.change = f"{one_line(old if old is not None else self.text[begin:end])} => {one_line(new if new is not None else text)}"
        self.found[begin, end, text] = m

    # ---- what is changed ------------------------------------------------------------------------------------------

    def visit(self, node, c):
        kind = node.get("kind")
        if kind is None or kind in SKIPPED or node.get("isImplicit") and kind.endswith("Decl"):
            return
        inner = node.get("inner", [])
        if kind == "FunctionTemplateDecl":  # the pattern, not what it was instantiated to
            inner = [n for n in inner if n["kind"] in ("FunctionDecl", "CXXMethodDecl", "CXXConstructorDecl")][:1]
        if kind == "LambdaExpr":
            inner = [n for n in inner if n["kind"] == "CompoundStmt"]
            c = {**c, "result": None}
        if kind in ("FunctionDecl", "CXXMethodDecl", "CXXConstructorDecl"):
            result = node.get("type", {}).get("qualType", "").split("(")[0].strip()
            c = {**c, "function": f"{node.get('name', '')}: ", "constant": False, "result": result, "body": True}
        if kind == "VarDecl" and (node.get("constexpr") or not c["body"]) or kind in ("EnumConstantDecl", "ConstantExpr"):
            c = {**c, "constant": True}
        if kind == "FieldDecl" and node.get("isBitfield"):
            return
        extent = self.extent(node)
        if extent:
            self.mutate(kind, node, inner, extent, c)
        if kind == "IfStmt" and node.get("isConstexpr"):
            inner = inner[1:]
        for n in inner:
            self.visit(n, c)

    def mutate(self, kind, node, inner, extent, c):
        begin, end = extent
        self.function = c["function"]
        text = self.text[begin:end]
        form = "" if c["constant"] else "expression"
        if kind in ("BinaryOperator", "CXXOperatorCallExpr", "CXXRewrittenBinaryOperator") and len(inner) >= 2:
            self.binary(inner, begin, end, form)
        elif kind == "CompoundAssignOperator":
            left, right = self.extent(inner[0]), self.extent(inner[1])
            op = self.text[left[1]:right[0]].strip()
            new = f"{self.text[left[0]:left[1]]} {COMPOUND[op]} {self.text[right[0]:right[1]]}"
            self.add(begin, end, new, "expression")
        elif kind == "UnaryOperator":
            self.unary(node, begin, end, text, form)
        elif kind == "IntegerLiteral":
            self.integer(begin, end, text, form)
        elif kind == "FloatingLiteral":
            m = re.fullmatch(r"([0-9.eE+\-']+)([a-zA-Z]*)", text)
            if m:
                v = float(m[1].replace("'", ""))
                for other in ((v + 1, v - 1) if abs(v) < 100 else (v * 1.01, v * 0.99)):
                    self.add(begin, end, f"{other!r}{m[2]}" if other >= 0 else f"({other!r}{m[2]})", form)
        elif kind == "CXXBoolLiteralExpr":
            self.add(begin, end, "false" if text == "true" else "true", form)
        elif kind == "DeclRefExpr" and node.get("referencedDecl", {}).get("id") in self.enumerators and form:
            name, other = self.enumerators[node["referencedDecl"]["id"]]
            if text.endswith(name) and other != name:
                self.add(begin, end, text[:len(text) - len(name)] + other, form)
        elif kind == "CallExpr" and inner:
            callee = self.extent(inner[0])
            name = re.fullmatch(r"std::(min|max)", self.text[callee[0]:callee[1]]) if callee else None
            if name:
                self.add(begin, end, "std::" + NAMES[name[1]] + self.text[callee[1]:end], form)
        elif kind == "ReturnStmt":
            self.result(inner, begin, end, c)
        self.conditions(kind, node, inner, form)
        self.statements(kind, inner, c["result"])

    def binary(self, inner, begin, end, form):
        left, right = self.extent(inner[-2]), self.extent(inner[-1])
        if not left or not right or left[0] != begin or right[1] != end:
            return
        op = one_line(re.sub(r"/\*.*?\*/", "", self.text[left[1]:right[0]]))
        a, b = self.text[left[0]:left[1]], self.text[right[0]:right[1]]
        if op in ("&&", "||"):
            self.add(begin, end, f"{a} {'||' if op == '&&' else '&&'} {b}", form)
            self.add(begin, end, f"static_cast<bool>({a})", form, new=a)
            self.add(begin, end, f"static_cast<bool>({b})", form, new=b)
        for other in SWAPS.get(op, ()):
            how = f"{ARITHMETIC[op]} {left[1]} {right[0]}" if op in ARITHMETIC and form else form
            self.add(begin, end, f"{a} {other} {b}", how)

    def unary(self, node, begin, end, text, form):
        op = node["opcode"]
        if op == "!":
            self.add(begin, end, f"static_cast<bool>({text[1:].lstrip()})", form, new=text[1:])
        if op in ("-", "~") and not re.fullmatch(r"-\s*[0-9.]+[a-zA-Z]*", text):
            self.add(begin, end, text[1:].lstrip(), form)
        if op in ("++", "--"):
            other = "--" if op == "++" else "++"
            self.add(begin, end, text[:-2] + other if node.get("isPostfix") else other + text[2:], form)

    def integer(self, begin, end, text, form):
        m = re.fullmatch(r"(0x[0-9A-Fa-f']+|[0-9']+)([uUlLzZ]*)", text)
        if not m:
            return
        v = int(m[1].replace("'", ""), 0)
        write = (lambda n: f"{n:#x}{m[2]}") if m[1].startswith("0x") else (lambda n: f"{n}{m[2]}")
        self.add(begin, end, write(v + 1), form)
        if v > 0 and form:
            self.add(begin, end, write(v - 1), form)

    def result(self, inner, begin, end, c):
        if not inner or not c["result"] or c["result"] in ("void", "auto") or self.extent(inner[0]) is None:
            return
        b, e = self.extent(inner[0])
        text = self.text[b:e]
        if c["result"] == "bool":
            if re.fullmatch(r"[\w.:>-]+(\(.*\))?", text, re.S) and text not in ("true", "false"):
                self.add(b, e, f"!({text})", "expression")
        elif not re.fullmatch(r'\{?\}|[\w:]+|".*"|[\d.]+\w*', text):
            stop = self.text.index(";", end) + 1
            self.add(begin, stop, "return {};", "statement", old=self.text[begin:end], new="return {}")

    def conditions(self, kind, node, inner, form):
        if kind in ("IfStmt", "WhileStmt") and not node.get("hasVar") and not node.get("isConstexpr"):
            at = 1 if node.get("hasInit") else 0
        elif kind == "ConditionalOperator":
            at = 0
        elif kind == "ForStmt":
            at = 2
        else:
            return
        extent = self.extent(inner[at]) if inner[at] else None
        if extent is None:
            return
        text = self.text[extent[0]:extent[1]]
        if inner[at]["kind"] not in ("BinaryOperator", "UnaryOperator"):
            self.add(*extent, f"!({text})", form and "condition")

    def last_break(self, body):
        """The one at the end of a switch: leaving it out changes nothing."""
        while body.get("kind") in ("CompoundStmt", "CaseStmt", "DefaultStmt") and body.get("inner"):
            body = body["inner"][-1]
        if body.get("kind") == "BreakStmt":
            self.idle.add(self.extent(body))

    def statements(self, kind, inner, result):
        if kind == "SwitchStmt":
            self.last_break(inner[-1])
        if kind == "CompoundStmt":
            all_ = inner
        elif kind in ("CaseStmt", "DefaultStmt", "IfStmt", "ForStmt", "WhileStmt"):
            all_ = inner[1:] if kind in ("CaseStmt", "IfStmt", "WhileStmt") else inner[-1:]
        else:
            return
        for n in all_:
            extent = self.extent(n)
            if extent is None or extent in self.idle or not (n["kind"] in STATEMENTS or n["kind"] == "BreakStmt" or
                                      n["kind"] == "ReturnStmt" and (result == "void" or not n.get("inner"))):
                continue
            end = self.text.index(";", extent[1]) + 1
            if self.text[extent[1]:end - 1].strip():
                continue  # no statement: a condition
            self.add(extent[0], end, "{}", "statement", new="deleted")

    def mutants(self):
        """In the order of the file. The same change twice on one line, or on equal lines of a function, is told apart by its
        number: an equivalent mutant must not excuse its neighbour."""
        all_, seen = sorted(self.found.values(), key=lambda m: (m.begin, -m.end, m.text)), {}
        for m in all_:
            seen[m.key] = nth = seen.get(m.key, 0) + 1
            if nth > 1:
                m.change += f" (no. {nth})"
        return all_


def together(text, mutants):
    """The file with all of its mutants in it, each chosen by its number."""
    groups = {}
    for m in mutants:
        if m.form:
            groups.setdefault((m.begin, m.end), []).append(m)
    sites = sorted(groups, key=lambda s: (s[0], -s[1]))

    def chain(group, original):
        choices = "".join(f"::mutant::is({m.chosen}) ? ({one_line(m.text)}) : " for m in group)
        return f"({choices}({original}))"

    def render(begin, end, sites):
        out, at = [], begin
        while sites:
            site, rest = sites[0], sites[1:]
            inside = [s for s in rest if s[0] < site[1]]
            sites = [s for s in rest if s[0] >= site[1]]
            out += [text[at:site[0]], render_site(site, inside)]
            at = site[1]
        out.append(text[at:end])
        return "".join(out)

    def render_site(site, inside):
        group = groups[site]
        statements = [m for m in group if m.form == "statement"]
        if statements:
            choices = "".join(f"if (::mutant::is({m.chosen})) {one_line(m.text)} else " for m in statements)
            return f"{{ {choices}{{ {render(*site, inside)} }} }}"
        binary = next((m for m in group if m.form not in ("expression", "condition")), None)
        if binary:
            name, left, right = binary.form.split()
            a = render(site[0], int(left), [s for s in inside if s[1] <= int(left)])
            b = render(int(right), site[1], [s for s in inside if s[0] >= int(right)])
            original = f"::mutant::{name}({binary.chosen}, {a}, {b})"
        else:
            original = render(*site, inside)
        if any(m.form == "condition" for m in group):
            original = f"static_cast<bool>({original})"
        others = [m for m in group if m is not binary]
        return chain(others, original) if others else original

    head, rest = text.split("#pragma once\n", 1)
    assert len(head) + len("#pragma once\n") <= min((m.begin for m in mutants), default=len(text))
    at = len(head) + len("#pragma once\n")
    return head + '#pragma once\n#include "mutant.hpp"\n#line 2\n' + render(at, len(text), sites)


def alone(text, m):
    """The file with one of its mutants, as somebody would have written it."""
    new = m.text if m.form == "statement" else f"({m.text})"
    return text[:m.begin] + new + text[m.end:]
