"""Observations, rewards and ends that a task declares as CasADi expressions, compiled.

The method `expressions` of a task gets the symbols of one environment and returns its results. The
compiled function evaluates all results of all environments in one call. Its operations are those of
`fmus/runtime/math`, in the order of the expressions, so its bits are the same for every number of
environments and on every machine.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import FunctionType
from typing import TYPE_CHECKING, Any, final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.signals import Instant, Signals, resolved
from uuvsim_cosim.errors import InputInvalid, ToolchainError
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.values.values import Misfit

if TYPE_CHECKING:
    from uuvsim_cosim.envs.task.task import Moment, Task, TeamTask

__all__ = [
    "Evaluated",
    "Given",
    "Logical",
    "Results",
    "Symbolic",
    "Symbols",
    "declared_methods",
    "evaluated_of",
    "results_of",
    "sin_cos",
    "split_action",
    "symbolic_of",
]

Array = NDArray[np.float64]
Results = Mapping[str, Any]  # arrays, or mappings of arrays, by name
Key = tuple[str, str]  # "now", "before", "action", "start" or "step", and a name
# Arguments of a function that are in one array: their places, and the columns of the array.
Group = tuple[Key, slice, NDArray[np.int64]]
METHODS = frozenset({"extra", "info", "observe", "reward", "terminated"})
# Methods that do not change the results of the methods above.
OTHERS = frozenset(
    {"at", "made_of", "path", "start", "state", "state_limits", "symmetries", "view"}
)  # fmt: skip


@dataclass(frozen=True)
class Logical:
    """Expression `value` whose result is True or False, for an info; others are numbers.

    Example:

    >>> import casadi as ca
    >>> from uuvsim_cosim.envs import Logical
    >>> depth = ca.SX.sym("depth")
    >>> {"info": {"depth": depth, "deep": Logical(depth > 10.0)}}["info"]["deep"].value
    SX((10<depth))
    """

    value: Any


@final
class Symbols:
    """Symbols of one environment at the end of an action, for the method `expressions` of a task.

    The attributes are those of a `Moment`, without the axis of environments: `m["hull.eta"]` is a
    CasADi column of 6 symbols, and a matrix has the shape of the variable. InputInvalid is raised
    for a name that the `task` does not read. An environment makes it, with the task's `signals`.

    Example:

    >>> import casadi as ca
    >>> import numpy as np
    >>> from uuvsim_cosim.envs import Channel, CosimEnv, Task
    >>> import uuvsim_cosim as uuv
    >>> class Dive(Task):  # reach a depth of 12 m
    ...     def expressions(self, m):
    ...         depth, before = m["hull.eta"][2], m.before["hull.eta"][2]
    ...         effort = ca.sumsqr(m.action["agent"])
    ...         return {"reward": ca.fabs(before - 12.0) - ca.fabs(depth - 12.0) - 0.01 * effort,
    ...                 "terminated": depth > 15.0,
    ...                 "info": {"time": m.time, "current": m.start["current.speed"]}}
    ...     def start(self, draws):
    ...         return {"current.speed": draws.uniform("current", 0.0, 0.3)}  # m/s
    >>> heave, depth = Channel("allocation.tau_d[3]", -100, 100, "N"), Channel("hull.eta[3]", 0, 20)
    >>> task = Dive(uuv.load("bluerov2_task"), actions=[heave], observations=[depth],
    ...             action_step="0.1", horizon=20)
    >>> env = CosimEnv(task)
    >>> _ = env.reset(seed=0)
    >>> _, reward, terminated, _, info = env.step(np.array([0.5]))
    >>> reward > -0.01, terminated, float(info["time"]), sorted(info)
    (True, False, 0.1, ['current', 'time'])
    """

    def __init__(self, task: Task | TeamTask, signals: Signals) -> None:
        self._task, self._signals = task, signals
        self._when = "now"
        self._made: dict[Key, Any] = {}
        self._before: Symbols | None = None
        self._columns: Mapping[str, slice] | None = None

    @property
    def step(self) -> Any:
        """The number of actions since the reset."""
        return self._symbol(("step", ""), ())

    @property
    def time(self) -> Any:
        """The seconds since the reset."""
        seconds = self._task.action_step
        return self.step * seconds.numerator / seconds.denominator

    @property
    def action(self) -> Mapping[str, Any]:
        """The action that led here, by agent, a column of numbers in [-1, 1]; 0 after a reset."""
        return _ByName(self._action)

    @property
    def start(self) -> Mapping[str, Any]:
        """The start values that the episode drew, by variable."""
        return _ByName(self._start)

    @property
    def before(self) -> Symbols:
        """The moment when the action began; its action and step are not available."""
        if self._before is None:
            if self._when == "before":
                raise InputInvalid("expressions, before.before", "one action back")
            self._before = Symbols(self._task, self._signals)
            self._before._when, self._before._made = "before", self._made
        return self._before

    def __getitem__(self, name: str) -> Any:
        """Return the symbols of a signal, in the variable's own unit."""
        shape = self._signals.shape(name)
        return self._symbol((self._when, name), shape)

    def _action(self, agent: str) -> Any:
        if self._columns is not None:
            if agent not in self._columns:
                raise InputInvalid(f"action of {agent!r}", f"one of {', '.join(self._columns)}")
            return self._action_of("agent")[self._columns[agent]]
        return self._action_of(agent)

    def _action_of(self, agent: str) -> Any:
        width = _width(self._signals.plan, self._task, agent)
        return self._symbol(("action", agent), (width,))

    def _start(self, name: str) -> Any:
        try:
            shape = resolved(self._signals.plan, name).variable.shape
        except Misfit as misfit:
            raise InputInvalid(str(misfit.at(f"start value {name!r}"))) from None
        return self._symbol(("start", name), shape)

    def _symbol(self, key: Key, shape: tuple[int, ...]) -> Any:
        import casadi as ca

        if len(shape) > 2:
            raise InputInvalid(f"expressions, {key[1]!r}", f"of shape {shape}", "a row or a matrix")
        if self._when == "before" and key[0] in ("action", "step"):
            raise InputInvalid(f"expressions, before.{key[0]}", "it of the present moment only")
        if key not in self._made:
            self._made[key] = ca.SX.sym(".".join(key), int(np.prod(shape, dtype=int)))
        flat = self._made[key]
        return flat if len(shape) < 2 else ca.reshape(flat, shape[1], shape[0]).T


