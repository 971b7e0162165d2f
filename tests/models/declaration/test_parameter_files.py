"""Parameter files: what is shipped is whole, and each mistake is named with its line."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.actuators.thruster_geometry import read_thrusters, thruster_geometry
from uuvsim_cosim.models.declaration.library import LIBRARY, available, declare
from uuvsim_cosim.models.declaration.parameter_files import (
    parameter_set,
    read_yaml,
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
        ("      z_b: {value: -0.01", "      z_b: {value: .nan", "z_b: nan; expected a finite"),
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


def test_what_a_schema_sees_and_what_it_does_not_are_listed_together(tmp_path: Path) -> None:
    """A missing source, a mass in newtons, a name that does not exist."""
    path = tmp_path / "mine.yaml"
    text = SHIPPED.replace("      m: {value: 13.5, unit: kg,", "      m: {value: 13.5, unit: N,", 1)
    text = text.replace("      M_A_11: {value: 6", "      M_A_17: {value: 6", 1)
    text = text.replace('source: "von Benzon et al. (2022), Table A1"}', "note: none}", 1)
    path.write_text(text)
    with pytest.raises(ParameterInvalid) as caught:
        declare(str(path))
    for word in ("'source' is a required property", "expected 'kg'", "M_A_17: not a parameter"):
        assert word in str(caught.value)


def test_a_mistake_of_ours_in_a_file_of_the_right_shape_is_not_hidden(tmp_path: Path) -> None:
    def broken(_: object) -> Iterator[tuple[int, str]]:
        raise KeyError("ours")
        yield

    (tmp_path / "schema.json").write_text('{"type": "object"}')
    (tmp_path / "file.yaml").write_text("a: 1\n")
    with pytest.raises(KeyError, match="ours"):
        read_yaml(tmp_path / "file.yaml", tmp_path / "schema.json", broken)
    (tmp_path / "file.yaml").write_text("[1]\n")
    with pytest.raises(ParameterInvalid, match=r"file\.yaml"):  # it could look no further
        read_yaml(tmp_path / "file.yaml", tmp_path / "schema.json", broken)


def test_an_unknown_model_is_refused_with_those_that_are_close() -> None:
    with pytest.raises(InputInvalid, match=r"no model 'bluerov3' \(did you mean bluerov2.*models`"):
        declare("bluerov3")


def test_an_unknown_option_is_refused() -> None:
    with pytest.raises(InputInvalid, match="no option 'colour'; expected none"):
        declare("battery", colour="red")


def test_an_unknown_option_lists_those_that_there_are() -> None:
    with pytest.raises(InputInvalid, match=r"'shat' \(did you mean shaft\?\); expected shaft, "):
        declare("thruster_t200", shat="second")
    with pytest.raises(InputInvalid, match=r"no presets, as 't200' \(did you mean thruster_t200"):
        declare("thruster@t200")


def test_the_library_lists_what_it_declares() -> None:
    assert {"bluerov2_heavy@wu_2018", "thruster_t200", "wrench"} <= set(available())
    assert "vehicle" in LIBRARY


def test_a_vehicle_without_thrusters_is_refused_by_name() -> None:
    with pytest.raises(ParameterInvalid, match="no thruster geometry of 'glider'"):
        thruster_geometry("glider")


def test_a_vehicles_folder_without_thrusters_names_the_file_that_is_missing(tmp_path: Path) -> None:
    (tmp_path / "parameters.yaml").write_text("vehicle: hull alone")
    with pytest.raises(
        ParameterInvalid, match=r"thrusters\.yaml: no such file, so the vehicle has"
    ):
        thruster_geometry(str(tmp_path))


def test_a_word_in_a_place_is_one_mistake(tmp_path: Path) -> None:
    text = content("models", "vehicles", "bluerov2_heavy", "thrusters.yaml").read_text()
    path = tmp_path / "thrusters.yaml"
    path.write_text(text.replace("r: {value: [0.156,", 'r: {value: ["a",', 1))
    with pytest.raises(ParameterInvalid, match="'a' is not of type 'number'") as caught:
        read_thrusters(path)
    assert str(caught.value).count("thrusters.yaml:") == 1


def test_a_direction_that_is_not_of_length_one_is_refused_with_its_line(tmp_path: Path) -> None:
    text = content("models", "vehicles", "bluerov2_heavy", "thrusters.yaml").read_text()
    path = tmp_path / "thrusters.yaml"
    path.write_text(text.replace("[0, 0, -1]", "[0, 0, -2]", 1))
    line = text[: text.index("[0, 0, -1]")].count("\n") + 1
    with pytest.raises(ParameterInvalid, match=f":{line}: front right, .*e = .*expected length 1"):
        thruster_geometry(str(path))


def test_a_centre_of_gravity_outside_the_hull_is_refused_with_its_line(tmp_path: Path) -> None:
    text = content("models", "vehicles", "rexrov", "parameters.yaml").read_text()
    path = tmp_path / "mine.yaml"
    place = "    parameters:\n"
    wrong = '      x_g: {value: 140, unit: cm, source: "typed for a test"}\n'
    path.write_text(text.replace(place, place + wrong, 1))
    line = text[: text.index(place)].count("\n") + 2
    with pytest.raises(ParameterInvalid) as caught:
        declare(str(path))
    assert f":{line}: x_g: 1.4 m, the centre of gravity outside the hull" in str(caught.value)
    assert "expected -1.3 to 1.3 m" in str(caught.value)


def test_every_thruster_that_cannot_be_placed_is_named_with_its_line(tmp_path: Path) -> None:
    """Too far away (mm read as m), no unit vector, an unknown unit, two in one place, NaN."""
    folder = content("models", "vehicles", "bluerov2_heavy")
    (tmp_path / "parameters.yaml").write_text((folder / "parameters.yaml").read_text())

    def thruster(name: str, r: str, e: str = "[1, 0, 0]", unit: str = "m") -> str:
        r, e = f"{{value: {r}, unit: {unit}}}", f'{{value: {e}, unit: "1"}}'
        return f"  - name: {name}\n    r: {r}\n    e: {e}\n"

    head = 'vehicle: mine\nsource: "typed for a test"\nthrusters:\n'
    far = thruster("far", "[156, 111, 85]")
    twins = thruster("port", "[0, 0.1, 0]") + thruster("port again", "[0, 0.1, 0]", "[-1, 0, 0]")
    long = thruster("long", "[0, 0, 0]", "[0, 2, 0]")
    for items, messages in (
        (far + twins + long, ["far: r = [156", "stands where port does", "expected length 1"]),
        (
            thruster("a", "[1, 0, 0]", unit="kg") + thruster("b", "[.nan, 0, 0]"),
            ["unit 'kg'", "expected three numbers"],
        ),
    ):
        path = tmp_path / "thrusters.yaml"
        path.write_text(head + items)
        with pytest.raises(ParameterInvalid) as caught:
            thruster_geometry(str(path))
        text = str(caught.value)
        assert [m for m in messages if m not in text] == []
        assert text.count("thrusters.yaml:") == len(messages)
