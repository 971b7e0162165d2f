"""Ray casting over arrays, by the same C code that components use."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared
from uuvsim_cosim.models.worlds.ground import Ground, ground_named, ground_of
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.models.worlds.terrain import Terrain

__all__ = ["BELOW", "NOTHING", "SEABED", "SOLID", "SURFACE", "Caster"]

Array = NDArray[np.float64]
NOTHING, SEABED, BELOW, SURFACE, SOLID = range(5)  # kinds; obstacle i is SOLID + i
LEVELS = 24  # UUV_TERRAIN_LEVELS


@final
class Caster:
    """Casts rays at the terrain, the obstacles and the water's surface of a scene.

    `scene` is a scene, a terrain alone, or the value of the option `scene` of a component.
    Frame `n` (N, E, D), metres. Arrays are read and written in place, with the GIL released.

    Example: a flat bottom at 20 m, from a depth of 5 m.

    >>> import numpy as np
    >>> from uuvsim_cosim.models import Terrain
    >>> from uuvsim_cosim.scene import SEABED, Caster
    >>> flat = np.full((4, 4), 20.0, np.float32)
    >>> caster = Caster(Terrain(flat, spacing=10.0, origin=(0.0, 0.0)))
    >>> distance, kind = caster.cast([10.0, 10.0, 5.0], [[0, 0, 1], [0, 0.6, 0.8]])
    >>> distance, kind == SEABED
    (array([15.  , 18.75]), array([ True,  True]))
    >>> caster.height([5.0, 100.0], [5.0, 5.0])
    array([20., nan])
    """

    def __init__(self, scene: Scene | Terrain | str) -> None:
        self.ground = ground_named(scene) if isinstance(scene, str) else ground_of(scene)
        self._c = _library()
        g = self.ground
        levels, three, five = ctypes.c_int * LEVELS, ctypes.c_double * 3, ctypes.c_double * 5
        # `scene` points to the arrays of `ground`, `_solids` and `_nodes`: they must outlive it.
        self._solids = (_Solid * max(1, len(g.solids)))()
        for i, row in enumerate(g.solids.tolist()):
            self._solids[i] = _Solid(int(row[0]), three(*row[1:4]), five(*row[4:9]), row[9])
        rows, columns = g.z.shape
        terrain = _Terrain(
            rows, columns, *g.origin, g.spacing, g.low, g.high, g.z.ctypes.data,
            g.ranges.ctypes.data, len(g.at) - 1, levels(*g.at), levels(*g.wide),
        )  # fmt: skip
        self._nodes = _nodes(g)
        meshes = g.surfaces
        tree = _Tree(
            self._nodes.ctypes.data, len(self._nodes), three(*meshes.middle),
            meshes.vertices.ctypes.data, meshes.corners.ctypes.data, meshes.first.ctypes.data,
            len(meshes.first) - 1,
        )  # fmt: skip
        self.scene = _Scene(terrain, ctypes.addressof(self._solids), len(g.solids), tree)

    def cast(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        far: float = np.inf,
        out: tuple[Array, NDArray[np.int32]] | None = None,
    ) -> tuple[Array, NDArray[np.int32]]:
        """Return the range of each ray, and the kind of what it meets first.

        `origins` is (n, 3), or (3,) for all; `directions` (n, 3), of any length: the range (n,) is
        in their lengths, at most `far`, and inf where nothing is met. The kind (n,) is NOTHING,
        SEABED, BELOW (the seabed from below), SURFACE or SOLID + number of the obstacle; meshes
        are counted after the obstacles. `out` are arrays for both, float64 and int32. Raises
        InputInvalid for shapes that do not fit.
        """
        o, d = _vectors(origins, "origins"), _vectors(directions, "directions")
        n = len(d)
        if len(o) not in (1, n):
            raise InputInvalid("origins", f"{len(o)} of them", f"1, or {n} as directions")
        t, kind = out if out is not None else (np.empty(n), np.empty(n, np.int32))
        for name, a, of in (("range", t, np.float64), ("kind", kind, np.int32)):
            if a.shape != (n,) or a.dtype != of or not a.flags.c_contiguous:
                raise InputInvalid("out", f"{name} is {a.dtype} {a.shape}", f"{of} ({n},)")
        common = int(len(o) == 1)
        self._c.uuv_cast_batch(
            ctypes.byref(self.scene), o.ctypes.data, common, d.ctypes.data, far, n,
            t.ctypes.data, kind.ctypes.data,
        )  # fmt: skip
        return t, kind

    def height(self, north: ArrayLike, east: ArrayLike) -> Array:
        """Return the seabed's depth [m] at `north` and `east` [m], which have one shape.

        It is NaN outside of the terrain and in its holes.
        """
        at_n, at_e = np.broadcast_arrays(np.asarray(north, float), np.asarray(east, float))
        z = np.empty(at_n.shape)
        at_n, at_e = np.ascontiguousarray(at_n), np.ascontiguousarray(at_e)
        self._c.uuv_height_batch(
            ctypes.byref(self.scene), at_n.ctypes.data, at_e.ctypes.data, z.size, z.ctypes.data
        )
        return z

    def inside(self, places: ArrayLike) -> NDArray[np.int32]:
        """Return the number of the obstacle in which each of `places` (n, 3) lies, or -1.

        Obstacles are convex: in opposite directions, only a place in one meets it both times.

        Example: in the float of the shipped canyon, and beside it.

        >>> from uuvsim_cosim.scene import Caster
        >>> Caster("canyon").inside([[-100.0, 0.0, 45.0], [-90.0, 0.0, 45.0]])
        array([ 1, -1], dtype=int32)
        """
        at = _vectors(places, "places")
        down = np.tile([0.0, 0.0, 1.0], (len(at), 1))
        up, down = (self.cast(at, d)[1] for d in (-down, down))
        known = (up == down) & (up >= SOLID) & (up < SOLID + len(self.ground.solids))
        return np.where(known, up - SOLID, -1).astype(np.int32)


def _vectors(values: ArrayLike, name: str) -> Array:
    array = np.ascontiguousarray(values, np.float64)
    if array.ndim == 1 and array.size == 3:
        array = array[None]
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputInvalid(name, f"shape {array.shape}", "(n, 3)")
    return array


class _Terrain(ctypes.Structure):
    """uuv_terrain."""

    _fields_ = (
        ("rows", ctypes.c_int),
        ("columns", ctypes.c_int),
        ("north", ctypes.c_double),
        ("east", ctypes.c_double),
        ("spacing", ctypes.c_double),
        ("low", ctypes.c_double),
        ("high", ctypes.c_double),
        ("z", ctypes.c_void_p),
        ("range", ctypes.c_void_p),
        ("top", ctypes.c_int),
        ("at", ctypes.c_int * LEVELS),
        ("wide", ctypes.c_int * LEVELS),
    )


class _Solid(ctypes.Structure):
    """uuv_solid."""

    _fields_ = (
        ("kind", ctypes.c_int),
        ("centre", ctypes.c_double * 3),
        ("size", ctypes.c_double * 5),
        ("bound", ctypes.c_double),
    )


class _Tree(ctypes.Structure):
    """uuv_tree."""

    _fields_ = (
        ("node", ctypes.c_void_p),
        ("n_nodes", ctypes.c_int),
        ("middle", ctypes.c_double * 3),
        ("vertex", ctypes.c_void_p),
        ("corner", ctypes.c_void_p),
        ("first", ctypes.c_void_p),
        ("n_meshes", ctypes.c_int),
    )


class _Scene(ctypes.Structure):
    """uuv_scene."""

    _fields_ = (
        ("terrain", _Terrain),
        ("solid", ctypes.c_void_p),
        ("n_solids", ctypes.c_int),
        ("tree", _Tree),
    )


def _nodes(g: Ground) -> NDArray[np.void]:
    """Return the tree's nodes as uuv_tree_node lies in memory."""
    nodes = np.zeros(len(g.tree.children), [("box", "f4", (6, 4)), ("child", "i4", 4)])
    nodes["box"], nodes["child"] = g.tree.boxes, g.tree.children
    return nodes


@lru_cache
def _library() -> ctypes.CDLL:
    source = content("fmus", "kernels") / "cast_batch.c"
    c = ctypes.CDLL(str(compile_shared([source], name="cast_batch", include=runtime())))
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    c.uuv_cast_batch.argtypes = [
        pointer, pointer, ctypes.c_int, pointer, ctypes.c_double, count, pointer, pointer,
    ]  # fmt: skip
    c.uuv_cast_batch.restype = None
    c.uuv_height_batch.argtypes = [pointer, pointer, pointer, count, pointer]
    c.uuv_height_batch.restype = None
    return c