def split_action(m: Symbols, columns: Mapping[str, slice]) -> Symbols:
    """Return the same moment with the action "agent" split by agent of a team."""
    other = Symbols(m._task, m._signals)
    other._made, other._columns = m._made, columns
    return other


class _ByName(Mapping[str, Any]):
    """A mapping of names that are not known in advance."""

    def __init__(self, make: Callable[[str], Any]) -> None:
        self._make = make

    def __getitem__(self, name: str) -> Any:
        return self._make(name)

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


def _width(plan: Any, task: Any, agent: str) -> int:
    """Return the width of an agent's action; a task of one agent has the agent "agent"."""
    several = isinstance(task.actions, Mapping)
    if several and agent not in task.actions:
        raise InputInvalid(f"action of {agent!r}", f"one of {', '.join(task.actions)}")
    channels = task.actions[agent] if several else task.actions
    return sum(len(resolved(plan, c.name).elements) for c in channels)


@final
class Evaluated:
    """The compiled function of a task's expressions: `of` returns its results at a moment."""

    def __init__(self, task: Task | TeamTask, place: str, declared: Results, made: Any) -> None:
        import casadi as ca

        self._place = place
        declared = dict(sorted(declared.items(), key=lambda item: item[0] == "extra"))
        self.keys = tuple(declared)
        self._leaves: list[tuple[tuple[str, ...], int, int, bool]] = []
        columns: list[Any] = []
        self._collect((), declared, columns)
        results = ca.vertcat(*columns) if columns else ca.SX(0, 1)
        self._n_out = results.numel()
        used = {s.name() for s in ca.symvar(results)}
        symbols: list[Any] = []
        self._sources: list[Group] = []
        self._n_in = 0
        for key, flat in sorted(made.items()):  # so those of a moment follow each other
            elements = [i for i in range(flat.numel()) if flat[i].name() in used]
            if elements:
                symbols.append(flat[elements])
                where = slice(self._n_in, self._n_in + len(elements))
                self._sources.append((key, where, np.array(elements, np.int64)))
                self._n_in = where.stop
        f = ca.Function(
            "evaluate", [ca.vertcat(*symbols) if symbols else ca.SX(0, 1)],
            [ca.densify(results)], {"cse": True, "allow_free": True},
        )  # fmt: skip
        if f.has_free():
            raise InputInvalid(place, f"free symbols {f.get_free()}", "symbols of m alone")
        self._c = _compiled(f, self._n_in, self._n_out)
        self._found: tuple[Signals | None, list[Group] | None] = None, None
        self._layout: tuple[list[Group], list[Any], NDArray[np.int64]]
        self._layout = [], [], np.empty((2, 0), np.int64)
        self._last: tuple[Moment | None, Results] = (None, {})
        self._wanted = _Rows()  # the whole observation of a task, if it is `extra`
        for path, at, size, _ in self._leaves:
            if path == ("extra",) and not getattr(task, "observations", True):
                given = getattr(task, "extra_limits", ())
                self._limits = [np.ascontiguousarray(e, np.float32).ravel() for e in given]
                if all(len(e) == size for e in self._limits):
                    self._wanted = _Rows(at, size, *map(_address, self._limits))
        self._written: NDArray[np.float32] | None = None

    def of(self, m: Moment) -> Results:
        """Return the results at a moment, with the keys of the expressions: (n,) or (n, k)."""
        results = self._others(m)
        if not self._wanted.address:
            return results
        return {**results, "extra": self._evaluate(m, _Rows())["extra"]}

    def result(self, key: str, m: Moment) -> Any:
        """Return the result with one key at a moment, as `of` does."""
        return (self.of(m) if key == "extra" else self._others(m))[key]

    def observations(self, m: Moment) -> NDArray[np.float32] | None:
        """Return the observations at a moment, clipped, (n, width).

        None if the task also has `observations`, or if a number is not finite.
        """
        self._others(m)
        return self._written

    def _others(self, m: Moment) -> Results:
        """Return the results at a moment that are not written as rows."""
        last, results = self._last
        if last is not m:
            wanted = self._wanted
            written = np.empty((m.n, wanted.count), np.float32)
            wanted.rows, wanted.finite = _address(written), 1
            results = self._evaluate(m, wanted)
            self._written = written if wanted.address and wanted.finite else None
            self._last = m, results
        return results

    def _evaluate(self, m: Moment, written: _Rows) -> Results:
        """Return the results at a moment, except those that are `written` as rows."""
        table, arrays = self._arguments(m)  # the arrays must live until they were read
        n = m.n
        out = np.empty((written.first if written.address else self._n_out, n))
        first = _address(table)
        self._c(first, first + table.strides[0], _address(out), n, written.address)
        del arrays
        return self._results(out, "extra" if written.address else "")

    def _arguments(self, m: Moment) -> tuple[NDArray[np.int64], list[Array]]:
        """Return addresses and strides of the arguments at a moment, and the arrays (n, k) there.

        Only the addresses of the arrays change from one moment to the next one.
        """
        groups = self._groups(m.signals if isinstance(m, Instant) else None)
        arrays = [self._read(m, key) for key, _, _ in groups]
        strides = [array.strides for array in arrays]
        if self._layout[0] is not groups or self._layout[1] != strides:
            places = np.empty((2, self._n_in), np.int64)
            for (_, where, columns), (row, column) in zip(groups, strides, strict=True):
                places[0, where] = columns * column
                places[1, where] = row
            self._layout = groups, strides, places
        table = self._layout[2].copy()
        for (_, where, _), array in zip(groups, arrays, strict=True):
            table[0, where] += _address(array)
        return table, arrays

    def _groups(self, signals: Signals | None) -> list[Group]:
        """Return the arguments by array: those in the values of an instant are together."""
        known, groups = self._found
        if groups is None or signals is not known:
            groups = self._sources
            if signals is not None:
                groups = [s for s in groups if s[0][0] not in ("before", "now")]
                for when in ("before", "now"):
                    own = [s for s in self._sources if s[0][0] == when]
                    if own:
                        rows = [signals.rows(resolved(signals.plan, k[1]))[e] for k, _, e in own]
                        where = slice(own[0][1].start, own[-1][1].stop)
                        groups.append(((when, ""), where, np.concatenate(rows).astype(np.int64)))
            self._found = signals, groups
        return groups

    @staticmethod
    def _read(m: Moment, key: Key) -> Array:
        """Return an array (n, k): with the name "", all values of an instant."""
        kind, name = key
        if kind == "step":
            found: Any = m.step
        elif kind == "action":
            found = m.action[name]
        elif kind == "start":
            found = m.start[name]
        else:
            then = m if kind == "now" else m.before
            if not name:
                values: Array = then.values.T  # type: ignore[attr-defined]
                return values
            found = then[name]
        return np.asarray(found, float).reshape(m.n, -1)

    def _collect(self, path: tuple[str, ...], declared: Any, columns: list[Any]) -> None:
        import casadi as ca

        if isinstance(declared, Mapping):
            for name, value in declared.items():
                self._collect((*path, name), value, columns)
            return
        is_mask = path[0] == "terminated" or isinstance(declared, Logical)
        try:
            value = ca.SX(declared.value if isinstance(declared, Logical) else declared)
        except (NotImplementedError, TypeError):
            read = f"{'.'.join(path)}: {declared!r}"
            raise InputInvalid(self._place, read, "a CasADi expression (SX) or a number") from None
        flat = ca.vec(value.T)
        is_row = path[0] in ("extra", "observe") or flat.numel() != 1
        first = sum(c.numel() for c in columns)
        columns.append(flat)
        self._leaves.append((path, first, flat.numel() if is_row else 0, is_mask))

    def _results(self, out: Array, without: str) -> Results:
        results: dict[str, Any] = {}
        for path, first, size, is_mask in self._leaves:
            if path[0] == without:
                continue
            into = results
            for name in path[:-1]:
                into = into.setdefault(name, {})
            value: Any = out[first : first + size].T if size else out[first]
            into[path[-1]] = value != 0.0 if is_mask else value
        return results


