"""Import of a user's Python class from its file, and the description of its variables."""

from __future__ import annotations

import copy
import importlib
import inspect
import reprlib
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType

import numpy as np

from uuvsim_cosim.errors import ComponentFailed, InputInvalid
from uuvsim_cosim.fmus.description import Causality, Description, Variable
from uuvsim_cosim.models.declaration.units import unit_of
from uuvsim_cosim.orchestrator.python.user_module import import_file

__all__ = ["definition", "described", "imported", "load", "parameter", "place_of", "signal"]

_GROUPS: tuple[tuple[Causality, str], ...] = (("input", "inputs"), ("output", "outputs"))


def load(source: str) -> type:
    """Return the class of ``FILE.py:Class`` or ``package.module:Class``; raises InputInvalid."""
    where, colon, name = source.rpartition(":")
    if not colon or not name.isidentifier():
        raise InputInvalid(f"{source!r}", "FILE.py:Class or package.module:Class")
    module = imported(where, source)
    cls = getattr(module, name, None)
    if not isinstance(cls, type):
        classes = [k for k, v in vars(module).items() if isinstance(v, type) and hasattr(v, "step")]
        there = f"one of {', '.join(classes)}" if classes else "a class with step(t, dt, u) in it"
        raise InputInvalid(source, f"no class {name!r}", there)
    return cls


def imported(where: str, source: str) -> ModuleType:
    """Return the module of a file (FILE.py) or by its name; raises InputInvalid naming `source`."""
    try:
        if not where.endswith(".py"):
            return importlib.import_module(where)
        path = Path(where).expanduser().absolute()
        if not path.is_file():
            raise InputInvalid(path, "no such file", "a Python file")
        return import_file(path)
    except InputInvalid:
        raise
    except SyntaxError as error:
        raise InputInvalid(f"{error.filename}:{error.lineno}: {error.msg}") from error
    except ModuleNotFoundError as error:
        if error.name is None or not f"{where}.".startswith(f"{error.name}."):
            raise _not_imported(source, error) from error
        raise InputInvalid(
            source, error, "FILE.py:Name, or one that Python finds (PYTHONPATH)"
        ) from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit too: a file must not end the run
        raise _not_imported(source, error) from error


def _not_imported(source: str, error: BaseException) -> InputInvalid:
    last = traceback.extract_tb(error.__traceback__)[-1]
    return InputInvalid(
        f"{source}: cannot be imported: {last.filename}:{last.lineno}: "
        f"{type(error).__name__}: {error}"
    )


def place_of(error: BaseException, cls: type, method: str) -> str:
    """Return ``file:line: Error: text``, with the last line in a file of the class.

    If the error comes from a call that does not fit the method, the line is the method's own.
    """
    frames = traceback.extract_tb(error.__traceback__)[1:]  # the first is the caller
    modules = (sys.modules.get(c.__module__) for c in cls.__mro__ if c is not object)
    own = {getattr(m, "__file__", None) for m in modules}
    own_frames = [f for f in frames if f.filename in own] or frames[-1:]
    text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    last = own_frames[-1] if own_frames else None
    where = definition(cls, method) if last is None else f"{last.filename}:{last.lineno}"
    return f"{where}: {text}"


def definition(cls: type, method: str) -> str:
    """Return ``file:line`` of a method, or of the class if the method's is unknown."""
    function = inspect.unwrap(getattr(cls, method, cls))
    code = getattr(getattr(function, "__func__", function), "__code__", None)
    if code is not None:
        return f"{code.co_filename}:{code.co_firstlineno}"
    try:
        return f"{inspect.getsourcefile(cls)}:{inspect.getsourcelines(cls)[1]}"
    except (OSError, TypeError):
        return cls.__name__


