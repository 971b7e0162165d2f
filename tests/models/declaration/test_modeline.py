"""Written YAML files name the copy of their schema beside them, the same on every machine."""

from __future__ import annotations

from pathlib import Path

import pytest

from uuvsim_cosim.models.declaration.modeline import headed, keep_schemas, schema_in, schemas
from uuvsim_cosim.models.importing.new_vehicle import write_vehicle
from uuvsim_cosim.models.worlds.scene import load_scene, save_scene
from uuvsim_cosim.scene.mapping.settings_file import keep_settings, settings_of_system

LINE = "# yaml-language-server: $schema=.schema/{}.schema.json\n"


def assert_bound(file: Path, schema: str) -> None:
    """Check the first line of a file, and the copy of the schema that it names."""
    assert file.read_text(encoding="utf-8").startswith(LINE.format(schema))
    copy = file.parent / ".schema" / f"{schema}.schema.json"
    assert copy.read_bytes() == schemas()[schema].read_bytes()


@pytest.mark.parametrize("shape", ["box", "torpedo"])
def test_the_files_of_a_new_vehicle_are_bound_to_their_schemas(shape: str, tmp_path: Path) -> None:
    folder = write_vehicle("mine", tmp_path, shape)
    names = {"parameters": "vehicle", "thrusters": "thrusters"}
    if shape == "torpedo":
        names |= {"propeller": "preset", "fins": "fins"}
    assert {file.stem for file in folder.glob("*.yaml")} == set(names)
    for name, schema in names.items():
        assert_bound(folder / f"{name}.yaml", schema)
    assert len(list((folder / ".schema").iterdir())) == len(names)


def test_a_saved_scene_is_bound_to_its_schema(tmp_path: Path) -> None:
    save_scene(load_scene("canyon"), tmp_path)
    assert_bound(tmp_path / "scene.yaml", "scene")


def test_settings_that_are_copied_into_a_run_are_bound_anew(tmp_path: Path) -> None:
    source = settings_of_system("seabed_mapping")
    assert source is not None
    keep_settings(source, tmp_path)
    assert_bound(tmp_path / "mapping.yaml", "mapping")
    text = (tmp_path / "mapping.yaml").read_text(encoding="utf-8")
    assert text.count("yaml-language-server") == 1
    assert text.splitlines()[1:] == source.read_text(encoding="utf-8").splitlines()[1:]


def test_a_modeline_with_another_path_is_the_users(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    for line in ("../study.schema.json", ".schema/nobody.schema.json"):
        file.write_text(f"# yaml-language-server: $schema={line}\na: 1\n", encoding="utf-8")
        keep_schemas(file)
        assert not (tmp_path / ".schema").exists()
    assert schema_in(headed("study", file.read_text(encoding="utf-8"))) == "study"
    assert schema_in("a: 1\n") is None
