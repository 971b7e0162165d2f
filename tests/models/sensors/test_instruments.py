"""Shipped instruments: each can be declared, and each figure says where it is from."""

from __future__ import annotations

import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import read_yaml

FILES = sorted(content("models", "sensors").glob("*/*.yaml"))


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.parent.name)
def test_every_instrument_declares_its_component_and_is_named_as_its_folder(file: object) -> None:
    data = read_yaml(file, "preset.schema.json")  # type: ignore[arg-type]
    assert data["id"] == file.parent.name  # type: ignore[attr-defined]
    assert declare(data["kind"], id=data["id"]).name == data["kind"]


def test_every_kind_of_instrument_has_one_with_a_figure_that_is_no_assumption() -> None:
    sourced = {
        file.stem
        for file in FILES
        for entry in read_yaml(file, "preset.schema.json")["parameters"].values()
        if not entry["source"].startswith(("assumption", "none", "set to"))
    }
    assert {file.stem for file in FILES} - sourced == {"color_camera", "leak"}
