"""The contact of a hull in C: its shape, the seabed's friction, and the functions of arrays."""

from __future__ import annotations

from collections.abc import Iterator

from uuvsim_cosim.fmus.codegen.ray_data import doubles, scene_text
from uuvsim_cosim.models.hull.contact import HullContact, HullPlace

__all__ = ["contact_text"]


def contact_text(c: HullContact | HullPlace) -> Iterator[str]:
    """Yield the scene, once in a file, the hull, and the functions of the intrinsic's arguments."""
    yield '#include "uuv_contact.h"\n'
    yield from scene_text(c.ground)
    material, friction, rub, call, moving = "0", "0", "0", "uuv_place", "UUV_NO_FORCE"
    if isinstance(c, HullContact):
        call, moving = "uuv_contact", str(c.n_moving)
        if any(mu != 1.0 for mu in c.rub):
            rub = f"{c.name}_rub"
            yield f"static const double {rub}[] = {{{doubles(c.rub)}}};\n"
    if isinstance(c, HullContact) and c.material is not None:
        material, friction = f"{c.name}_material", f"{c.name}_friction"
        numbers = ",".join(map(str, c.material.ravel().tolist()))
        yield f"static const unsigned char {material}[] = {{{numbers}}};\n"
        yield f"static const double {friction}[] = {{{doubles(c.friction)}}};\n"
    h = c.hull
    shape = f"{{{doubles(h.middle)}}}, {{{doubles(h.half)}}}, {h.n}, {h.radius!r}"
    yield f"static const uuv_hull {c.name}_hull = "
    yield f"{{&{c.ground.name}, {material}, {friction}, {rub}, {shape}}};\n"
    yield f"typedef struct {{ V y[{c.n_out}]; }} {c.name}_values;\n"
    yield f"typedef struct {{ V y[{c.n_in}]; }} {c.name}_adjoint_values;\n"
    start, end = "    for (int lane = 0; lane < UUV_W; lane++) {\n", "    }\n    return r;\n}\n"
    n, read = c.n_in, "        for (int i = 0; i < {}; i++) {}[i] = uuv_lane({}[i], lane);\n"
    write = "        for (int i = 0; i < {}; i++) UUV_PUT_LANE(r.y[i], lane, {}[i]);\n"
    at = f"&{c.name}_hull, {moving}"
    value = f"{call}({at if isinstance(c, HullContact) else f'&{c.name}_hull'}"
    room = f"    double in[{n}], out[{c.n_out}], along[{n}];\n"
    yield f"static inline {c.name}_values {c.name}(const V *x) {{\n    {c.name}_values r;\n"
    yield f"    double in[{n}], out[{c.n_out}];\n{start}{read.format(n, 'in', 'x')}"
    yield f"        {value}, in, out);\n{write.format(c.n_out, 'out')}{end}"
    both = "(const V *x, const V *seed) {\n"
    yield f"static inline {c.name}_values {c.name}_forward{both}    {c.name}_values r;\n{room}"
    yield f"{start}{read.format(n, 'in', 'x')}{read.format(n, 'along', 'seed')}"
    yield f"        uuv_contact_forward({at}, {n}, in, along, out);\n"
    yield f"{write.format(c.n_out, 'out')}{end}"
    yield f"static inline {c.name}_adjoint_values {c.name}_adjoint{both}"
    yield f"    {c.name}_adjoint_values r;\n    double in[{n}], out[{n}], along[{c.n_out}];\n"
    yield f"{start}{read.format(n, 'in', 'x')}{read.format(c.n_out, 'along', 'seed')}"
    yield f"        uuv_contact_adjoint({at}, {n}, in, along, out);\n{write.format(n, 'out')}{end}"
