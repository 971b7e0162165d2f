"""One CasADi function becomes one C function on W-lane values, instruction by instruction."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.table import TABLES

__all__ = ["emit_function", "emit_tables", "literal"]

# CasADi operation -> function of fmus/runtime/uuv_math.h; arithmetic is written as operators.
INFIX = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/"}
NAMES = (
    "neg exp log pow constpow sqrt sq twice sin cos tan asin acos atan lt le eq ne not and or "
    "floor ceil fmod fabs sign copysign if_else_zero fmin fmax inv sinh cosh tanh asinh acosh "
    "atanh atan2 log1p expm1 hypot remainder"
)
NAMED = {getattr(ca, f"OP_{name.upper()}"): f"uuv_{name}" for name in NAMES.split()}


def literal(value: float) -> str:
    """Write a double so that C reads the same bits."""
    if math.isnan(value):
        return '__builtin_nan("")'
    if math.isinf(value):
        return "-__builtin_inf()" if value < 0 else "__builtin_inf()"
    return repr(float(value))


def emit_function(f: Any, signature: str, targets: tuple[str, ...]) -> str:
    """Give the C text of `f`: its inputs are the C arrays in `targets` before the last one.

    ``targets`` names the arrays of f's inputs, then the one that its output is written to.
    """
    *sources, result = targets
    sx = None
    lines: list[str] = []
    value: dict[int, str] = {}  # work slot -> C expression that holds it now
    stores: list[str] = []
    for k in range(f.n_instructions()):
        op = f.instruction_id(k)
        i = f.instruction_input(k)
        o = f.instruction_output(k)
        if op == ca.OP_INPUT:
            value[o[0]] = f"{sources[i[0]]}[{i[1]}]"
            continue
        if op == ca.OP_OUTPUT:
            stores.append(f"{result}[{o[1]}] = {value[i[0]]};")
            continue
        if op == ca.OP_CALL:
            sx = f.instructions_sx() if sx is None else sx
            call = sx[k].which_function()
            texts = _call(call, [value.get(n, "") for n in i])
            for n, text in zip(o, texts, strict=True):
                lines.append(f"const V t{k}_{n} = {text};")
                value[n] = f"t{k}_{n}"
            continue
        lines.append(f"const V t{k} = {_operation(f, k, op, [value.get(n, '') for n in i])};")
        value[o[0]] = f"t{k}"
    body = "\n    ".join([f"(void){s};" for s in targets] + lines + stores)
    return f"static void {signature} {{\n    {body}\n}}\n"


def _operation(f: Any, k: int, op: int, a: list[str]) -> str:
    if op == ca.OP_CONST:
        return f"uuv_const({literal(f.instruction_constant(k))})"
    if op == ca.OP_ASSIGN:
        return a[0]
    if op in INFIX:
        return f"{a[0]} {INFIX[op]} {a[1]}"
    if op in NAMED:
        return f"{NAMED[op]}({', '.join(a)})"
    raise UuvsimError(f"{f.name()}: CasADi operation {op} has no lowering to C")


Lowering = Callable[[list[str]], str]


def _call(f: Any, a: list[str]) -> list[str]:
    """Lower a call of a table, of its partial derivative, or of its forward derivative."""
    name = f.name()
    if name in TABLES:
        return [_table(name, "", a)]
    for suffix in ("_dx", "_dy", "_d"):
        if name.endswith(suffix) and name[: -len(suffix)] in TABLES:
            return [_table(name[: -len(suffix)], suffix, a)]
    wrapped = name.removeprefix("fwd1_wrap_")
    if wrapped in TABLES:
        n = TABLES[wrapped].n_in
        x, seeds = a[:n], a[-n:]
        suffixes = ("_d",) if n == 1 else ("_dx", "_dy")
        terms = [
            f"{_table(wrapped, s, x)} * {seed}"
            for s, seed in zip(suffixes, seeds, strict=True)
            if seed
        ]
        return [" + ".join(terms)]
    raise UuvsimError(f"{name}: this function is called in equations, but is no known intrinsic")


def _table(name: str, suffix: str, a: list[str]) -> str:
    table = TABLES[name]
    nx = len(table.x)
    if table.n_in == 1:
        return f"uuv_table1{suffix}({a[0]}, {name}_x, {name}_values, {nx})"
    ny = len(table.y)
    return f"uuv_table2{suffix}({a[0]}, {a[1]}, {name}_x, {nx}, {name}_y, {ny}, {name}_values)"


def emit_tables(functions: list[Any]) -> str:
    """Write the data of every table that the functions call, in the order of their names."""
    names = {g.name() for f in functions for g in f.find_functions()}
    text = []
    for name in sorted(names & set(TABLES)):
        table = TABLES[name]
        arrays = {"x": table.x, "values": table.values}
        if table.n_in == 2:
            arrays["y"] = table.y
        for part, numbers in arrays.items():
            items = ", ".join(literal(float(v)) for v in numbers)
            text.append(f"static const double {name}_{part}[] = {{{items}}};\n")
    return "".join(text)
