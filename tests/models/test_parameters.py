"""Parameter files: what is shipped is whole, and each mistake is named with its line."""

from pathlib import Path

import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.geometry import thruster_geometry
from uuvsim_cosim.models.library import LIBRARY, available, declare
from uuvsim_cosim.models.parameters import (
    parameter_set,
    split_address,
    vehicle_ids,
    vehicle_sets,
)

SHIPPED = content("models", "vehicles", "bluerov2_heavy", "parameters.yaml").read_text()


def with_line(tmp_path: Path, old: str, new: str) -> tuple[str, int]:
    """Write the shipped file with one text replaced; gives its path and the text's line."""
    assert old in SHIPPED
    path = tmp_path / "mine.yaml"
    path.write_text(SHIPPED.replace(old, new, 1))
    return str(path), SHIPPED[: SHIPPED.index(old)].count("\n") + 1


@pytest.mark.parametrize("id", vehicle_ids())
def test_each_set_of_each_vehicle_declares_a_hull(id: str) -> None:
    for name in vehicle_sets(id):
        assert declare(f"{id}@{name}").of_kind("output")


def test_without_a_set_the_default_one_is_taken() -> None:
    assert parameter_set("bluerov2_heavy").name == "von_benzon_2022"
    assert declare("bluerov2_heavy").name == "bluerov2_heavy"
    assert declare("bluerov2_heavy@wu_2018").name == "bluerov2_heavy_wu_2018"


def test_an_address_is_a_vehicle_and_a_set() -> None:
    assert split_address("bluerov2_heavy@wu_2018") == ("bluerov2_heavy", "wu_2018")
    assert split_address("bluerov2_heavy") == ("bluerov2_heavy", None)


def test_sets_are_not_mixed() -> None:
    wu, benzon = (parameter_set("bluerov2_heavy", s).quantities for s in vehicle_sets_sorted())
    assert "rho" not in wu
    assert "W" not in benzon
    assert "D_l_22" not in benzon


def vehicle_sets_sorted() -> list[str]:
    return sorted(vehicle_sets("bluerov2_heavy"), reverse=True)


def test_a_vehicle_is_added_by_a_file_alone(tmp_path: Path) -> None:
    path, _ = with_line(tmp_path, "id: bluerov2_heavy", "id: my_rov")
    assert declare(path).name == "my_rov"


def test_a_commensurable_unit_is_converted(tmp_path: Path) -> None:
    path, _ = with_line(tmp_path, "{value: 13.5, unit: kg,", "{value: 13500, unit: g,")
    assert declare(path).variables["m"].start == pytest.approx(13.5)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("      m: {value: 13.5, unit: kg,", "      m: {value: 13.5, unit: N,", "expected 'kg'"),
        ("value: 13.5,", "value: heavy,", "'heavy' is not of type 'number'; expected a number"),
        ("value: 13.5,", "", "'value' is a required property"),
        ("      M_A_11:", "      M_A_17:", "M_A_17: not a parameter of a hull"),
        ("      m: {value: 13.5", "      m: {value: -1", "expected at least"),
        ("body: FRD", "body: FLU", "expected FRD"),
        ("default: von_benzon_2022", "default: best", "expected one of von_benzon_2022, wu_2018"),
        ("      rho: {", "      W: {", "never both"),
        ("source: \"von Benzon et al. (2022), Table A1\"}", "source: \"\"}", "source"),
        ("      I_b_22:", "      I_b_11:", "duplicate key"),
        ("    parameters:\n", "    parameters: [\n", "expected YAML"),
    ],
)  # fmt: skip
def test_a_mistake_is_named_with_its_line(old: str, new: str, message: str, tmp_path: Path) -> None:
    path, line = with_line(tmp_path, old, new)
    with pytest.raises(ParameterInvalid) as caught:
        declare(path)
    text = str(caught.value)
    assert message in text
    if "never both" not in message and "YAML" not in message:
        assert f":{line}:" in text


def test_every_mistake_is_listed(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(SHIPPED.replace("unit: kg,", "unit: N,").replace("z_b:", "zb:"))
    with pytest.raises(ParameterInvalid) as caught:
        declare(str(path))
    assert str(caught.value).count(str(path)) >= 3


def test_an_unknown_model_is_refused_with_those_that_exist() -> None:
    with pytest.raises(InputInvalid, match=r"no model 'bluerov3'; expected one of .*thruster_t200"):
        declare("bluerov3")


def test_an_unknown_option_is_refused() -> None:
    with pytest.raises(InputInvalid, match="unexpected keyword argument 'colour'"):
        declare("battery", colour="red")


def test_the_library_lists_what_it_declares() -> None:
    assert {"bluerov2_heavy@wu_2018", "thruster_t200", "wrench"} <= set(available())
    assert "vehicle" in LIBRARY


def test_a_vehicle_without_thrusters_is_refused_by_name() -> None:
    with pytest.raises(ParameterInvalid, match="no thruster geometry of 'glider'"):
        thruster_geometry("glider")


def test_a_direction_that_is_not_of_length_one_is_refused_with_its_line(tmp_path: Path) -> None:
    text = content("models", "vehicles", "bluerov2_heavy", "thrusters.yaml").read_text()
    path = tmp_path / "thrusters.yaml"
    path.write_text(text.replace("[0, 0, -1]", "[0, 0, -2]", 1))
    line = text[: text.index("[0, 0, -1]")].count("\n") + 1
    with pytest.raises(ParameterInvalid, match=f":{line}: e = .*expected length 1"):
        thruster_geometry(str(path))
