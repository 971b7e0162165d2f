"""The JSON schemas and the code that reads the files know the same keys, values and defaults."""

from __future__ import annotations

import importlib.util
import inspect
import json
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, get_args

import pytest
from jsonschema import Draft202012Validator
from ruamel.yaml import YAML

from uuvsim_cosim.bridge.access import access_file
from uuvsim_cosim.bridge.access.roles import ROLES
from uuvsim_cosim.envs.randomisation import sets, yaml_text
from uuvsim_cosim.envs.tasks.tracking_reward import PROFILES
from uuvsim_cosim.learn.algorithms.registry import ALGORITHMS, TRANSFERS, default_settings
from uuvsim_cosim.learn.shared.task_ids import TASKS
from uuvsim_cosim.learn.training.config import TrainingConfig
from uuvsim_cosim.learn.training.curriculum import Curriculum, Promotion, Stage
from uuvsim_cosim.models.actuators.fins import _FIGURES
from uuvsim_cosim.models.declaration.hull_parameters import _SCALARS, meaning_of
from uuvsim_cosim.models.declaration.modeline import schema_in, schemas
from uuvsim_cosim.models.declaration.parameter_files import in_unit
from uuvsim_cosim.orchestrator.master.faults import Fault
from uuvsim_cosim.orchestrator.python.class_file import imported
from uuvsim_cosim.orchestrator.system.elements import Loops
from uuvsim_cosim.studies.yaml_file import KEYS

ROOT = Path(__file__).parents[3]
SCHEMA = {name: json.loads(file.read_text(encoding="utf-8")) for name, file in schemas().items()}
SHIPPED = [
    *sorted(p for top in ("models", "orchestrator") for p in (ROOT / top).rglob("*.yaml")),
    *sorted((ROOT / "docs" / "examples").glob("*.yaml")),
]


def properties(schema: str, *place: str) -> dict[str, Any]:
    """Return the properties at a place of a schema; a leading `#` begins in its definitions."""
    node = SCHEMA[schema]
    for key in place:
        node = node["$defs"][key[1:]] if key.startswith("#") else node["properties"][key]
    return dict(node["properties"])


def described(node: Any, place: str = "") -> Iterator[str]:
    """Yield the place of each key without a description, in itself or where it refers to."""
    if isinstance(node, Mapping):
        for group in ("properties", "patternProperties"):
            for key, entry in node.get(group, {}).items():
                if not entry.get("description") and "$ref" not in entry:
                    yield f"{place}/{key}"
                yield from described(entry, f"{place}/{key}")
        for name, entry in node.get("$defs", {}).items():
            yield from described(entry, f"#{name}")
        for key in ("items", "additionalProperties", "anyOf"):
            yield from described(node.get(key), place)
    elif isinstance(node, list):
        for entry in node:
            yield from described(entry, place)


@pytest.mark.parametrize("name", SCHEMA)
def test_a_schema_is_valid_and_describes_each_key(name: str) -> None:
    Draft202012Validator.check_schema(SCHEMA[name])
    assert SCHEMA[name]["title"]
    assert SCHEMA[name]["description"]
    assert list(described(SCHEMA[name])) == []


