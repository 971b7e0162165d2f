"""Sets of a vehicle's thrusters: what they hold is declared, and what is wrong there is said."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.vehicles.check_vehicle_folder import read_folder

SETS = """
sets:
  mine:
    model: thruster_t200
    options: {scale: true, dead_band: true}
    source: "a test"
    parameters:
      T_n: {value: 50, unit: ms, interval: [40, 60], source: "a test"}
      k_T: {value: [0.9, 0.8, 1, 1, 1, 1], unit: "1", source: "a test"}
      voltage: {value: 14, unit: V, source: "a test"}
"""


@pytest.fixture
def rov(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a BlueROV2 of one's own, in the current folder, with a set of its thrusters."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(content("models", "vehicles", "bluerov2"), "rov")
    file = Path("rov/parameters.yaml")
    file.write_text(file.read_text().replace("id: bluerov2\n", "id: rov\n"))
    thrusters = Path("rov/thrusters.yaml")
    thrusters.write_text(thrusters.read_text() + SETS)
    return thrusters


def test_a_set_is_declared_in_the_models_units_and_by_the_thrusters_number(rov: Path) -> None:
    second = declare("thruster_t200", vehicle="rov@mine", number="2").variables
    assert [float(second[n].start[0]) for n in ("T_n", "k_T", "voltage")] == [0.05, 0.8, 14.0]
    assert "u_0" in second  # of the option that the set states
    assert float(declare("thruster_t200", vehicle="rov@mine").variables["k_T"].start[0]) == 0.9


def test_what_is_not_there_is_refused_with_what_is(rov: Path) -> None:
    with pytest.raises(ParameterInvalid, match=r"no set 'other' of its thrusters; expected mine"):
        declare("thruster_t200", vehicle="rov@other")
    with pytest.raises(ParameterInvalid, match=r"expected model:thruster_t200\?vehicle=rov@mine"):
        declare("thruster", vehicle="rov@mine")
    with pytest.raises(InputInvalid, match="thruster 7 of rov@mine; expected 1 to 6"):
        declare("thruster_t200", vehicle="rov@mine", number=7)
    with pytest.raises(ParameterInvalid, match=r"no set 'wu_2018' of its thrusters"):
        declare("thruster", vehicle="bluerov2")


def test_every_mistake_of_a_set_is_said_with_its_line(rov: Path) -> None:
    text = rov.read_text()
    wrong = (
        text.replace("      T_n: {value: 50, unit: ms", "      T_m: {value: 50, unit: ms")
        .replace("[0.9, 0.8, 1, 1, 1, 1]", "[0.9, 0.8]")
        .replace("value: 14, unit: V", "value: 14, unit: A")
    )
    rov.write_text(wrong)
    with pytest.raises(ParameterInvalid) as refused:
        read_folder("rov")
    for said in ("T_m: not a parameter of thruster_t200; expected one such as T_n",
                 "2 values; expected 1 or 6", "voltage: unit 'A'"):  # fmt: skip
        assert said in str(refused.value)
    rov.write_text(text.replace("model: thruster_t200\n    options", "model: pump\n    options"))
    with pytest.raises(ParameterInvalid, match=r"pump: expected .*thruster_t200"):
        read_folder("rov")
