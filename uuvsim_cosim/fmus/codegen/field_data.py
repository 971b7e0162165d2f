"""A field in C: its grids and nodes, and the functions of an array that read them (uuv_field.h)."""

from __future__ import annotations

from collections.abc import Iterator

from uuvsim_cosim.fmus.codegen.layer_data import array_text
from uuvsim_cosim.models.intrinsics.field import Field

__all__ = ["field_text"]


def field_text(f: Field) -> Iterator[str]:
    """Yield the grids and nodes of a field, and its functions of its inputs."""
    yield '#include "uuv_field.h"\n'
    for i, grid in enumerate(f.axes):
        yield f"static const double {f.name}_grid_{i}[] = {{{', '.join(map(repr, grid))}}};\n"
    yield array_text(f"{f.name}_nodes", f.nodes)
    grids = ", ".join(f"{f.name}_grid_{i}" for i in range(len(f.axes)))
    sizes = ", ".join(str(len(grid)) for grid in f.axes)
    held = ", ".join(str(int(h)) for h in f.held)
    fields = f"{{{grids}}}, {{{sizes}}}, {{{held}}}, {f.n_out}, {f.name}_nodes"
    yield f"static const uuv_field {f.name}_field = {{{fields}}};\n"
    yield f"typedef struct {{ V y[{f.n_out}]; }} {f.name}_values;\n"
    for suffix, given in (("", ["x"]), ("_forward", ["x", "seed"])):
        yield f"static inline {f.name}_values {f.name}{suffix}("
        yield f"{', '.join(f'const V *{a}' for a in given)}) {{\n"
        yield f"    {f.name}_values r;\n"
        yield f"    uuv_field_at{suffix}(&{f.name}_field, {', '.join(given)}, r.y);\n"
        yield "    return r;\n}\n"
