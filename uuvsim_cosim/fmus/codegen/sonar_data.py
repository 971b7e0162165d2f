"""The image of a sonar in C: its geometry, the materials of the scene, and the function."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.fmus.codegen.scene_data import doubles, scene_text
from uuvsim_cosim.models.worlds.sonar_geometry import AMPLITUDES, TURNS
from uuvsim_cosim.models.worlds.sonar_image import SonarImage, over_cosine

__all__ = ["array_text", "sonar_arrays", "sonar_call", "sonar_numbers", "sonar_text"]


def sonar_call(k: int, n: SonarImage, a: list[str]) -> str:
    """Return the line that computes an image, into an array that is not on the stack."""
    given = ", ".join(x or "uuv_const(0.0)" for x in a)
    return f"static _Thread_local V y{k}[{n.n_out}]; {n.name}((const V[]){{{given}}}, y{k});"


def sonar_arrays(n: SonarImage) -> dict[str, NDArray[Any]]:
    """Return the arrays of a `uuv_sonar`, by their names there."""
    g = n.geometry
    even = np.zeros((len(g.u), (len(g.bearings) + 1) // 2 * 2), np.float32)
    even[:, : len(g.bearings)] = g.weight
    return {
        "column": np.stack([g.u, np.sqrt(1.0 - g.u**2), g.du], axis=1),
        "ray": np.array(
            [[np.cos(t), np.sin(t), p * g.d_theta] for t, p in zip(g.theta, g.gain, strict=True)]
        ),
        "weight": even,
        "window": g.window,
        "nearest": g.nearest,
        "pulse": g.pulse,
        "strength": over_cosine(n.surfaces.sigma).astype(np.float32),
        "seabed": n.surfaces.seabed,
        "solid": n.surfaces.solids,
        "surface": n.paths.surface,
        "bottom": n.paths.bottom,
        "level": n.paths.level,
        "turns": TURNS,
        "amplitudes": AMPLITUDES,
    }


def sonar_numbers(n: SonarImage) -> tuple[list[int], list[float], int]:
    """Return the whole numbers of a `uuv_sonar`, then its lengths, then the power of its gain."""
    g = n.geometry
    whole = [len(g.bearings), g.bins, len(g.u), len(g.theta), g.fine, g.pad, n.n_moving]
    farthest = g.first + (g.bins + g.pad) * g.step
    return whole, [g.first, g.step, farthest, g.d_theta], n.tvg


def sonar_text(n: SonarImage) -> Iterator[str]:
    """Yield the scene, once in a file, the sonar, and the function of the intrinsic's arguments."""
    yield '#include "uuv_sonar.h"\n'
    yield from scene_text(n.ground)
    arrays = sonar_arrays(n)
    level = arrays.pop("level")
    yield array_text(f"{n.name}_level", level) if level.size else ""
    for shared in ("turns", "amplitudes"):
        yield f"#ifndef HAS_UUV_{shared}\n#define HAS_UUV_{shared}\n"
        yield array_text(f"uuv_sonar_{shared}", arrays.pop(shared)) + "#endif\n"
    for key, values in arrays.items():
        yield array_text(f"{n.name}_{key}", values) if values.size else ""
    at = [
        f"{n.name}_{key}" + _MEMBER[values.dtype.kind] if values.size else "0"
        for key, values in arrays.items()
    ]
    whole, lengths, tvg = sonar_numbers(n)
    numbers = f"{', '.join(map(str, whole))}, {doubles(lengths)}, {tvg}"
    tables = "uuv_sonar_turns.number, uuv_sonar_amplitudes.number"
    levels = f"{n.name}_level.number" if level.size else "0"
    profile = f"{{{len(level)}, {doubles([n.paths.chord])}, {levels}}}"
    yield (
        f"static const uuv_sonar {n.name}_sonar = "
        f"{{{numbers}, {', '.join(at)}, {tables}, {profile}}};\n"
    )
    g, pixels = n.geometry, n.pixels
    beams = len(g.bearings)
    whole_of = pixels + 2 * beams + 2
    room = f"UUV_SONAR_ROOM({beams}, {g.bins}, {g.fine}, {g.pad}, {int(n.labels)})"
    row = f"(int64_t)b * UUV_SONAR_ROW({g.bins}) + i"
    yield f"static void {n.name}(const V *x, V *y) {{\n"
    yield f"    static _Thread_local float room[{room}], seen[{whole_of}];\n"
    yield f"    double in[{n.n_in}];\n"
    yield f"    uuv_sonar_work w = uuv_sonar_work_(&{n.name}_sonar, room, {int(n.labels)});\n"
    yield "    for (int lane = 0; lane < UUV_W; lane++) {\n"
    yield f"        for (int i = 0; i < {n.n_in}; i++) in[i] = uuv_lane(x[i], lane);\n"
    yield f"        uuv_sonar_echoes(&{n.ground.name}, &{n.name}_sonar, in, &w);\n"
    yield f"        uuv_sonar_receive(&{n.name}_sonar, in, &w, seen);\n"
    yield f"        for (int i = 0; i < {whole_of}; i++) UUV_PUT_LANE(y[i], lane, seen[i]);\n"
    planes = [*(["w.re", "w.im"] if n.complex else []), *(["w.label"] if n.labels else [])]
    if planes:
        yield f"        for (int b = 0; b < {beams}; b++)\n"
        yield f"            for (int i = 0; i < {g.bins}; i++) {{\n"
        for k, plane in enumerate(planes):
            first = whole_of + k * pixels
            pixel = f"y[{first} + b * {g.bins} + i]"
            yield f"                UUV_PUT_LANE({pixel}, lane, {plane}[{row}]);\n"
        yield "            }\n"
    yield "    }\n}\n"


_MEMBER = {"f": ".number", "i": "", "u": ""}


def array_text(name: str, values: NDArray[Any]) -> str:
    """Return an array in C; numbers with a point as bits, which a compiler reads fast."""
    flat = values.ravel()
    if values.dtype.kind != "f":
        kind = {1: "unsigned char", 2: "int16_t"}[values.dtype.itemsize]
        return f"static const {kind} {name}[] = {{{','.join(map(str, flat.tolist()))}}};\n"
    number, word = ("float", "uint32_t") if values.dtype.itemsize == 4 else ("double", "uint64_t")
    bits = ",".join(map(hex, flat.view(f"u{values.dtype.itemsize}").tolist()))
    fields = f"{word} bits[{flat.size}]; {number} number[{flat.size}];"
    return f"static const union {{ {fields} }} {name} = {{{{{bits}}}}};\n"