def described(cls: type, make: Callable[[], object]) -> Description:
    """Return the description of the variables that a class declares.

    `make` returns an object of the class. Raises InputInvalid that lists what is missing.
    """
    place = cls.__name__
    wrong: list[str] = []
    for group in ("inputs", "outputs", "parameters"):
        declared = getattr(cls, group, None)
        if declared is None:
            wrong += [] if group == "parameters" else [f"no {group}"]
        elif not isinstance(declared, Mapping):
            wrong.append(f"{group} is {reprlib.repr(declared)}")
        else:
            odd = [k for k in declared if not isinstance(k, str) or not k]
            wrong += [f"{group} has the name {k!r}" for k in odd]
    wrong += [] if callable(getattr(cls, "step", None)) else ["no method step(t, dt, u)"]
    if wrong:
        raise InputInvalid(
            place,
            ", ".join(wrong),
            (
                "`inputs` and `outputs` as dicts name -> unit, size or (size, "
                "unit), `parameters`, if any, as a dict name -> (value, unit), and "
                "step(self, t, dt, u)"
            ),
        )
    variables = [
        signal(place, name, declared, causality)
        for causality, group in _GROUPS
        for name, declared in getattr(cls, group).items()
    ]
    given = getattr(cls, "parameters", None) or {}
    variables += [parameter(place, n, d) for n, d in given.items()]
    by_name = {v.name: v for v in variables}
    if len(by_name) != len(variables):
        twice = sorted({v.name for v in variables if [w.name for w in variables].count(v.name) > 1})
        raise InputInvalid(place, f"{', '.join(twice)} declared twice", "different names")
    try:
        made = make()
    except ComponentFailed as error:
        raise InputInvalid(error.reason, "a class that can be made without arguments") from error
    _check_call(made, cls, "step", "t, dt, u")
    if hasattr(made, "initialize"):
        _check_call(made, cls, "initialize", "t")
    try:
        copy.deepcopy(vars(made))
    except Exception:  # of the user's own classes; such a component has no snapshots
        copies = False
    else:
        copies = True
    vehicle = getattr(cls, "vehicle", "")
    return Description(
        name=cls.__name__,
        kind="python",
        variables=by_name,
        description=(cls.__doc__ or "").strip().split("\n", 1)[0],
        can_get_and_set_state=copies,
        can_serialize_state=copies,
        made_for={"figures": vehicle} if isinstance(vehicle, str) and vehicle else {},
    )


def _check_call(made: object, cls: type, method: str, arguments: str) -> None:
    """Refuse a method that cannot be called with these arguments, before anything runs."""
    try:
        signature = inspect.signature(getattr(made, method))
    except (TypeError, ValueError):  # written in C, without a signature
        return
    try:
        signature.bind(*arguments.split(", "))
    except TypeError as error:
        raise InputInvalid(
            definition(cls, method),
            (
                f"{cls.__name__}.{method}{signature} cannot be called as {method}({arguments}): "
                f"{error}"
            ),
            f"def {method}(self, {arguments})",
        ) from None


def signal(place: str, name: str, declared: object, causality: Causality) -> Variable:
    """Read a unit, a size, (size, unit) or (size, units); None or no unit: not known."""
    size: object = None
    units: object = declared
    if isinstance(declared, (tuple, list)) and len(declared) == 2:
        size, units = declared
    elif isinstance(declared, (int, np.integer)):
        size, units = declared, None
    units = (units,) if units is None or isinstance(units, str) else units
    if size is None:
        shape: tuple[int, ...] | None = ()
    elif isinstance(size, (int, np.integer)) and not isinstance(size, bool) and size > 0:
        shape = (int(size),)
    else:
        shape = None
    if (
        shape is None
        or not isinstance(units, (tuple, list))
        or len(units) not in (1, size)
        or not all(u is None or isinstance(u, str) for u in units)
    ):
        raise InputInvalid(
            f"{place}.{name}",
            f"{declared!r}",
            (
                "a unit such as 'm/s' (None if unknown), a size, (size, unit), or "
                "(size, (unit, unit, ...)) with one unit for each element"
            ),
        )
    for each in units:
        if each is not None:
            unit_of(each, f"{place}.{name}")
    return Variable(
        name=name,
        type="Float64",
        causality=causality,
        variability="continuous",
        shape=shape,
        unit=units[0] if len(units) == 1 else None,
        element_units=() if len(units) == 1 else tuple(units),
        start=np.zeros(shape) if shape else 0.0,
        dependencies=() if causality == "output" else None,
    )


def parameter(place: str, name: str, declared: object) -> Variable:
    """Read (value, unit); the unit may be None."""
    if not (isinstance(declared, (tuple, list)) and len(declared) == 2):
        raise InputInvalid(f"{place}.{name}", f"{declared!r}", "(value, unit)")
    value, unit = declared
    if unit is not None:
        if not isinstance(unit, str):
            raise InputInvalid(f"{place}.{name}", f"unit {unit!r}", "text such as 'm/s'")
        unit_of(unit, f"{place}.{name}")
    if isinstance(value, str):
        return Variable(name, "String", "parameter", "tunable", start=value)
    if isinstance(value, bool):
        return Variable(name, "Boolean", "parameter", "tunable", start=value)
    try:
        array = np.array(value, np.int32 if name == "seed" else float)
    except (TypeError, ValueError, OverflowError):
        raise InputInvalid(f"{place}.{name}", f"{value!r}", "numbers, text or a bool") from None
    return Variable(
        name=name,
        type="Int32" if name == "seed" else "Float64",
        causality="parameter",
        variability="tunable",
        shape=array.shape,
        unit=unit,
        start=array if array.shape else array.item(),
    )