def test_the_generated_parts_are_those_of_the_code() -> None:
    spec = importlib.util.spec_from_file_location("schemas", ROOT / ".ci" / "schemas.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name, text in module.generated().items():
        file = ROOT / "models" / "schema" / name
        assert file.read_text(encoding="utf-8") == text, "run `python .ci/schemas.py`"


@pytest.mark.parametrize("file", SHIPPED, ids=lambda p: str(p.relative_to(ROOT)))
def test_a_shipped_file_begins_with_the_modeline_of_a_schema_that_it_keeps(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    first = text.splitlines()[0]
    name = schema_in(f"{first}\n")
    assert name is not None
    path = first.partition("$schema=")[2]
    assert (file.parent / path).resolve() == schemas()[name].resolve()
    data = json.loads(json.dumps(YAML(typ="safe").load(text)))
    assert list(Draft202012Validator(SCHEMA[name]).iter_errors(data)) == []


def test_a_study_has_the_keys_of_its_reader() -> None:
    assert set(properties("study")) == set(KEYS)
    assert properties("study")["loops"]["enum"] == list(get_args(Loops))
    for schema in ("study", "randomisation"):
        kinds = properties(schema, "#distribution")
        extra = {"grid"} if schema == "study" else set()
        assert set(kinds) == {*yaml_text.KINDS, *yaml_text.OPTIONS, *extra}
        for kind, (_, names, least) in yaml_text.KINDS.items():
            assert list(kinds[kind]["properties"]) == list(names)
            assert kinds[kind]["required"] == list(names[:least])


def test_a_ready_made_set_has_the_options_of_its_function() -> None:
    options = SCHEMA["study"]["$defs"]["set"]
    found = {"set"}
    for name, function in sets.SETS.items():
        made = sets.published_intervals if name == "published" else function
        found |= inspect.signature(made).parameters.keys() - {"system", "set", "distribution"}
    assert set(options["properties"]) == found | {"set"}
    assert options["properties"]["set"]["enum"] == list(sets.SETS)
    assert options["then"]["enum"] == list(sets.SETS)


@pytest.mark.parametrize(
    ("kind", "place"),
    [
        (TrainingConfig, ("training",)),
        (Curriculum, ("curriculum",)),
        (Stage, ("curriculum", "#stage")),
        (Promotion, ("curriculum", "#stage", "promotion")),
    ],
)
def test_a_configuration_has_the_fields_and_defaults_of_its_class(
    kind: type, place: tuple[str, ...]
) -> None:
    keys = properties(*place)
    assert set(keys) == {f.name for f in fields(kind)}
    for f in fields(kind):
        if f.default is not MISSING and isinstance(f.default, int | float | str):
            assert f"Default: {f.default}" in keys[f.name]["description"]


def test_names_of_tasks_algorithms_and_profiles_are_those_of_the_code() -> None:
    training = properties("training")
    assert SCHEMA["training"]["$defs"]["task"]["anyOf"][0]["enum"] == list(TASKS)
    assert training["algorithm"]["enum"] == [*ALGORITHMS, None]
    assert training["profile"]["enum"] == list(PROFILES)
    assert properties("curriculum")["algorithm"]["enum"] == list(TRANSFERS)


def test_settings_are_those_of_all_algorithms_with_their_defaults() -> None:
    keys = properties("training", "#settings")
    found: dict[str, set[float]] = {}
    for name in ALGORITHMS:
        for key, value in default_settings(name).items():
            if key != "central":  # fixed by the name of the algorithm
                found.setdefault(key, set()).add(value)
    assert set(keys) == set(found)
    for key, values in found.items():
        (default,) = values  # the same in all algorithms that have it
        words = keys[key]["description"].partition("Default: ")[2]
        if key == "updates":  # `learner_of` sets it
            assert words.startswith("envs / 16, at least 1")
        elif isinstance(default, bool):
            assert words.startswith(str(default).lower())
        else:
            assert float(words.split()[0].rstrip(".,")) == default


def test_options_of_tasks_are_those_of_the_shipped_tasks() -> None:
    found: set[str] = set()
    for source in TASKS.values():
        module, _, name = source.rpartition(":")
        parameters = inspect.signature(getattr(imported(module, "task"), name)).parameters
        named = (p.name for p in parameters.values() if p.kind is not p.VAR_KEYWORD)
        found |= set(named) - {"randomisation"}  # an object of Python
    assert set(properties("training", "#task_options")) == found


def test_an_access_file_has_the_keys_and_roles_of_its_reader() -> None:
    keys = properties("access")
    assert set(keys) == set(access_file._KEYS)
    assert set(keys["tls"]["properties"]) == set(access_file._TLS)
    assert SCHEMA["access"]["$defs"]["role"]["enum"] == list(ROLES)
    assert keys["anyone"]["enum"] == [*ROLES, "none"]
    user = keys["users"]["additionalProperties"]
    assert set(user["properties"]) == set(user["required"]) == {"role", "password"}


def test_a_scenario_has_the_faults_of_the_master() -> None:
    events = properties("scenario")["events"]["items"]["properties"]
    kinds = get_args(inspect.signature(Fault, eval_str=True).parameters["kind"].annotation)
    assert sorted(events["fault"]["enum"]) == sorted(kinds)


def test_a_fin_has_the_figures_of_the_component_in_commensurable_units() -> None:
    keys = properties("fins", "#figures")
    assert set(keys) == set(_FIGURES)
    assert set(properties("fins")["fins"]["items"]["properties"]) == {"name", "r", "a", *_FIGURES}
    for name, (unit, _, _) in _FIGURES.items():
        words = keys[name]["description"]
        assert f"Unit: {unit}" in words or (unit == "1" and ("No unit" in words or '"1"' in words))


def test_a_hull_has_the_parameters_of_the_model_with_their_units() -> None:
    hull = SCHEMA["vehicle"]["$defs"]["set"]["properties"]["parameters"]
    assert set(hull["properties"]) == set(_SCALARS)
    validator = Draft202012Validator(SCHEMA["vehicle"])
    quantity = {"value": 1.0, "unit": "kg", "source": "none"}
    for name in ("M_A_15", "D_q_66", "I_g_12", "Y_pq", "m", "M_A_17", "I_g_21", "Y_qp", "Dq_11"):
        file = {
            "id": "a",
            "frames": {"body": "FRD", "world": "NED"},
            "default": "s",
            "sets": {"s": {"citation": "nobody has read it", "parameters": {name: quantity}}},
        }
        assert validator.is_valid(file) == (meaning_of(name) is not None), name
    assert in_unit(1.0, "kg", "kg") == 1.0
    assert "Unit: kg," in hull["properties"]["m"]["description"]