class _Rows(ctypes.Structure):
    """`uuv_rows` of fmus/kernels/uuv_lane_arrays.h."""

    _fields_ = (
        ("first", ctypes.c_int64),
        ("count", ctypes.c_int64),
        ("least", ctypes.c_void_p),
        ("greatest", ctypes.c_void_p),
        ("rows", ctypes.c_void_p),
        ("finite", ctypes.c_int64),
    )

    def __init__(self, *values: int) -> None:
        super().__init__(*values)
        self.address = ctypes.addressof(self) if values else 0


def _address(array: NDArray[Any]) -> int:
    address: int = array.__array_interface__["data"][0]
    return address


def _compiled(f: Any, n_in: int, n_out: int) -> Callable[..., None]:
    """Compile a function of one column into one on arrays (fmus/kernels/uuv_lane_arrays.h)."""
    from uuvsim_cosim.fmus.codegen.emit_c import emit_function
    from uuvsim_cosim.fmus.codegen.processor import processor_flags
    from uuvsim_cosim.fmus.codegen.toolchain import load_library
    from uuvsim_cosim.kernels.codegen.program import compiled

    called = sorted({g.name() for g in f.find_functions()})
    if called:
        raise InputInvalid("expressions", f"calls of {', '.join(called)}", "no called functions")
    text = "\n".join(
        [
            "/* Generated from the expressions of a task: do not edit. */",
            '#include "uuv_math.h"',
            f"enum {{ N_IN = {n_in}, N_OUT = {n_out} }};",
            emit_function(f, "evaluate(const V *b, V *out)", ("b", "out")),
            '#include "uuv_lane_arrays.h"',
            "",
        ]
    )
    path = compiled("expressions", text, ("-DUUV_W=8", "-Wno-psabi", *processor_flags(False)))
    pointer = ctypes.c_void_p
    signature = (None, [pointer, pointer, pointer, ctypes.c_int64, pointer])
    c = load_library(path, {"uuv_evaluate": signature})
    function: Callable[..., None] = c.uuv_evaluate
    return function


