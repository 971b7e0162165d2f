"""The interface of FMI-LS-WASM: FMI 3.0's types and functions in the component model's terms.

Names and types are those of the package ``fmi:fmi3@3.0.0`` of the layered standard's working draft
(github.com/modelica/fmi-ls-wasm, July 2026). Types are written as in WebAssembly's text format.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["CO_SIMULATION", "MODEL_EXCHANGE", "SHARED_TYPES", "Interface", "Method"]

PACKAGE = "fmi:fmi3"
VERSION = "3.0.0"


@dataclass(frozen=True)
class Method:
    """A function: its parameters after the instance, and its result, by name and type."""

    name: str
    parameters: tuple[tuple[str, str], ...]
    result: str


@dataclass(frozen=True)
class Interface:
    """An interface with one resource, the instance; `make` is its static function."""

    name: str
    types: dict[str, str]  # in addition to the shared ones
    make: Method
    methods: tuple[Method, ...]

    @property
    def full_name(self) -> str:
        """The name with package and version."""
        return f"{PACKAGE}/{self.name}@{VERSION}"

    @property
    def resource(self) -> str:
        """The name of the resource."""
        return f"{self.name}-instance"


def _enum(names: str) -> str:
    cases = " ".join(f'"{name}"' for name in names.split())
    return f"(enum {cases})"


def _record(fields: str) -> str:
    pairs = (field.split(":") for field in fields.split())
    written = " ".join(f'(field "{name}" {of})' for name, of in pairs)
    return f"(record {written})"


SHARED_TYPES = {
    "value-reference": "u32",
    "status": _enum("ok warning discard error fatal"),
    "fmu-state": "(list u8)",
    "interval-qualifier": _enum("interval-not-yet-known interval-unchanged interval-changed"),
    "interval-fraction": _record("counter:u64 resolution:u64"),
    "dependency-kind": _enum("dependent constant fixed tunable discrete"),
    "variable-dependency": _record(
        "dependent-value-reference:$value-reference element-index-of-dependent:u32 "
        "independent-value-reference:$value-reference element-index-of-independent:u32 "
        "kind:$dependency-kind"
    ),
    "discrete-states-info": _record(
        "new-discrete-states-needed:bool terminate-simulation:bool "
        "nominals-of-continuous-states-changed:bool values-of-continuous-states-changed:bool "
        "next-event-time-defined:bool next-event-time:f64"
    ),
}
_REFERENCES = ("value-references", "(list $value-reference)")
_DOUBLES = "(list f64)"
_FRACTIONS = "(list $interval-fraction)"
_NUMBERS = {
    "float32": "f32", "float64": "f64", "int8": "s8", "int16": "s16", "int32": "s32",
    "int64": "s64", "uint8": "u8", "uint16": "u16", "uint32": "u32", "uint64": "u64",
    "boolean": "bool", "string": "string", "binary": "(list u8)", "clock": "bool",
}  # fmt: skip


def _does(name: str, *parameters: tuple[str, str]) -> Method:
    return Method(name, parameters, "$status")


def _gives(name: str, value: str, *parameters: tuple[str, str]) -> Method:
    return Method(name, parameters, f"(result {value} (error $status))")


_DERIVATIVE = (("unknowns", _REFERENCES[1]), ("knowns", _REFERENCES[1]), ("seed", _DOUBLES))
_REQUESTS = ("requests", "(list (tuple $value-reference u32))")
_SHARED = (
    _does("set-debug-logging", ("logging-on", "bool"), ("categories", "(list string)")),
    _does(
        "enter-initialization-mode", ("tolerance", "(option f64)"), ("start-time", "f64"),
        ("stop-time", "(option f64)"),
    ),
    *(_does(name) for name in (
        "exit-initialization-mode", "enter-event-mode", "terminate", "reset",
        "enter-configuration-mode", "exit-configuration-mode", "evaluate-discrete-states",
        "enter-step-mode",
    )),
    _gives("update-discrete-states", "$discrete-states-info"),
    *(_gives(f"get-{name}", f"(list {of})", _REFERENCES) for name, of in _NUMBERS.items()),
    *(
        _does(f"set-{name}", _REFERENCES, ("values", f"(list {of})"))
        for name, of in _NUMBERS.items()
    ),
    _gives("get-number-of-variable-dependencies", "u64", ("vr", "$value-reference")),
    _gives(
        "get-variable-dependencies", "(list $variable-dependency)",
        ("dependent", "$value-reference"),
    ),
    _gives("get-fmu-state", "$fmu-state"),
    _does("set-fmu-state", ("state", "$fmu-state")),
    _gives("get-directional-derivative", _DOUBLES, *_DERIVATIVE),
    _gives("get-adjoint-derivative", _DOUBLES, *_DERIVATIVE),
    _gives("get-interval-decimal", "(list (tuple f64 $interval-qualifier))", _REFERENCES),
    _gives(
        "get-interval-fraction", "(list (tuple $interval-fraction $interval-qualifier))",
        _REFERENCES,
    ),
    _gives("get-shift-decimal", _DOUBLES, _REFERENCES),
    _gives("get-shift-fraction", _FRACTIONS, _REFERENCES),
    _does("set-interval-decimal", _REFERENCES, ("intervals", _DOUBLES)),
    _does("set-interval-fraction", _REFERENCES, ("intervals", _FRACTIONS)),
    _does("set-shift-decimal", _REFERENCES, ("shifts", _DOUBLES)),
    _does("set-shift-fraction", _REFERENCES, ("shifts", _FRACTIONS)),
    _gives("get-output-derivatives", _DOUBLES, _REQUESTS),
)  # fmt: skip
_NAMES = tuple(
    (name, "string") for name in ("instance-name", "instantiation-token", "resource-path")
)
_FLAGS = (("visible", "bool"), ("logging-on", "bool"))
_NEVER_BACK = ("no-set-fmu-state-prior-to-current-point", "bool")

CO_SIMULATION = Interface(
    "co-simulation",
    {
        "do-step-result": _record(
            "last-successful-time:f64 event-handling-needed:bool terminate-simulation:bool "
            "early-return:bool"
        )
    },
    Method(
        "instantiate-co-simulation",
        (
            *_NAMES, *_FLAGS, ("event-mode-used", "bool"), ("early-return-allowed", "bool"),
            ("required-intermediate-variables", "(list $value-reference)"),
        ),
        "(option (own $instance))",
    ),
    (
        *_SHARED,
        _does("set-input-derivatives", _REQUESTS, ("values", _DOUBLES)),
        _gives(
            "do-step", "$do-step-result", ("current-communication-point", "f64"),
            ("communication-step-size", "f64"), _NEVER_BACK,
        ),
    ),
)  # fmt: skip
MODEL_EXCHANGE = Interface(
    "model-exchange",
    {
        "completed-step-result": _record("enter-event-mode:bool terminate-simulation:bool"),
    },
    Method("instantiate-model-exchange", (*_NAMES, *_FLAGS), "(option (own $instance))"),
    (
        *_SHARED,
        _does("enter-continuous-time-mode"),
        _does("set-time", ("time", "f64")),
        _does("set-continuous-states", ("continuous-states", _DOUBLES)),
        _gives("get-continuous-state-derivatives", _DOUBLES),
        _gives("get-event-indicators", _DOUBLES),
        _gives("get-continuous-states", _DOUBLES),
        _gives("get-nominals-of-continuous-states", _DOUBLES),
        _gives("get-number-of-event-indicators", "u64"),
        _gives("get-number-of-continuous-states", "u64"),
        _gives("completed-integrator-step", "$completed-step-result", _NEVER_BACK),
    ),
)
