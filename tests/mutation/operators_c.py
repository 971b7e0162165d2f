"""Mutants of the C code, by its tokens: preprocessor lines, comments and strings stay."""

from __future__ import annotations

import re
from collections.abc import Iterator

from operators import Mutant

TOKEN = re.compile(
    r"""(?P<skip>/\*.*?\*/|//[^\n]*|^[ \t]*\#(?:\\\n|[^\n])*|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*')
    |(?P<number>(?:0[xX][0-9a-fA-F.]+(?:[pP][+-]?\d+)?|\d+\.?\d*(?:[eE][+-]?\d+)?)[uUlLfF]*)
    |(?P<name>[A-Za-z_]\w*)
    |(?P<sign><<=|>>=|->|\+\+|--|<=|>=|==|!=|&&|\|\||[-+*/%&|^]=|<<|>>|\S)""",
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)
BINARY = {"==": ("!=",), "!=": ("==",), "<": ("<=", ">="), "<=": ("<", ">"), ">": (">=", "<="),
          ">=": (">", "<"), "&&": ("||",), "||": ("&&",), "+": ("-",), "-": ("+",), "*": ("/",),
          "/": ("*",), "%": ("*",), "<<": (">>",), ">>": ("<<",), "&": ("|",), "|": ("&",),
          "^": ("&",), "+=": ("-=",), "-=": ("+=",), "*=": ("/=",), "|=": ("&=",),
          "&=": ("|=",)}  # fmt: skip
KIND = {**dict.fromkeys(("==", "!=", "<", "<=", ">", ">="), "comparison"), "&&": "boolean",
        "||": "boolean"}  # fmt: skip
TYPES = re.compile(
    r"^(void|char|short|int|long|float|double|unsigned|signed|const|struct|static|inline|size_t"
    r"|u?int\d+_t|uuv_\w+|\w+_t|real|return|case|sizeof|fmi\w*|[A-Z]\w*)$"
)
INTEGER = re.compile(r"^\d+$")
DECIMAL = re.compile(r"^\d+\.\d*$")


def c_mutants(path: str, source: bytes) -> list[list[Mutant]]:
    """Return the mutants of each statement that has any: of what stands between ; { and }."""
    text = source.decode()
    tokens = [m for m in TOKEN.finditer(text) if m.lastgroup != "skip"]
    found: list[list[Mutant]] = []
    depth, first, parens = 0, 0, 0
    for k, token in enumerate(tokens):
        word = token.group()
        parens += (word == "(") - (word == ")")
        if parens == 0 and word in ";{}":
            if depth > 0:
                mutants = list(_of_statement(path, text, tokens[first : k + 1]))
                found += [mutants] if mutants else []
            # A brace after = or ] holds values; another one opens a block.
            depth += (word == "{") - (word == "}")
            first = k + 1
    return found


def _of_statement(path: str, text: str, tokens: list[re.Match[str]]) -> Iterator[Mutant]:
    words = [t.group() for t in tokens]

    def change(operator: str, first: int, last: int, new: str) -> Mutant:
        start, end = tokens[first].start(), tokens[last].end()
        line = text.count("\n", 0, start) + 1
        begin, stop = (len(text[:at].encode()) for at in (start, end))
        return Mutant(path, line, operator, begin, stop, text[start:end], new)

    if words[0] in ("typedef", "struct", "enum", "extern", "goto"):
        return
    if words[-1] == ";":
        call = len(words) > 3 and re.match(r"\w", words[0]) and words[1] == "("
        simple = words[0] not in ("return", "if", "for", "while", "do", "else", "switch", "case")
        assigned = any(w in words for w in ("=", "+=", "-=", "*=", "|=", "&=", "++", "--"))
        declared = words[1:2] != ["("] and bool(
            TYPES.match(words[0]) or re.match(r"\w+ (\* ?)*\w+", " ".join(words))
        )
        if simple and not declared and (call or assigned):
            yield change("statement removed", 0, len(words) - 2, "(void)0")
        if words == ["break", ";"]:
            yield change("break to continue", 0, 0, "continue")
        if words == ["continue", ";"]:
            yield change("continue to break", 0, 0, "break")
    if words[0] in ("if", "while") and "(" in words:
        last = _closing(words, 1)
        condition = text[tokens[2].start() : tokens[last - 1].end()]
        yield change("negated", 2, last - 1, f"!({condition})")
    for k, word in enumerate(words):
        before, after = words[k - 1] if k else ";", words[k + 1] if k + 1 < len(words) else ";"
        operand = bool(re.match(r"[\w)\]]", before)) and bool(re.match(r"[\w(!\-&*]", after))
        if word in BINARY and operand and not (word in "*&" and TYPES.match(before)):
            for other in BINARY[word]:
                yield change(KIND.get(word, "arithmetic"), k, k, other)
        if word == "!" and re.match(r"[\w(]", after):
            yield change("operator removed", k, k, "")
        if (INTEGER.match(word) and before != "[") or DECIMAL.match(word):
            value = float(word) if "." in word else int(word)
            yield change("constant", k, k, repr(value + 1))
            yield change("constant", k, k, f"({value - 1!r})")


def _closing(words: list[str], opening: int) -> int:
    depth = 0
    for k in range(opening, len(words)):
        depth += (words[k] == "(") - (words[k] == ")")
        if depth == 0:
            return k
    return len(words) - 1
