"""Exported FMUs run in Model Exchange as they run in Co-Simulation."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.simulation import instantiate_fmu

from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.importer.fmu2 import Fmu2
from uuvsim_cosim.fmus.importer.fmu3 import Fmu3
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.model_exchange.component import ModelExchange
from uuvsim_cosim.models.declaration.library import declare

Exported = Callable[[str, Any], tuple[Path, Path]]
both = pytest.mark.parametrize("fmi", [2, 3])


class Exchange:
    """One Model Exchange instance of a tiny declaration, driven through FMPy."""

    def __init__(self, folder: Path) -> None:
        self.description = fmpy.read_model_description(str(folder))
        self.messages: list[str] = []
        self.x = instantiate_fmu(
            str(folder),
            self.description,
            "ModelExchange",
            logger=lambda *a: self.messages.append(
                a[-1].decode() if isinstance(a[-1], bytes) else str(a[-1])
            ),
        )
        self.two = self.description.fmiVersion == "2.0"
        self.reference = {v.name: v.valueReference for v in self.description.modelVariables}

    def start(self, time: float = 0.0) -> Exchange:
        if self.two:
            self.x.setupExperiment(startTime=time)
            self.x.enterInitializationMode()
        else:
            self.x.enterInitializationMode(startTime=time)
        self.x.exitInitializationMode()
        return self

    def new_discrete_states(self) -> tuple[bool, float]:
        if self.two:
            event = self.x.newDiscreteStates()
            return bool(event[4]), event[5]
        event = self.x.updateDiscreteStates()
        return bool(event[4]), event[5]

    def states(self, n: int, function: str = "GetContinuousStates") -> list[float]:
        values = (ctypes.c_double * n)()
        prefix = "fmi2" if self.two else "fmi3"
        getattr(self.x, prefix + function)(self.x.component, values, n)
        return list(values)

    def real(self, name: str) -> float:
        get = self.x.getReal if self.two else self.x.getFloat64
        return float(get([self.reference[name]])[0])


@pytest.fixture
def exchange(exported: Exported) -> Iterator[Callable[[str, Any], Exchange]]:
    live: list[Exchange] = []

    def make(name: str, fmi: Any) -> Exchange:
        live.append(Exchange(exported(name, fmi)[1]))
        return live[-1]

    yield make
    for x in live:
        x.x.freeInstance()


Make = Callable[[str, Any], Exchange]


@both
def test_derivatives_are_those_of_the_equation(exchange: Make, fmi: Any) -> None:
    x = exchange("lag", fmi).start()
    x.new_discrete_states()
    x.x.enterContinuousTimeMode()
    (x.x.setReal if x.two else x.x.setFloat64)([x.reference["u"]], [0.5])
    x.x.setContinuousStates((ctypes.c_double * 1)(0.25), 1)
    assert x.states(1) == [0.25]
    name = "GetDerivatives" if x.two else "GetContinuousStateDerivatives"
    assert x.states(1, name) == [(2.0 * 0.5 - 0.25) / 0.5]
    assert x.real("der(x)") == (2.0 * 0.5 - 0.25) / 0.5
    assert x.states(1, "GetNominalsOfContinuousStates") == [1.0]


@both
def test_samples_are_time_events(exchange: Make, fmi: Any) -> None:
    x = exchange("noisy", fmi).start(time=0.05)
    assert x.new_discrete_states() == (True, 0.1)  # the first is not before the start
    x.x.enterContinuousTimeMode()
    for t, taken in ((0.1 - 1e-6, 0), (0.1, 1), (0.35, 3)):  # two are due at the last
        x.x.setTime(t)
        x.x.enterEventMode()
        defined, following = x.new_discrete_states()
        get = x.x.getInteger if x.two else x.x.getInt32
        assert list(get([x.reference["count"]])) == [taken]
        assert defined
        assert following == pytest.approx(0.1 * (taken + 1), rel=1e-15)
        x.x.enterContinuousTimeMode()


@both
def test_calls_of_the_other_interface_are_refused(exchange: Make, fmi: Any) -> None:
    x = exchange("noisy", fmi).start()
    prefix = "fmi2" if x.two else "fmi3"
    with pytest.raises(FMICallException):
        x.x.enterEventMode()
    assert x.messages[-1] == (
        f"{prefix}EnterEventMode is not allowed in state Event Mode; expected Continuous-Time Mode"
    )
    x.new_discrete_states()
    x.x.enterContinuousTimeMode()
    with pytest.raises(FMICallException):
        x.x.setBoolean([x.reference["on"]], [False])
    assert "expected it to be set in Event Mode" in x.messages[-1]
    with pytest.raises(FMICallException):
        x.x.setContinuousStates((ctypes.c_double * 1)(0.0), 1)
    assert "1 values; expected 0, one for each continuous state" in x.messages[-1]


@both
def test_a_state_of_the_other_interface_is_refused(
    exchange: Make, instance: Callable[[str, Any], Any], fmi: Any
) -> None:
    stepping = instance("lag", fmi).start()
    data = stepping.serialize(stepping.save())
    x = exchange("lag", fmi)
    read = x.x.deSerializeFMUstate if x.two else x.x.deserializeFMUState
    put = x.x.setFMUstate if x.two else x.x.setFMUState
    with pytest.raises(FMICallException):
        put(read(data))
    assert "expected one of an instance for Model Exchange" in x.messages[-1]


@both
def test_partial_derivatives_of_the_states_derivatives(exchange: Make, fmi: Any) -> None:
    x = exchange("linear", fmi).start()
    x.new_discrete_states()
    if fmi == 2:
        known = [x.reference[f"x[{i}]"] for i in (1, 2, 3)]
        unknown = [x.reference[f"der(x[{i}])"] for i in (1, 2, 3)]
        column = x.x.getDirectionalDerivative(unknown, known, [0.0, 1.0, 0.0])
    else:
        column = (ctypes.c_double * 3)()
        x.x.fmi3GetDirectionalDerivative(
            x.x.component, (ctypes.c_uint32 * 1)(x.reference["der(x)"]), 1,
            (ctypes.c_uint32 * 1)(x.reference["x"]), 1, (ctypes.c_double * 3)(0, 1, 0), 3,
            column, 3,
        )  # fmt: skip
    assert list(column) == [2.0, -1.0, 0.0]


# ---- library components: both interfaces of one file ------------------------------------------

# Inputs, end [s], tolerance of the outputs. The ends lie between samples: one that is due at the
# end is visible in Event Mode, while Co-Simulation takes it with the step that begins there.
COMPARED: dict[str, tuple[dict[str, Any], float, float]] = {
    "thruster": ({"u": 0.6}, 1.503, 2e-4),
    "bluerov2_heavy": ({"tau": [20.0, 5.0, 10.0, 0.2, 0.3, 1.0]}, 4.003, 2e-4),
    "pressure": ({"eta": [0.0, 0.0, 2.5, 0.0, 0.0, 0.0]}, 1.003, 1e-12),
    "controller": ({"eta_d": [1.0, 0.5, 2.0, 0.0, 0.1, 0.5]}, 1.003, 1e-12),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Any], Path]:
    folder = tmp_path_factory.mktemp("fmus")
    return lambda name, fmi: build_fmu(declare(name), fmi=fmi, target=folder / f"{name}{fmi}.fmu")


def start_values(path: Path, given: dict[str, Any]) -> dict[str, Any]:
    if fmpy.read_model_description(str(path)).fmiVersion != "2.0":
        return given
    flat: dict[str, Any] = {}
    for name, value in given.items():
        many = isinstance(value, list)
        flat |= {f"{name}[{i}]": x for i, x in enumerate(value, 1)} if many else {name: value}
    return flat


@both
@pytest.mark.parametrize("name", COMPARED)
def test_cvode_agrees_with_co_simulation(
    files: Callable[[str, Any], Path], name: str, fmi: Any
) -> None:
    given, end, tolerance = COMPARED[name]
    path = files(name, fmi)
    results = {}
    for interface in ("CoSimulation", "ModelExchange"):
        results[interface] = fmpy.simulate_fmu(
            str(path), fmi_type=interface, stop_time=end, output_interval=end,
            start_values=start_values(path, given), relative_tolerance=1e-6,
        )  # fmt: skip
    stepped, exchanged = results["CoSimulation"], results["ModelExchange"]
    for column in stepped.dtype.names or ():
        scale = max(1.0, float(np.max(np.abs(stepped[column]))))
        assert exchanged[column][-1] == pytest.approx(stepped[column][-1], abs=tolerance * scale)


@both
def test_our_master_integrates_our_hull(files: Callable[[str, Any], Path], fmi: Any) -> None:
    given, _, _ = COMPARED["bluerov2_heavy"]
    archive = read_fmu(files("bluerov2_heavy", fmi))
    assert archive.interface == "CoSimulation"
    kind = Fmu2 if fmi == 2 else Fmu3
    reached = []
    for interface in ("CoSimulation", "ModelExchange"):
        chosen: Any = replace(archive, interface=interface)
        fmu: Any = kind(chosen, "hull")
        component = ModelExchange(fmu) if interface == "ModelExchange" else fmu
        try:
            component.set(component.description.variables["tau"], np.array(given["tau"]))
            component.enter_initialization_mode(0.0, None)
            component.exit_initialization_mode()
            for k in range(100):
                component.do_step(k * 0.02, 0.02)
            reached.append(component.get(component.description.variables["eta"]))
        finally:
            component.free()
    assert reached[1] == pytest.approx(reached[0], abs=1e-5)


def test_derivatives_of_a_hull_are_finite_differences(files: Callable[[str, Any], Path]) -> None:
    """Of the states' derivatives, with respect to states and inputs, forward and in reverse."""
    archive = read_fmu(files("bluerov2_heavy", 3))
    x = Exchange(archive.folder).start()
    try:
        x.new_discrete_states()
        x.x.enterContinuousTimeMode()
        c, ref = x.x, x.reference
        states = archive.description.variables
        sizes = {n: states[n].size for n in ("tau", "nu_b", "der(nu_b)")}
        n_x = sum(v.size for v in states.values() if v.name.startswith("der("))
        first = next(
            i for i, (n, _) in enumerate(elements(archive.description.variables)) if n == "nu_b"
        )
        at = np.array(x.states(n_x))
        at[first : first + 6] = [0.4, -0.2, 0.1, 0.05, -0.1, 0.2]
        seed = np.random.default_rng(1).standard_normal(12)

        def rate(e: float) -> np.ndarray:
            c.setFloat64([ref["tau"]], (np.arange(6.0) + e * seed[:6]).tolist())
            moved = at.copy()
            moved[first : first + 6] += e * seed[6:]
            c.setContinuousStates((ctypes.c_double * n_x)(*moved), n_x)
            return np.array(c.getFloat64([ref["der(nu_b)"]], nValues=sizes["der(nu_b)"]))

        difference = (rate(1e-5) - rate(-1e-5)) / 2e-5
        rate(0.0)
        unknown = (ctypes.c_uint32 * 1)(ref["der(nu_b)"])
        known = (ctypes.c_uint32 * 2)(ref["tau"], ref["nu_b"])
        forward, back = (ctypes.c_double * 6)(), (ctypes.c_double * 12)()
        c.fmi3GetDirectionalDerivative(
            c.component, unknown, 1, known, 2, (ctypes.c_double * 12)(*seed), 12, forward, 6
        )
        weights = np.arange(1.0, 7.0)
        c.fmi3GetAdjointDerivative(
            c.component, unknown, 1, known, 2, (ctypes.c_double * 6)(*weights), 6, back, 12
        )
        assert list(forward) == pytest.approx(difference, rel=1e-7, abs=1e-8)
        assert np.dot(back, seed) == pytest.approx(np.dot(forward, weights), rel=1e-12)
    finally:
        x.x.freeInstance()


def elements(variables: Any) -> Iterator[tuple[str, int]]:
    """Return the continuous states in FMI's order, element by element."""
    for v in variables.values():
        if v.name.startswith("der("):
            yield from ((v.name[4:-1], i) for i in range(v.size))
