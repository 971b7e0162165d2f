"""A scene in C: terrain, solids and meshes, and the functions of rays and of hull contact."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.hull.contact import HullContact, HullPlace
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
    buffers = f"    double in[{n_in}], out[{n_out}];\n"
    read = [(n_in - n_w, "in[i]", "x")]
    if isinstance(r, Frame):
        read.append((n_w, f"in[{n_in - n_w} + i]", "w"))
        yield from _lane_function(r.name, "", ["x", "w"], buffers, read, call, n_out)
        return
    value, forward = call.replace("SEED", "0"), call.replace("SEED", "along")
    yield from _lane_function(r.name, "", ["x"], buffers, read, value, n_out)
    buffers += f"    double along[{n_in}];\n"
    read.append((n_in, "along[i]", "seed"))
    yield from _lane_function(r.name, "_forward", ["x", "seed"], buffers, read, forward, n_out)


def _lane_function(
    name: str,
    suffix: str,
    given: Sequence[str],
    buffers: str,
    read: Sequence[tuple[int, str, str]],
    call: str,
    n_out: int,
    struct: str = "",
) -> Iterator[str]:
    """Yield a C function of arrays that calls a function of doubles for each lane.

    `read` are counts, targets and sources of the numbers that it gets; `out` has its results.
    """
    arguments = ", ".join(f"const V *{a}" for a in given)
    yield f"static inline {name}{struct}_values {name}{suffix}({arguments}) {{\n"
    yield f"    {name}{struct}_values r;\n{buffers}"
    yield "    for (int lane = 0; lane < UUV_W; lane++) {\n"
    for n, target, source in read:
        yield f"        for (int i = 0; i < {n}; i++) {target} = uuv_lane({source}[i], lane);\n"
    yield f"        {call};\n"
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
    n, m, hull = c.n_in, c.n_out, f"&{c.name}_hull"
    at = f"{hull}, {moving}"
    value = f"{call}({at if isinstance(c, HullContact) else hull}, in, out)"
    read = [(n, "in[i]", "x")]
    yield from _lane_function(c.name, "", ["x"], f"    double in[{n}], out[{m}];\n", read, value, m)
    given = ["x", "seed"]
    buffers = f"    double in[{n}], out[{m}], along[{n}];\n"
    forward = f"uuv_contact_forward({at}, {n}, in, along, out)"
    read = [(n, "in[i]", "x"), (n, "along[i]", "seed")]
    yield from _lane_function(c.name, "_forward", given, buffers, read, forward, m)
    buffers = f"    double in[{n}], out[{n}], along[{m}];\n"
    adjoint = f"uuv_contact_adjoint({at}, {n}, in, along, out)"
    read = [(n, "in[i]", "x"), (m, "along[i]", "seed")]
    yield from _lane_function(c.name, "_adjoint", given, buffers, read, adjoint, n, "_adjoint")
