"""A scene in C: terrain, solids and meshes, and the functions of rays and of hull contact."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.hull.hull_contact import HullContact, HullPlace
from uuvsim_cosim.models.worlds.ground import Ground
from uuvsim_cosim.models.worlds.rays import Frame, Rays

__all__ = ["contact_text", "doubles", "frame_call", "ray_text", "scene_text"]


def frame_call(k: int, f: Frame, a: list[str]) -> str:
    """Return the line that calls a frame: its head, and its draws as they lie in an array."""
    n = len(f.directions)
    head, draws = a[:-n], a[-n:]
    first = re.fullmatch(r"(\w+)\[(\d+)\]", draws[0])
    if first and draws == [f"{first[1]}[{int(first[2]) + i}]" for i in range(n)]:
        given = f"{first[1]} + {first[2]}"
    else:
        given = f"(const V[]){{{', '.join(draws)}}}"
    heads = ", ".join(x or "uuv_const(0.0)" for x in head)
    return f"const {f.name}_values t{k} = {f.name}((const V[]){{{heads}}}, {given});"


def ray_text(r: Rays | Frame) -> Iterator[str]:
    """Yield the scene, once in a file, and the function of the intrinsic's arguments."""
    yield '#include "uuv_rays.h"\n'
    yield from scene_text(r.ground)
    place, n_in, n_out = f"&{r.ground.name}", r.n_in, r.n_out
    forward = not isinstance(r, Frame)
    if isinstance(r, Frame):
        numbers = doubles(r.directions.ravel().tolist())
        yield f"static const double {r.name}_d[] = {{{numbers}}};\n"
        head = f"{len(r.directions)}, {r.n_moving}, {int(r.depth)}, {r.name}_d"
        yield f"static const uuv_frame {r.name}_frame = {{{head}}};\n"
        call = f"uuv_frame_seen({place}, &{r.name}_frame, in, out)"
    else:
        call = f"uuv_rays({place}, {r.n}, {r.n_moving}, in, SEED, out)"
    yield f"typedef struct {{ V y[{n_out}]; }} {r.name}_values;\n"
    n_w = len(r.directions) if isinstance(r, Frame) else 0
    one = ["x", "w"] if n_w else ["x"]
    for suffix, given in (("", one), *([("_forward", ["x", "seed"])] if forward else [])):
        yield f"static inline {r.name}_values {r.name}{suffix}("
        yield f"{', '.join(f'const V *{a}' for a in given)}) {{\n"
        yield f"    {r.name}_values r;\n    double in[{n_in}], out[{n_out}];\n"
        if suffix:
            yield f"    double along[{n_in}];\n"
        yield "    for (int lane = 0; lane < UUV_W; lane++) {\n"
        yield f"        for (int i = 0; i < {n_in - n_w}; i++) in[i] = uuv_lane(x[i], lane);\n"
        if n_w:
            yield f"        for (int i = 0; i < {n_w}; i++) in[{n_in - n_w} + i] = "
            yield "uuv_lane(w[i], lane);\n"
        if suffix:
            yield f"        for (int i = 0; i < {n_in}; i++) along[i] = uuv_lane(seed[i], lane);\n"
        yield f"        {call.replace('SEED', 'along' if suffix else '0')};\n"
        yield f"        for (int i = 0; i < {n_out}; i++) UUV_PUT_LANE(r.y[i], lane, out[i]);\n"
        yield "    }\n    return r;\n}\n"


def scene_text(g: Ground) -> Iterator[str]:
    """Yield a scene's nodes, pyramid and solids, once in a file."""
    yield f"#ifndef HAS_{g.name}\n#define HAS_{g.name}\n"
    # As bits: a compiler reads whole numbers twice as fast as decimals.
    yield from _bits(f"{g.name}_z", g.z)
    yield from _bits(f"{g.name}_ranges", g.ranges)
    rows = [
        f"{{{int(row[0])}, {{{doubles(row[1:4])}}}, {{{doubles(row[4:9])}}}, {row[9]!r}}}"
        for row in g.solids.tolist()
    ]
    yield f"static const uuv_solid {g.name}_solids[] = {{{', '.join(rows) or '{0}'}}};\n"
    yield from _bits(f"{g.name}_vertices", g.surfaces.vertices)
    yield _whole(f"{g.name}_corners", g.surfaces.corners)
    yield _whole(f"{g.name}_first", g.surfaces.first)
    boxes = np.ascontiguousarray(g.tree.boxes).reshape(-1, 24).view(np.uint32)
    words = np.concatenate([boxes, g.tree.children.view(np.uint32)], axis=1).ravel()
    n_nodes = max(1, len(g.tree.children))
    yield _union(f"{g.name}_nodes", words, "uuv_tree_node node", n_nodes)
    numbers = doubles([*g.origin, g.spacing, g.low, g.high])
    levels = [f"{{{', '.join(map(str, each))}}}" for each in (g.at, g.wide)]
    shape = f"{g.z.shape[0]}, {g.z.shape[1]}"
    arrays = f"{g.name}_z.number, {g.name}_ranges.number"
    yield f"static const uuv_scene {g.name} = {{\n    {{{shape}, {numbers},\n"
    yield f"     {arrays}, {len(g.at) - 1}, {', '.join(levels)}}},\n"
    yield f"    {g.name}_solids, {len(rows)},\n"
    meshes = g.surfaces
    numbers = f"{{{doubles(meshes.middle)}}}, {g.name}_vertices.number, {g.name}_corners"
    yield f"    {{{g.name}_nodes.node, {len(g.tree.children)}, {numbers},\n"
    yield f"     {g.name}_first, {len(meshes.first) - 1}}}}};\n#endif\n"


def _bits(name: str, values: NDArray[np.float32]) -> Iterator[str]:
    words = values.ravel().view(np.uint32)
    yield _union(name, words, "float number", max(1, len(words)))


def _union(name: str, words: NDArray[np.uint32], what: str, n: int) -> str:
    given = ",".join(map(hex, words.tolist() or [0]))
    size = max(1, len(words))
    fields = f"    uint32_t bits[{size}];\n    {what}[{n}];\n"
    return f"static const union {{\n{fields}}} {name} = {{{{{given}}}}};\n"


def _whole(name: str, values: NDArray[np.int32]) -> str:
    numbers = values.ravel().tolist() or [0]
    return f"static const int32_t {name}[] = {{{','.join(map(str, numbers))}}};\n"


def doubles(values: Iterable[float]) -> str:
    """Write numbers with commas, so that C reads the same bits."""
    return ", ".join(repr(float(v)) for v in values)


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
