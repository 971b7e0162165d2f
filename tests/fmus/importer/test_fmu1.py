"""An FMU of FMI 1.0 as a component: life cycle, values, aliases, messages and failures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.component import BindingKind, Component
from uuvsim_cosim.fmus.importer.fmu1 import Fmu1
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

CFmu = Callable[..., Path]
NAN, ERROR, ABORT, DISCARD, FATAL, HANG, PENDING = 1, 2, 3, 4, 5, 6, 8


@pytest.fixture
def fmu(c_fmu: CFmu) -> Iterator[Fmu1]:
    component = Fmu1(read_fmu(c_fmu(1)), "plant")
    yield component
    component.free()


def initialize(component: Component) -> None:
    component.enter_initialization_mode(0.0, 10.0)
    component.exit_initialization_mode()


def put(component: Component, **values: Any) -> None:
    for name, value in values.items():
        component.set(component.description.variables[name], value)


def read(component: Component, name: str) -> Any:
    return component.get(component.description.variables[name])


def test_stepping_follows_the_equation(fmu: Fmu1) -> None:
    put(fmu, T=2.0, k=3.0)
    initialize(fmu)
    y = 0.0
    for k in range(10):
        put(fmu, u=k * 0.5)
        fmu.do_step(k * 0.1, 0.1)
        y += 0.1 * (3.0 * k * 0.5 - y) / 2.0
        assert read(fmu, "y") == y
    assert (read(fmu, "steps"), read(fmu, "stop")) == (10, 10)
    fmu.terminate()


def test_it_gives_the_bits_that_fmpy_gives(c_fmu: CFmu) -> None:
    import fmpy

    path, h = c_fmu(1), 0.01
    names = ["u", "v[1]", "v[2]", "v[3]"]
    given = np.zeros(101, [("time", float), *((n, float) for n in names)])
    given["time"] = np.arange(101) * h
    for i, name in enumerate(names):
        given[name] = np.sin((i + 1) * given["time"])
    wanted = ["y", "begun", "w[1]", "w[2]", "w[3]", "steps"]
    start = {"T": 0.3, "k": -2.0}
    expected = fmpy.simulate_fmu(
        str(path), stop_time=1.0, output_interval=h, output=wanted, start_values=start, input=given
    )
    fmu = Fmu1(read_fmu(path), "plant")
    put(fmu, **start)
    fmu.enter_initialization_mode(0.0, 1.0)
    rows = []
    for k in range(101):
        put(fmu, u=given["u"][k], v=[given[n][k] for n in names[1:]])
        if k == 0:
            fmu.exit_initialization_mode()
        else:
            put(fmu, u=given["u"][k - 1], v=[given[n][k - 1] for n in names[1:]])
            t = expected["time"][k - 1]
            fmu.do_step(t, expected["time"][k] - t)
        rows.append((read(fmu, "y"), read(fmu, "begun"), *read(fmu, "w"), read(fmu, "steps")))
    fmu.free()
    for i, name in enumerate(wanted):
        np.testing.assert_array_equal([row[i] for row in rows], expected[name], strict=False)
    assert np.abs(expected["y"]).max() > 0.5


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("k", -0.1),
        ("fault", 3),
        ("mode", 2),
        ("on", False),
        ("label", "Tauchgerät"),
        ("v", np.array([1.0, 2.0, 3.0])),
    ],
)
def test_a_start_value_is_read_back_before_and_after_initialization(
    fmu: Fmu1, name: str, value: Any
) -> None:
    put(fmu, **{name: value})
    fmu.enter_initialization_mode(0.0, None)
    for _ in range(2):
        np.testing.assert_array_equal(read(fmu, name), value)
        assert type(read(fmu, name)) is type(value)
        if not fmu._initialized:
            fmu.exit_initialization_mode()


def test_a_start_value_that_is_not_set_is_that_of_the_description(fmu: Fmu1) -> None:
    fmu.enter_initialization_mode(0.0, None)
    assert [read(fmu, n) for n in ("k", "label", "on", "mode")] == [1.0, "first order", True, 1]
    np.testing.assert_array_equal(read(fmu, "v"), np.zeros(3))


def test_a_description_in_the_terms_of_fmi_3(c_fmu: CFmu) -> None:
    archive = read_fmu(c_fmu(1))
    v = archive.description.variables
    assert (archive.description.kind, archive.interface) == ("FMI 1.0", "CoSimulation")
    assert (v["u"].causality, v["u"].unit, v["u"].min, v["u"].max) == ("input", "cm", -10, 5)
    assert (v["k"].causality, v["k"].variability, v["k"].initial) == ("parameter", "fixed", "exact")
    assert v["minus_k"].causality == "calculatedParameter"
    assert (v["stop"].causality, v["same_y"].causality) == ("local", "local")
    assert v["w"].shape == (3,)
    assert (v["w"].dependencies, v["y"].dependencies, v["steps"].dependencies) == (("v",), (), None)
    assert v["mode"].items == (("slow", 1), ("fast", 2))
    assert [name for name in v if v[name].negated] == [
        "minus_y", "minus_u", "minus_k", "minus_steps", "off",
    ]  # fmt: skip


def test_an_input_that_is_set_in_initialization_mode_is_there_at_the_first_output(
    fmu: Fmu1,
) -> None:
    fmu.enter_initialization_mode(0.0, None)
    put(fmu, u=3.0)
    assert read(fmu, "u") == 3.0
    put(fmu, u=4.0)
    assert read(fmu, "begun") == 4.0  # fmiInitializeSlave was called now
    put(fmu, u=5.0)  # an input may still be set
    assert (read(fmu, "begun"), read(fmu, "u")) == (4.0, 5.0)
    fmu.exit_initialization_mode()
    fmu.do_step(0.0, 0.1)
    assert read(fmu, "y") == 0.1 * 5.0 / 0.5


def test_a_parameter_that_is_set_too_late_is_refused_with_the_words_of_the_fmu(fmu: Fmu1) -> None:
    fmu.enter_initialization_mode(0.0, None)
    read(fmu, "y")
    reason = "plant: fmiSetReal returned error: a parameter is refused after fmiInitializeSlave"
    with pytest.raises(FmuError, match=reason):
        put(fmu, k=2.0)


def test_a_negated_alias_has_the_opposite_sign(fmu: Fmu1) -> None:
    put(fmu, k=2.0)
    initialize(fmu)
    put(fmu, u=1.0, off=False)
    fmu.do_step(0.0, 0.1)
    assert read(fmu, "y") == read(fmu, "same_y") == -read(fmu, "minus_y") == 0.4
    assert (read(fmu, "steps"), read(fmu, "minus_steps"), read(fmu, "minus_k")) == (1, -1, -2.0)
    assert (read(fmu, "on"), read(fmu, "off")) == (True, False)
    put(fmu, off=True)
    assert (read(fmu, "on"), read(fmu, "off")) == (False, True)


def test_messages_are_formatted_in_c_and_kept(fmu: Fmu1) -> None:
    assert fmu.messages[0] == ("ok", "1 instance of application/x-fmu-sharedlibrary, 100 %")


def test_messages_are_those_of_the_instance_that_wrote_them(c_fmu: CFmu) -> None:
    archive = read_fmu(c_fmu(1))
    first, second = Fmu1(archive, "plant"), Fmu1(archive, "plant")
    for fmu in (first, second):
        put(fmu, fault=ERROR)
        initialize(fmu)
    with pytest.raises(ComponentFailed):
        first.do_step(0.0, 0.1)
    assert first.messages[-1] == ("error", "step 0 at 0.000 s: too hot, y is y")
    assert len(second.messages) == 1
    for fmu in (first, second):
        fmu.free()


def test_a_refusal_carries_the_words_of_the_fmu_with_the_name_of_the_variable(fmu: Fmu1) -> None:
    with pytest.raises(FmuError, match=r"plant: fmiSetReal returned error: T = -1 is not positive"):
        put(fmu, T=-1.0)


@pytest.mark.parametrize(
    ("fault", "time", "reason"),
    [
        (ERROR, 0.2, "fmiDoStep returned error: step 2 at 0.200 s: too hot, y is y"),
        (DISCARD, 0.25, r"fmiDoStep returned discard \(it reached t = 0.25 s\)"),
        (FATAL, 0.2, "fmiDoStep returned fatal"),
        (PENDING, 0.2, "fmiDoStep returned pending: it steps asynchronously, which is not supp"),
    ],
)
def test_a_failed_step_names_component_time_and_message(
    fmu: Fmu1, fault: int, time: float, reason: str
) -> None:
    put(fmu, fault=fault, fault_time=0.15)
    initialize(fmu)
    fmu.do_step(0.0, 0.1)
    fmu.do_step(0.1, 0.1)
    with pytest.raises(ComponentFailed, match=reason) as failed:
        fmu.do_step(0.2, 0.1)
    assert (failed.value.path, failed.value.time) == ("plant", time)


def test_reset_gives_the_state_after_instantiation(fmu: Fmu1) -> None:
    runs = []
    for _ in range(2):
        put(fmu, k=2.0)
        initialize(fmu)
        put(fmu, u=1.0)
        fmu.do_step(0.0, 0.1)
        runs.append((read(fmu, "y"), read(fmu, "steps")))
        fmu.reset()
    assert runs[0] == runs[1] == (0.4, 1)


def test_a_state_is_refused_because_fmi_1_has_none(fmu: Fmu1) -> None:
    initialize(fmu)
    with pytest.raises(FmuError, match="says that it cannot copy its state"):
        fmu.get_fmu_state()


def test_it_is_stepped_from_c(fmu: Fmu1) -> None:
    binding = fmu.binding()
    assert binding.kind is BindingKind.FMI1
    assert {"DoStep", "GetReal", "SetBoolean"} <= set(binding.functions)


def test_another_prefix_is_refused_with_both_names(c_fmu: CFmu) -> None:
    path = c_fmu(1, flags=["-DPREFIX=other"])
    with pytest.raises(FmuError) as refused:
        instantiate_fmu(path, "plant")
    assert "does not export first_order_fmiInstantiateSlave, which is needed" in str(refused.value)
    assert "its functions begin with other_fmi instead" in str(refused.value)
    assert "modelIdentifier 'first_order'" in str(refused.value)


def test_a_missing_function_is_named(c_fmu: CFmu) -> None:
    fmu = instantiate_fmu(c_fmu(1, flags=["-DWITHOUT_STEP"]), "plant")
    initialize(fmu)
    with pytest.raises(FmuError, match=r"does not export first_order_fmiDoStep, which is needed$"):
        fmu.do_step(0.0, 0.1)
    fmu.free()


def test_a_wrong_guid_is_refused_with_the_words_of_the_fmu(c_fmu: CFmu) -> None:
    path = c_fmu(1, edits=[('guid="{first-order}"', 'guid="{other}"')])
    with pytest.raises(FmuError, match=r"could not be instantiated: guid \{other\} is wrong"):
        instantiate_fmu(path, "plant")


STAND_ALONE = "<CoSimulation_StandAlone>"


@pytest.mark.parametrize(
    ("edits", "reason"),
    [
        (
            [
                (STAND_ALONE, "<CoSimulation_Tool>"),
                (
                    "</CoSimulation_StandAlone>",
                    '<Model entryPoint="file://plant.mdl" manualStart="false" '
                    'type="application/x-simulink"/></CoSimulation_Tool>',
                ),
            ],
            r"CoSimulation_Tool: the model 'file://plant.mdl' of type 'application/x-simulink' is "
            "run by the tool that exported the FMU, not by the FMU; expected CoSimulation_StandAl",
        ),
        ([('causality="output"', 'causality="result"')], "causality 'result'; expected one of inp"),
        ([('variability="parameter"', 'variability="fixed"')], "variability 'fixed'; expected one"),
        ([('alias="alias"', 'alias="copy"')], "alias 'copy'; expected one of noAlias, alias, neg"),
        ([("<Name>u</Name>", "<Name>x</Name>")], "DirectDependency of 'begun': no variable 'x'"),
        ([('declaredType="Mode"', 'declaredType="Gear"')], "variable 'mode': unknown type 'Gear'"),
        ([('name="k"', 'name="u"')], "variable 'u': declared twice; expected unique names"),
        ([('modelIdentifier="first_order"', "")], "the document: no attribute 'modelIdentifier'"),
        (
            [('alias="negatedAlias"><Boolean/>', 'alias="negatedAlias"><String/>')],
            "variable 'off': a negated alias of type String; expected a number or a Boolean",
        ),
    ],
)
def test_a_wrong_description_is_refused_with_the_place(
    c_fmu: CFmu, edits: list[tuple[str, str]], reason: str
) -> None:
    with pytest.raises(FmuError, match=reason):
        read_fmu(c_fmu(1, edits=edits))


def test_a_local_variable_that_is_declared_twice_is_reported_and_the_first_is_used(
    c_fmu: CFmu,
) -> None:
    path = c_fmu(1, edits=[('name="stop" valueReference="3" causality="none"', 'name="same_y" '
                            'valueReference="3"')])  # fmt: skip
    fmu = instantiate_fmu(path, "plant")
    text = "its description declares twice: same_y; the first declaration is used"
    assert ("note", text) in fmu.messages  # type: ignore[attr-defined]
    assert fmu.description.variables["same_y"].type == "Float64"
    fmu.free()


def test_an_input_of_variability_parameter_is_a_parameter_and_reported(c_fmu: CFmu) -> None:
    path = c_fmu(1, edits=[('valueReference="2" variability="parameter"><Real start="1"/>',
                            'valueReference="2" causality="input" variability="parameter">'
                            '<Real start="1"/>')])  # fmt: skip
    archive = read_fmu(path)
    assert archive.description.variables["k"].causality == "parameter"
    assert archive.remarks == ("its inputs of variability parameter are parameters here: k",)


def test_another_platform_is_refused_with_the_names(c_fmu: CFmu, tmp_path: Path) -> None:
    import zipfile

    from tests.conftest import write_archive

    with zipfile.ZipFile(c_fmu(1)) as archive:
        members = {"modelDescription.xml": archive.read("modelDescription.xml")}
    members["binaries/win32/first_order.dll"] = b"MZ"
    members["binaries/solaris/first_order.so"] = b"?"
    path = write_archive(tmp_path / "other.fmu", members)
    with pytest.raises(FmuError, match=r"no binary for this platform, \S+; there are: solaris, w"):
        instantiate_fmu(path, "plant")
