"""Added mass of a closed surface by a panel method, from three meshes, and the record of it.

Capytaine (Ancellin and Dias 2019, JOSS 4(36), 1341) computes the influence of panels with a
constant source on each other in infinite fluid: no free surface, no bottom, no waves. One system of
equations has the six motions as right sides. The error of constant sources on flat panels is
a h + b h², with h the side of a panel: three similar meshes determine a, b and the value at h = 0
(Richardson).
"""

from __future__ import annotations

import hashlib
import json
import logging
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.shapes.mesh import Mesh, solid_of
from uuvsim_cosim.models.shapes.panels import panel_meshes

__all__ = ["RECORD", "PanelResult", "by_panels", "extrapolated", "mesh_hash", "stored_result"]

Array = NDArray[np.float64]
RECORD = "added_mass.json"  # in the folder of a vehicle
_LOST = 0.04  # part of the volume that the finest mesh may lose


@dataclass(frozen=True)
class PanelResult:
    """Added mass over the density of water about the origin, and how it was computed.

    `values` (6, 6) [m3, m4, m5] is extrapolated; the true matrix of the surface is expected within
    `half_widths` (6, 6) of it. `meshes` has the matrix of each mesh, the coarsest first.
    """

    values: Array
    half_widths: Array
    cuts: tuple[int, ...]
    panels: tuple[int, ...]
    meshes: tuple[Array, ...]
    sha256: str
    capytaine: str

    def text(self, file: str) -> str:
        """Return the record of a surface's `file`, as JSON."""
        data = {
            "what": "added mass over the density of water, about CO in FRD; units m3, m4, m5",
            "file": file,
            "mesh_sha256": self.sha256,
            "capytaine": self.capytaine,
            "cuts": self.cuts,
            "panels": self.panels,
            "values": _rows(self.values),
            "half_widths": _rows(self.half_widths),
            "meshes": [_rows(m) for m in self.meshes],
        }
        parts = (f"  {json.dumps(name)}: {json.dumps(value)}" for name, value in data.items())
        return "{\n" + ",\n".join(parts) + "\n}\n"


def mesh_hash(mesh: Mesh) -> str:
    """Return the SHA-256 of a surface's triangles in m and FRD, in their order, as float32."""
    return hashlib.sha256(np.asarray(mesh.triangles, "<f4").tobytes()).hexdigest()