_evaluated: WeakKeyDictionary[Any, Evaluated | None] = WeakKeyDictionary()


@dataclass(frozen=True)
class Symbolic:
    """Expressions of a task that are not compiled, and their symbols by key, as flat columns.

    A key is ("now" or "before", signal), ("action", agent), ("start", variable) or ("step", "").
    """

    place: str  # for messages
    results: Results
    symbols: Mapping[Key, Any]


def symbolic_of(task: Task | TeamTask) -> Symbolic | None:
    """Return the expressions of a task, or None if it declares none; raises InputInvalid."""
    signals = Signals(flatten(task.system), _names(task))
    m = Symbols(task, signals)
    place = f"task {type(task).__name__}, expressions()"
    declared = task.expressions(m)
    if declared is None:
        return None
    if not isinstance(declared, Mapping):
        raise InputInvalid(place, f"{declared!r}", "expressions by name")
    for name in declared:
        if name not in METHODS:
            raise InputInvalid(place, f"{name!r}", f"some of {', '.join(sorted(METHODS))}")
    return Symbolic(place, declared, m._made)


def evaluated_of(task: Task | TeamTask) -> Evaluated | None:
    """Return the compiled expressions of a task, or None if it declares none."""
    if task not in _evaluated:
        found = symbolic_of(task)
        _evaluated[task] = (
            None if found is None else Evaluated(task, found.place, found.results, found.symbols)
        )
    return _evaluated[task]


