"""The registry: what ships can be declared, and says what each of its variables is."""

from __future__ import annotations

import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.library import LIBRARY, available, declare, declare_source
from uuvsim_cosim.models.declaration.preset import presets_of


@pytest.mark.parametrize("name", available())
def test_every_connector_and_parameter_says_what_it_is(name: str) -> None:
    model = declare(name)
    assert model.description
    shown = model.of_kind("input", "parameter", "output")
    assert [v.name for v in shown if not v.description] == []


def test_an_unknown_name_lists_the_known() -> None:
    with pytest.raises(InputInvalid, match="thruster_t200"):
        declare("thruster_t201")


def test_an_unknown_option_is_named() -> None:
    with pytest.raises(InputInvalid, match="colour"):
        declare("thruster_t200", colour="red")


def test_an_option_may_have_the_name_of_an_argument_and_is_refused() -> None:
    with pytest.raises(InputInvalid, match="model 'imu': there is no option 'name'"):
        declare_source("imu?name=x")


def test_a_preset_is_addressed_as_a_vehicles_set_is() -> None:
    names = {v.name for v in declare("imu@stim300").of_kind("parameter")}
    assert "gyro_scale_sigma" in names
    with pytest.raises(InputInvalid, match="no imu 'stim30'; expected adis16448"):
        declare("imu@stim30")


def test_an_option_that_is_no_number_is_named_with_its_value() -> None:
    with pytest.raises(InputInvalid, match=r"'lbl' with beacons=many: .* expected a number"):
        declare("lbl", beacons="many")


@pytest.mark.parametrize("name", [n for n in LIBRARY if presets_of(n)])
def test_every_preset_that_is_listed_can_be_declared(name: str) -> None:
    for preset in presets_of(name):
        assert declare(f"{name}@{preset}").of_kind("output")


def test_an_option_that_a_preset_has_no_figure_for_names_presets_that_do() -> None:
    with pytest.raises(InputInvalid, match="'sigma_water'; expected one in m/s, as the preset a50"):
        declare("dvl", track="both")
