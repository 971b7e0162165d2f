"""Binary glTF 2.0 of closed shells, written by this module alone.

Positions are in metres along EUS (x to starboard, y up, z astern): so a vehicle at rest that heads
north lies in a scene as `axes: EUS` of scene.yaml places it. glTF itself lets a model look along
+z; such a reader shows the vehicle's stern first.

Source: Khronos, glTF 2.0 specification (2021), sections 3.6 to 3.9 and 4.4.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ColouredShell", "glb"]

FLOAT, UINT32, VERTICES, TRIANGLES = 5126, 5125, 34962, 34963


@dataclass(frozen=True, eq=False)
class ColouredShell:
    """A named shell: vertices (n, 3) [m, FRD], triangles (m, 3), colour "#rrggbb" (sRGB)."""

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    colour: str


def glb(name: str, shells: Sequence[ColouredShell], note: str = "") -> bytes:
    """Return the bytes of a .glb: one node for each shell below a node `name`, without normals.

    A reader shades triangles without normals flat, as the specification says. `note` becomes
    the asset's copyright line.
    """
    binary = bytearray()
    views: list[dict[str, int]] = []
    accessors: list[dict[str, object]] = []
    meshes: list[dict[str, object]] = []
    colours = list(dict.fromkeys(s.colour for s in shells))

    def view(data: bytes, target: int) -> int:
        views.append(
            {"buffer": 0, "byteOffset": len(binary), "byteLength": len(data), "target": target}
        )
        binary.extend(data)
        return len(views) - 1

    for s in shells:
        p = np.stack([s.vertices[:, 1], -s.vertices[:, 2], -s.vertices[:, 0]], 1).astype("<f4")
        f = s.faces.astype("<u4")
        accessors += [
            {"bufferView": view(p.tobytes(), VERTICES), "componentType": FLOAT, "count": len(p),
             "type": "VEC3", "min": p.min(axis=0).tolist(), "max": p.max(axis=0).tolist()},
            {"bufferView": view(f.tobytes(), TRIANGLES), "componentType": UINT32, "count": f.size,
             "type": "SCALAR"},
        ]  # fmt: skip
        k = len(accessors)
        meshes.append({"name": s.name, "primitives": [{
            "attributes": {"POSITION": k - 2}, "indices": k - 1,
            "material": colours.index(s.colour),
        }]})  # fmt: skip
    content = {
        "asset": {"version": "2.0", "generator": "uuvsim-cosim"}
        | ({"copyright": note} if note else {}),
        "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "children": list(range(1, len(shells) + 1))},
                  *({"name": s.name, "mesh": i} for i, s in enumerate(shells))],
        "meshes": meshes,
        "materials": [{"name": c, "pbrMetallicRoughness": {
            "baseColorFactor": [*_linear(c), 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.7}}
            for c in colours],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(binary)}],
    }  # fmt: skip
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = (struct.pack("<I4s", len(text), b"JSON") + text
              + struct.pack("<I4s", len(binary), b"BIN\0") + bytes(binary))  # fmt: skip
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _linear(colour: str) -> list[float]:
    """Return the linear red, green and blue of a colour in sRGB (IEC 61966-2-1)."""
    parts = (int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return [round(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4, 5) for c in parts]
