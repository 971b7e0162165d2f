"""An optimiser in C: CasADi's generated code, adapted to be a part of a component's file.

Three things are changed in CasADi's text: sin, cos, … are those of fmus/runtime, so that platforms
agree to the last bit; memory that CasADi keeps for one caller is local to a thread; everything is
local to the file. CasADi's own runtime in that text is under MIT No Attribution. It has one lane
only, as the lanes of a kernel would wait for one another.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import casadi as ca

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.intrinsics.optimiser import OPTIMISERS

__all__ = ["emit_optimisers", "optimiser_call", "optimisers_of"]

_MATH = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "pow", "sqrt", "fabs",
         "floor", "fmin", "fmax")  # fmt: skip
# Variables of CasADi's text that change and outlive a call: they become local to a thread.
_KEPT = re.compile(
    r"^static (?=(?:int|struct \w+) casadi_f\d+_(?:mem|unused|ref)\w*(?: =|\[))", re.M
)
_FUNCTION = re.compile(
    r"^(?=(?:int|void|casadi_int|casadi_real|const char ?\*) ?casadi_\w+\()", re.M
)
_SIZE = r"^  if \(sz_{0}\) \*sz_{0} = (\d+);$"


def optimisers_of(functions: list[Any]) -> list[str]:
    """List the optimisers that functions call, in the order of their names."""
    return sorted({g.name() for f in functions for g in f.find_functions()} & set(OPTIMISERS))


def optimiser_call(k: int, name: str, a: list[str]) -> Iterator[str]:
    """Yield the line that calls an optimiser, and then each value: ``t{k}.y[j]``."""
    inputs = ", ".join(x or "uuv_const(0.0)" for x in a)
    yield f"const {name}_values t{k} = {name}_solved((const V[]){{{inputs}}});"
    yield from (f"t{k}.y[{j}]" for j in range(_size_out(OPTIMISERS[name])))


def emit_optimisers(functions: list[Any]) -> str:
    """Return the C of the optimiser that the functions call."""
    names = optimisers_of(functions)
    if len(names) > 1:
        raise UuvsimError(", ".join(names), f"{len(names)} optimisers in a component", "1")
    return "".join(map(_text, names))


@lru_cache
def _text(name: str) -> str:
    """Return CasADi's C of an optimiser, and `{name}_solved`, which returns NaN if it fails."""
    f = OPTIMISERS[name]
    generator = ca.CodeGenerator(f"{name}_c.c", {"with_header": False})
    generator.add(f)
    text = _KEPT.sub("static _Thread_local ", generator.dump())
    text = _FUNCTION.sub("static ", text)
    # Sizes of work spaces that CasADi's text requires.
    sizes_of = (re.findall(_SIZE.format(s), text, re.M) for s in ("arg", "res", "iw", "w"))
    arg, res, iw, w = (max(int(found[0]), 1) for found in sizes_of)
    sizes = [f.numel_in(i) for i in range(f.n_in())]
    inputs = ", ".join(f"x + {sum(sizes[:i])}" for i in range(len(sizes)))
    outputs = ", ".join(f"r.y + {_size_out(f, i)}" for i in range(f.n_out()))
    lines = [
        "#if UUV_W != 1",
        f'#error "{name}: an optimiser is for one lane"',
        "#endif",
        "#include <math.h>",
        "#include <stdlib.h>",
        "#define CASADI_SYMBOL_EXPORT static",
        *(f"#define {function} uuv_{function}" for function in _MATH),
        text,
        *(f"#undef {function}" for function in _MATH),
        f"typedef struct {{ V y[{_size_out(f)}]; }} {name}_values;",
        f"static {name}_values {name}_solved(const V *x) {{",
        f"    {name}_values r = {{{{0}}}};",
        f"    const double *arg[{arg}] = {{{inputs}}};",
        f"    double *res[{res}] = {{{outputs}}};",
        f"    casadi_int iw[{iw}];",
        f"    double *w = malloc({w} * sizeof *w);",
        "    int failed = !w;",
        f"    for (int i = 0; i < {sum(sizes)}; i++) failed |= !__builtin_isfinite(x[i]);",
        f"    failed = failed || {name}(arg, res, iw, w, 0);",
        "    free(w);",
        f'    for (int i = 0; i < {_size_out(f)} && failed; i++) r.y[i] = __builtin_nan("");',
        "    return r;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _size_out(f: Any, until: int | None = None) -> int:
    return sum(f.numel_out(i) for i in range(f.n_out() if until is None else until))
