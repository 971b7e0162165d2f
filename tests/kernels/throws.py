"""Hulls of any size and mass that are thrown at a scene, by the C that components run."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared
from uuvsim_cosim.models.hull.contact import KAPPA
from uuvsim_cosim.models.hull.contact_reference import Hull
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.scene.shared.ray_casting import Caster

Array = NDArray[np.float64]


class _Hull(ctypes.Structure):
    """uuv_hull."""

    _fields_ = (
        ("scene", ctypes.c_void_p),
        ("material", ctypes.c_void_p),
        ("friction", ctypes.c_void_p),
        ("rub", ctypes.c_void_p),
        ("middle", ctypes.c_double * 3),
        ("half", ctypes.c_double * 3),
        ("n_half", ctypes.c_int),
        ("radius", ctypes.c_double),
    )


class _Throw(ctypes.Structure):
    """throw_."""

    _fields_ = (
        ("M", ctypes.c_double * 6),
        ("h", ctypes.c_double),
        ("kappa", ctypes.c_double),
        ("mu", ctypes.c_double),
        ("push", ctypes.c_double * 3),
        ("late", ctypes.c_int),
        ("steps", ctypes.c_int),
        ("pushed", ctypes.c_int),
    )


class _Thrown(ctypes.Structure):
    """thrown_."""

    _fields_ = (
        ("at", ctypes.c_double * 13),
        ("energy", ctypes.c_double),
        ("first", ctypes.c_double),
        ("deep", ctypes.c_double),
        ("ahead", ctypes.c_double),
    )


@dataclass(frozen=True)
class Thrown:
    """How a throw ended, and what was greatest on the way."""

    place: Array  # m, of CO
    attitude: Array
    nu: Array
    energy: float  # J, the greatest after a step
    first: float  # J, at the start
    deep: float  # m, the greatest depth
    ahead: float  # m, the farthest N


def throw(
    scene: Scene,
    hull: Hull,
    M: ArrayLike,
    h: float,
    place: ArrayLike,
    attitude: ArrayLike,
    nu: ArrayLike,
    *,
    steps: int,
    mu: float = 0.3,
    late: int = 2,
    push: ArrayLike = (0, 0, 0),
    pushed: int = 0,
) -> Thrown:
    """Throw a hull and give how it ends; `late` steps lie between a pose and its force.

    A thrust accelerates it by `push` (3) in n for the first `pushed` steps [m/s²].
    """
    three, six = ctypes.c_double * 3, ctypes.c_double * 6
    c_hull = _hull(scene, hull)
    given = _Throw(
        six(*np.asarray(M, float)), h, KAPPA, mu, three(*np.asarray(push, float)), late, steps,
        pushed,
    )  # fmt: skip
    start = np.concatenate([np.asarray(a, float).ravel() for a in (place, attitude, nu)])
    out = _Thrown()
    _library().contact_throw(
        ctypes.byref(c_hull), ctypes.byref(given), start.ctypes.data, ctypes.byref(out)
    )
    end = np.array(out.at)
    return Thrown(end[:3], end[3:7], end[7:], out.energy, out.first, out.deep, out.ahead)


def forces(scene: Scene, hull: Hull, x: Array, *, every: bool = False) -> Array:
    """Return the values (n, 8) of arguments (n, HEAD); `every`: without the tree."""
    y = np.zeros((len(x), 8))
    c_hull, x = _hull(scene, hull), np.ascontiguousarray(x)
    _library(every).contact_values(ctypes.byref(c_hull), len(x), x.ctypes.data, y.ctypes.data)
    return y


def places(scene: Scene, hull: Hull, x: Array, *, every: bool = False) -> Array:
    """Return what is remembered (n, 4) of arguments (n, PLACE); `every`: without the tree."""
    y = np.zeros((len(x), 4))
    c_hull, x = _hull(scene, hull), np.ascontiguousarray(x)
    _library(every).contact_places(ctypes.byref(c_hull), len(x), x.ctypes.data, y.ctypes.data)
    return y


def _hull(scene: Scene, hull: Hull) -> _Hull:
    at, three = ctypes.addressof(_caster(scene).scene), ctypes.c_double * 3
    shape = three(*hull.middle), three(*hull.half), hull.n, hull.radius
    return _Hull(at, None, None, None, *shape)


@lru_cache(maxsize=64)
def _caster(scene: Scene) -> Caster:
    return Caster(scene)


@lru_cache
def _library(every: bool = False) -> ctypes.CDLL:
    source = Path(__file__).with_name("contact_throw.c")
    flags = ["-DUUV_CANDIDATES=1"] if every else []  # so that more are found, and all are looked at
    name = "contact_throw_every" if every else "contact_throw"
    c = ctypes.CDLL(str(compile_shared([source], name=name, include=runtime(), flags=flags)))
    pointer = ctypes.c_void_p
    c.contact_throw.argtypes = [pointer] * 4
    for each in (c.contact_values, c.contact_places):
        each.argtypes = [pointer, ctypes.c_int, pointer, pointer]
    for each in (c.contact_throw, c.contact_values, c.contact_places):
        each.restype = None
    return c