@final
class Given:
    """Results of the methods of a task: those of its compiled expressions, else of the method."""

    def __init__(self, task: Task | TeamTask) -> None:
        self._task = task
        methods = declared_methods(task)
        self._evaluated = evaluated_of(task) if methods else None
        keys = () if self._evaluated is None else self._evaluated.keys
        self._declared = methods.intersection(keys)

    def __call__(self, method: str, m: Moment) -> Any:
        """Return the result of a method at a moment."""
        if self._evaluated is not None and method in self._declared:
            return self._evaluated.result(method, m)
        return getattr(self._task, method)(m)

    def observations(self, m: Moment) -> NDArray[np.float32] | None:
        """Return the whole observations at a moment if they are compiled, clipped, (n, width)."""
        if self._evaluated is None or "extra" not in self._declared:
            return None
        return self._evaluated.observations(m)


def results_of(task: Any, m: Moment, name: str) -> Any:
    """Return the compiled result of a method of a task at a moment, or None if it has none.

    A subclass that overrides the method, or a method that its result may depend on, without
    overriding `expressions`, has none.
    """
    evaluated = evaluated_of(task) if name in declared_methods(task) else None
    return None if evaluated is None or name not in evaluated.keys else evaluated.result(name, m)


def declared_methods(task: Task | TeamTask) -> frozenset[str]:
    """Return the methods whose results the expressions of a task may give."""
    overridden = METHODS.intersection(vars(task))
    for owner in type(task).__mro__:
        own = {
            name
            for name, value in vars(owner).items()
            if isinstance(value, FunctionType | property) and not name.startswith("__")
        }
        if "expressions" in own:
            break
        overridden |= own
    else:
        return frozenset()
    others = {name for name in overridden - METHODS - OTHERS if hasattr(owner, name)}
    return frozenset() if others else METHODS - overridden


@lru_cache(maxsize=1)
def _sin_cos() -> Callable[..., None] | None:
    import casadi as ca

    x = ca.SX.sym("x")
    try:
        return _compiled(ca.Function("evaluate", [x], [ca.vertcat(ca.sin(x), ca.cos(x))]), 1, 2)
    except ToolchainError:
        return None


def sin_cos(angles: Array) -> tuple[Array, Array]:
    """Return sine and cosine with the bits of compiled expressions; NumPy's without a compiler.

    NumPy's own differ between versions and processors.
    """
    function = _sin_cos()
    if function is None:
        return np.sin(angles), np.cos(angles)
    flat = np.ascontiguousarray(angles, float).reshape(-1)
    places = np.array([_address(flat), flat.itemsize], np.int64)
    out = np.empty((2, len(flat)))
    function(_address(places), _address(places) + 8, _address(out), len(flat), 0)
    return out[0].reshape(angles.shape), out[1].reshape(angles.shape)


def _names(task: Any) -> list[str]:
    channels = () if isinstance(task.actions, Mapping) else task.observations
    return [*(c.name for c in channels), *task.signals]