def stored_result(folder: Path, sha256: str) -> PanelResult:
    """Read the record in a vehicle's folder; raises InputInvalid if it is of another surface."""
    path = folder / RECORD
    try:
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        result = PanelResult(
            np.array(data["values"], float).reshape(6, 6),
            np.array(data["half_widths"], float).reshape(6, 6),
            tuple(data["cuts"]),
            tuple(data["panels"]),
            tuple(np.array(m, float).reshape(6, 6) for m in data["meshes"]),
            str(data["mesh_sha256"]),
            str(data["capytaine"]),
        )
    except OSError:
        raise InputInvalid(
            path, "no such file", "a vehicle's folder that `uuvsim models import` wrote"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise InputInvalid(
            path, f"is no record of added mass ({error})", "the file as it was written"
        ) from None
    if result.sha256 != sha256:
        raise InputInvalid(
            path,
            f"belongs to the surface {result.sha256[:12]}…, and this one is {sha256[:12]}…",
            "the same surface, --scale and --axes; or --added-mass capytaine to compute again",
        )
    return result


def by_panels(mesh: Mesh, place: str, sha256: str) -> PanelResult:
    """Compute the added mass about the origin; `place` names the surface in messages.

    Raises InputInvalid if Capytaine is not installed, or if the surface needs too many panels.
    """
    try:
        import capytaine
    except ImportError:
        raise InputInvalid(
            "--added-mass capytaine",
            "Capytaine is not installed",
            "`pip install 'uuvsim-cosim[hydro]'`, or --added-mass ellipsoid",
        ) from None
    panels = panel_meshes(mesh, place)
    volume = solid_of(mesh).volume
    lost = 1.0 - panels.volume(panels.meshes[-1]) / volume
    if abs(lost) > _LOST:
        raise InputInvalid(
            place,
            f"{len(panels.meshes[-1])} panels show a volume that is {100 * lost:.2g} % smaller",
            f"at most {100 * _LOST:g} %: leave thin parts and details out of the surface",
        )
    # Without a free surface there is nothing to tabulate; Capytaine announces it all the same.
    logging.getLogger("capytaine").setLevel(logging.ERROR)
    green = capytaine.Delhommeau(tabulation_nr=0, tabulation_nz=0, tabulation_cache_dir=None)
    meshes = tuple(_solved(capytaine, green, part, panels.mirrored) for part in panels.meshes)
    values, half_widths = extrapolated(panels.cuts, meshes)
    return PanelResult(
        _without_noise(values, volume),
        half_widths,
        panels.cuts,
        tuple(panels.count(part) for part in panels.meshes),
        meshes,
        sha256,
        str(capytaine.__version__),
    )


def _solved(capytaine: Any, green: Any, part: Array, mirrored: tuple[int, ...]) -> Array:
    """Return the symmetric matrix (6, 6) of one mesh and its mirror images, for water of density 1.

    A motion that a mirror plane reverses has sources of opposite sign on the two sides. So each
    group of motions with the same signs has a system with the panels of the part alone.
    """
    from scipy.linalg import solve

    images = [tuple(c) for c in product(*[(1, -1) if a in mirrored else (1,) for a in range(3)])]
    meshes = [_mesh(capytaine, part * sign, bool(np.prod(sign) < 0)) for sign in images]
    first = meshes[0]
    pairs = [
        green.evaluate_rankine_only(first, mesh, diagonal_term_in_double_layer=k == 0)
        for k, mesh in enumerate(meshes)
    ]
    normals = np.concatenate(
        [first.faces_normals, np.cross(first.faces_centers, first.faces_normals)], axis=1
    )
    # The sign of each of the six motions under each image: a rotation is mirrored the other way.
    signs = np.array([[*sign, *(np.prod(sign) * np.array(sign))] for sign in images])
    matrix = np.zeros((6, 6))
    for group in np.unique(signs, axis=1).T:
        motions = np.flatnonzero((signs == group[:, None]).all(axis=0))
        S, K = (sum(s * pair[n] for s, pair in zip(group, pairs, strict=True)) for n in (0, 1))
        sources = solve(K, normals[:, motions], overwrite_a=True, check_finite=False)
        work = (normals[:, motions] * first.faces_areas[:, None]).T @ (S @ sources)
        matrix[np.ix_(motions, motions)] = -len(images) * work
    return np.asarray(0.5 * (matrix + matrix.T))


def _mesh(capytaine: Any, triangles: Array, turned: bool) -> Any:
    """Return Capytaine's mesh: four corners a panel, of which a triangle has one twice."""
    corners = (triangles[:, ::-1] if turned else triangles).reshape(-1, 3)
    at = np.arange(len(corners)).reshape(-1, 3)
    faces = np.concatenate([at, at[:, :1]], axis=1)
    return capytaine.Mesh(corners, faces, auto_clean=False, auto_check=False)


def extrapolated(cuts: tuple[int, ...], meshes: tuple[Array, ...]) -> tuple[Array, Array]:
    """Return values at panels of no size, and half widths, from meshes of 1/cuts.

    Three meshes: value + a h + b h². The half width is the distance to value + a h through the two
    finest meshes, and at least 0.2 % of the diagonal elements. Two meshes: value + a h, with the
    distance to the finer mesh as half width.
    """
    h = 1.0 / np.array(cuts, float)
    x = np.array(meshes)
    line = x[-1] - (x[-2] - x[-1]) * h[-1] / (h[-2] - h[-1])
    if len(cuts) == 2:
        values, half = line, np.abs(line - x[-1])
    else:
        weights = [np.prod([h[j] / (h[j] - h[i]) for j in range(3) if j != i]) for i in range(3)]
        values = np.einsum("k,kij->ij", weights, x)
        half = np.abs(values - line)
    scale = np.sqrt(np.maximum(np.diag(values), 0.0))
    return values, np.maximum(half, 2e-3 * np.outer(scale, scale))


def _without_noise(values: Array, volume: float) -> Array:
    """Return the matrix without elements whose size shows that they are zero."""
    out = values.copy()
    none = np.diag(out) < 1e-3 * np.array([volume] * 3 + [volume ** (5.0 / 3.0)] * 3)
    out[none], out[:, none] = 0.0, 0.0
    scale = np.sqrt(np.diag(out))
    small = np.abs(out) < 1e-3 * np.outer(scale, scale)
    out[small & ~np.eye(6, dtype=bool)] = 0.0
    return out


def _rows(matrix: Array) -> list[list[float]]:
    return [[float(f"{v:.9g}") for v in row] for row in matrix.tolist()]
