"""A user's Python class is found in its file, and what it declares is described."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Causality, Description, Variable
from uuvsim_cosim.models.units import unit_of

__all__ = ["described", "load", "place_of"]


def load(source: str) -> type[Any]:
    """Give the class of ``FILE.py:Class`` or ``package.module:Class``; raises InputInvalid."""
    where, colon, name = source.rpartition(":")
    if not colon or not name.isidentifier():
        raise InputInvalid(f"{source!r}; expected FILE.py:Class or package.module:Class")
    module = _module(where, source)
    cls = getattr(module, name, None)
    if not isinstance(cls, type):
        classes = [k for k, v in vars(module).items() if isinstance(v, type) and hasattr(v, "step")]
        there = f"one of {', '.join(classes)}" if classes else "a class with step(t, dt, u) in it"
        raise InputInvalid(f"{source}: no class {name!r}; expected {there}")
    return cls


def _module(where: str, source: str) -> ModuleType:
    try:
        if not where.endswith(".py"):
            return importlib.import_module(where)
        path = Path(where).expanduser().absolute()
        if not path.is_file():
            raise InputInvalid(f"{path}: no such file; expected a Python file")
        # A new module for each content, so that an edited file is read again.
        name = f"uuvsim_user_{path.stem}_{content_hash([str(path), path.read_bytes()])}"
        if name in sys.modules:
            return sys.modules[name]
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        if str(path.parent) not in sys.path:
            sys.path.append(str(path.parent))  # as a script, it may import its neighbours
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
    except InputInvalid:
        raise
    except SyntaxError as error:
        raise InputInvalid(f"{error.filename}:{error.lineno}: {error.msg}") from error
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        raise InputInvalid(
            f"{source}: cannot be imported: {last.filename}:{last.lineno}: "
            f"{type(error).__name__}: {error}"
        ) from error
    return module


def place_of(error: Exception, cls: type[Any]) -> str:
    """Give ``file:line: Error: text``, with the last line that lies in the class's own file."""
    frames = traceback.extract_tb(error.__traceback__)
    own = getattr(sys.modules.get(cls.__module__), "__file__", None)
    mine = [f for f in frames if f.filename == own] or frames[-1:]
    text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return f"{mine[-1].filename}:{mine[-1].lineno}: {text}"


def described(cls: type[Any], make: Callable[[], Any]) -> Description:
    """Describe what a class declares; raises InputInvalid with what is missing."""
    place = cls.__name__
    wrong = [f"no {n}" for n in ("inputs", "outputs") if not isinstance(_of(cls, n), Mapping)]
    wrong += [] if callable(getattr(cls, "step", None)) else ["no method step(t, dt, u)"]
    if wrong:
        raise InputInvalid(
            f"{place}: {', '.join(wrong)}; expected `inputs` and `outputs` as dicts name -> unit "
            "or (size, unit), and step(self, t, dt, u)"
        )
    variables = [
        _signal(place, name, declared, causality)
        for causality, group in (("input", "inputs"), ("output", "outputs"))
        for name, declared in _of(cls, group).items()
    ]
    variables += [_parameter(place, n, d) for n, d in (_of(cls, "parameters") or {}).items()]
    by_name = {v.name: v for v in variables}
    if len(by_name) != len(variables):
        twice = sorted({v.name for v in variables if [w.name for w in variables].count(v.name) > 1})
        raise InputInvalid(f"{place}: {', '.join(twice)} declared twice; expected different names")
    return Description(
        name=cls.__name__,
        kind="python",
        variables=by_name,
        description=(cls.__doc__ or "").strip().split("\n", 1)[0],
        can_get_and_set_state=_can_be_copied(make),
        can_serialize_state=_can_be_copied(make),
    )


def _of(cls: type[Any], name: str) -> Any:
    return getattr(cls, name, None)


def _signal(place: str, name: str, declared: Any, causality: str) -> Variable:
    size: int | None = None
    unit = declared
    if isinstance(declared, (tuple, list)) and len(declared) == 2:
        size, unit = declared
    units = (unit,) if isinstance(unit, str) else unit
    good = size is None or (isinstance(size, int) and size > 0)
    good = good and isinstance(units, (tuple, list)) and len(units) in (1, size)
    if not good or not all(isinstance(u, str) for u in units):
        raise InputInvalid(
            f"{place}.{name}: {declared!r}; expected a unit such as 'm/s', (size, unit), or "
            "(size, (unit, unit, ...)) with one unit for each element"
        )
    for each in units:
        unit_of(each, f"{place}.{name}")
    kind: Causality = "input" if causality == "input" else "output"
    shape = () if size is None else (size,)
    return Variable(
        name=name,
        type="Float64",
        causality=kind,
        variability="continuous",
        shape=shape,
        unit=units[0] if len(units) == 1 else None,
        element_units=() if len(units) == 1 else tuple(units),
        start=np.zeros(shape) if shape else 0.0,
        dependencies=() if kind == "output" else None,
    )


def _parameter(place: str, name: str, declared: Any) -> Variable:
    if not (isinstance(declared, (tuple, list)) and len(declared) == 2):
        raise InputInvalid(f"{place}.{name}: {declared!r}; expected (value, unit)")
    value, unit = declared
    unit_of(unit, f"{place}.{name}")
    if isinstance(value, str):
        return Variable(name, "String", "parameter", "tunable", start=value)
    if isinstance(value, bool):
        return Variable(name, "Boolean", "parameter", "tunable", start=value)
    try:
        array = np.array(value, np.int32 if name == "seed" else float)
    except (TypeError, ValueError):
        raise InputInvalid(f"{place}.{name}: {value!r}; expected numbers, text or a bool") from None
    return Variable(
        name=name,
        type="Int32" if name == "seed" else "Float64",
        causality="parameter",
        variability="tunable",
        shape=array.shape,
        unit=unit,
        start=array if array.shape else array.item(),
    )


def _can_be_copied(make: Callable[[], Any]) -> bool:
    import copy

    made = make()
    try:
        copy.deepcopy(vars(made))
    except Exception:
        return False
    return True
