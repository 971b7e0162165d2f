"""The XML that describes a component, judged by FMPy and read back by our own reader."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, fromstring

import casadi as ca
import numpy as np
import pytest
from fmpy.model_description import read_model_description

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.fmus.codegen.dependencies import direct_kinds
from uuvsim_cosim.fmus.codegen.describe import describe
from uuvsim_cosim.fmus.codegen.equations import equations
from uuvsim_cosim.fmus.export.model_description import model_description, model_identifier
from uuvsim_cosim.fmus.importer.read_description import read_description
from uuvsim_cosim.models.declaration.model import Model

Declared = dict[str, Callable[[], Model]]
both = pytest.mark.parametrize("fmi", [2, 3])
names = pytest.mark.parametrize("name", ["lag", "linear", "noisy", "root"])


def xml(model: Model, fmi: Any) -> Element:
    return fromstring(model_description(equations(model), fmi=fmi, token="t").encode())


@both
@names
def test_fmpy_finds_nothing_wrong(declared: Declared, name: str, fmi: Any, tmp_path: Path) -> None:
    file = tmp_path / "modelDescription.xml"
    file.write_text(model_description(equations(declared[name]()), fmi=fmi, token="t"))
    read_model_description(
        str(file), validate=True, validate_variable_names=True, validate_model_structure=True
    )


@both
@names
def test_what_is_read_back_is_what_was_declared(
    exported: Callable[[str, Any], tuple[Path, Path]], declared: Declared, name: str, fmi: Any
) -> None:
    model = declared[name]()
    native = describe(model).variables
    found = dict(read_description(exported(name, fmi)[0]).variables)
    found.pop("time", None)
    for state in model.of_kind("state"):  # and its derivative, for Model Exchange
        rate = found.pop(f"der({state.name})")
        assert (rate.shape, rate.causality) == (state.shape, "local")
    assert list(found) == list(native)
    for v in native.values():
        w = found[v.name]
        assert (w.type, w.causality, w.variability, w.shape) == (
            v.type, v.causality, v.variability, v.shape,
        )  # fmt: skip
        assert (w.unit, w.min, w.max, w.description) == (v.unit, v.min, v.max, v.description)
        assert np.array_equal(w.start, v.start) if v.start is not None else w.start is None
        first = v.value_references[0]
        expected = (first,) if fmi == 3 else tuple(range(first, first + v.size))
        assert w.value_references == expected
        assert set(w.dependencies or ()) == set(v.dependencies or ())


def test_fmi2_counts_elements_from_one(declared: Declared) -> None:
    found = [e.get("name") for e in xml(declared["linear"](), 2).iter("ScalarVariable")]
    assert found[:4] == ["u[1]", "u[2]", "A[1,1]", "A[1,2]"]


def test_units_hold_their_base_exponents(declared: Declared) -> None:
    units = {u.get("name"): u[0].attrib for u in xml(declared["lag"](), 3).iter("Unit")}
    assert units["N"] == {"kg": "1", "m": "1", "s": "-2"}
    assert units["1"] == {}


def test_a_linear_output_says_what_its_factor_is() -> None:
    m = Model("kinds")
    u = m.input("u", 5, unit="1")
    fixed = m.parameter("fixed", 2.0, unit="1", tunable=False)
    tunable = m.parameter("tunable", 3.0, unit="1")
    m.output("y", ca.vertcat(4 * u[0], fixed * u[1], tunable * fixed * u[2], u[3] ** 2), unit="1")
    m.output("step", ca.floor(u[4]) + u[4], unit="1")
    kinds = [next(iter(k.values())) for k in direct_kinds(equations(m))]
    assert kinds == ["constant", "fixed", "tunable", "dependent", "dependent"]


@both
def test_outputs_without_feedthrough_depend_on_states_alone(declared: Declared, fmi: Any) -> None:
    structure = xml(declared["lag"](), fmi).find("ModelStructure")
    assert structure is not None
    outputs = structure.findall("Outputs/Unknown" if fmi == 2 else "Output")
    rates = structure.findall("Derivatives/Unknown" if fmi == 2 else "ContinuousStateDerivative")
    # u is 1, x is 5, as index and as value reference
    assert [o.get("dependencies") for o in outputs] == ["5", "1 5"]
    assert [o.get("dependencies") for o in rates] == ["1 5"]


@both
def test_each_state_has_its_derivative(declared: Declared, fmi: Any) -> None:
    root = xml(declared["linear"](), fmi)
    real = ".//Real" if fmi == 2 else ".//Float64"
    states = [e.get("derivative") for e in root.iterfind(real) if e.get("derivative")]
    scalars = [*root.iterfind("ModelVariables/*")]
    by_index = {str(i): e.get("name") for i, e in enumerate(scalars, 1)}
    by_reference = {str(e.get("valueReference")): e.get("name") for e in scalars}
    known = by_index if fmi == 2 else by_reference
    wanted = ["x[1]", "x[2]", "x[3]"] if fmi == 2 else ["x"]
    assert [known[s] for s in states] == wanted
    assert {"der(x[1])", "der(x)"} & set(by_reference.values())


@both
def test_initial_unknowns_follow_states_to_their_parameters(declared: Declared, fmi: Any) -> None:
    tag = "InitialUnknowns/Unknown" if fmi == 2 else "InitialUnknown"
    found = xml(declared["lag"](), fmi).findall(f"ModelStructure/{tag}")
    unknowns = sorted(found, key=lambda u: int(u.get("index") or u.get("valueReference") or 0))
    # u is 1, k 2, T 3, x_0 4, as index and as value reference; then x, y, z and der(x)
    assert [u.get("dependencies") for u in unknowns] == ["4", "4", "1 2 4", "1 2 3 4"]


def test_units_of_an_arrays_elements_are_kept() -> None:
    m = Model("mixed")
    m.input("eta", 2, unit=("m", "rad"))
    scalars = xml(m, 2).findall("ModelVariables/ScalarVariable/Real")
    assert [s.get("unit") for s in scalars] == ["m", "rad"]
    note = xml(m, 3).find("ModelVariables/Float64[@name='eta']/Annotations/Annotation")
    assert note is not None
    assert note.text == "m rad"


def test_a_name_that_fmi_cannot_have_is_refused() -> None:
    m = Model("wrong")
    m.input("two words", unit="1")
    with pytest.raises(ParameterInvalid, match=r"wrong: variable 'two words'"):
        xml(m, 3)


@pytest.mark.parametrize(
    ("name", "identifier"), [("hull@wu_2018", "hull_wu_2018"), ("3d", "_3d"), ("ok_1", "ok_1")]
)
def test_a_model_identifier_is_a_c_identifier(name: str, identifier: str) -> None:
    assert model_identifier(name) == identifier
