"""The image of a camera in C: its numbers, the reflectances of the scene, and the function."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from numpy.typing import NDArray

from uuvsim_cosim.fmus.codegen.scene_data import doubles, scene_text
from uuvsim_cosim.fmus.codegen.sonar_data import array_text
from uuvsim_cosim.models.worlds.camera_image import NORMALS, POINTS, CameraImage

__all__ = ["camera_arrays", "camera_call", "camera_numbers", "camera_text"]


def camera_call(k: int, n: CameraImage, a: list[str]) -> str:
    """Return the line that computes an image, into an array that is not on the stack."""
    given = ", ".join(x or "uuv_const(0.0)" for x in a)
    return f"static _Thread_local V y{k}[{n.n_out}]; {n.name}((const V[]){{{given}}}, y{k});"


def camera_arrays(n: CameraImage) -> dict[str, NDArray[Any]]:
    """Return the arrays of a `uuv_camera`, by their names there."""
    return {"seabed": n.seabed, "solid": n.solids, "points": POINTS, "normal": NORMALS}


def camera_numbers(n: CameraImage) -> tuple[list[int], list[float], int]:
    """Return the counts of a `uuv_camera`, then its lengths, then the seed of its texture."""
    counts = [n.rows, n.columns, n.lamps, n.n_moving]
    return counts, [n.farthest, n.texture_size], n.texture_seed


def camera_text(n: CameraImage) -> Iterator[str]:
    """Yield the scene, once in a file, the camera, and the function of the arguments."""
    yield '#include "uuv_camera.h"\n'
    yield from scene_text(n.ground)
    arrays = camera_arrays(n)
    for shared in ("points", "normal"):
        yield f"#ifndef HAS_UUV_camera_{shared}\n#define HAS_UUV_camera_{shared}\n"
        yield array_text(f"uuv_camera_{shared}", arrays[shared]) + "#endif\n"
    for own in ("seabed", "solid"):
        yield array_text(f"{n.name}_{own}", arrays[own]) if arrays[own].size else ""
    counts, lengths, seed = camera_numbers(n)
    solid = f"{n.name}_solid.number" if n.solids.size else "0"
    numbers = f"{', '.join(map(str, counts))}, {doubles(lengths)}, {seed}u"
    at = f"{n.name}_seabed.number, {solid}, uuv_camera_points.number, uuv_camera_normal.number"
    yield f"static const uuv_camera {n.name}_camera = {{{numbers}, {at}}};\n"
    rooms = [(3 * n.pixels, "seen", "float")]
    rooms += [(n.pixels, "depth", "float")] if n.depth else []
    rooms += [(n.pixels, "label", "uint16_t")] if n.labels else []
    rooms += [(3 * n.pixels, "normal", "float")] if n.normals else []
    yield f"static void {n.name}(const V *x, V *y) {{\n"
    for size, room, kind in rooms:
        yield f"    static _Thread_local {kind} {room}[{size}];\n"
    yield f"    double in[{n.n_in}], summary[3];\n"
    yield "    for (int lane = 0; lane < UUV_W; lane++) {\n"
    yield f"        for (int i = 0; i < {n.n_in}; i++) in[i] = uuv_lane(x[i], lane);\n"
    given = {name for _, name, _ in rooms}
    planes = ", ".join(name if name in given else "0" for name in ("depth", "label", "normal"))
    yield f"        uuv_camera_image(&{n.ground.name}, &{n.name}_camera, in, "
    yield f"seen, 0, {planes}, summary);\n"
    first = 0
    for size, room in [(3 * n.pixels, "seen"), (3, "summary"), *((r[0], r[1]) for r in rooms[1:])]:
        yield f"        for (int i = 0; i < {size}; i++) "
        yield f"UUV_PUT_LANE(y[{first} + i], lane, {room}[i]);\n"
        first += size
    yield "    }\n}\n"
