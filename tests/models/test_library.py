"""The registry: what ships can be declared, and says what each of its variables is."""

from __future__ import annotations

import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.library import available, declare


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
