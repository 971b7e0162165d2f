"""`uuvsim lint` reports every mistake with its line; schema and reader refuse the same keys."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from tests.conftest import Uuvsim
from uuvsim_cosim.bridge.access.access_file import read_access
from uuvsim_cosim.commands.editor.file_checks import mistakes_in, schema_of
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.training.config import read_config
from uuvsim_cosim.learn.training.curriculum import read_curriculum
from uuvsim_cosim.models.declaration.modeline import PRESETS, schemas
from uuvsim_cosim.models.declaration.parameter_files import schema_mistakes, vehicle_file
from uuvsim_cosim.orchestrator.scenarios.scenario import read_scenario
from uuvsim_cosim.scene.mapping.survey import read_settings
from uuvsim_cosim.studies.yaml_file import read_study

STUDY = """\
system: bluerov2_hold
set:
  guidance.count: 1
duration: 20 s
every: 0.05 s
seeds: 2
parameters:
  hull.v_c[1]:
    grid:
      from: 0.0
      to: 1.5
      count: 2
    unit: m/s
  thruster_*.voltage:
    normal:
      mean: 14
      std: 0.5
      min: 13
      max: 15
  thruster_*.T_n:
    uniform: [0.7, 1.5]
    relative: true
    together: true
sets:
  - set: published
    vehicle: bluerov2_heavy
    prefix: hull
correlation:
  - between: [hull.D_q_11, hull.D_q_22]
    value: 0.8
metrics:
  error:
    expression: "rms(norm(hull.eta[1:2]))"
    after: 5 s
    until: 10 s
output: results
name: hold
loops: iterate
"""
TRAINING = """\
task: source
algorithm: masac
seed: 1
envs: 8
steps: 1000
profile: default
task_options:
  n_obstacles: 1
settings:
  lr: 0.001
  shared: true
evaluate_every: 100
evaluation_episodes: 2
checkpoint_every: 100
"""
CURRICULUM = """\
name: mine
algorithm: masac
envs: 64
evaluate_every: 6400
evaluation_episodes: 100
settings: {shared: true}
options: {n_obstacles: 1}
stages:
  - task: source
    steps: 32000
    promotion:
      share: 0.9
      evaluations: 2
    settings: {batch: 256}
    evaluate_every: 1600
  - task: my_package.tasks:Dock
    steps: 64000
    options: {depth: 0.5}
    promotion:
      least: 120
"""
ACCESS = """\
users:
  ann:
    role: owner
    password: scrypt$16384$8$1$1m9XwUSqXqAfPnyAm8M4mg==$VSyUbLk+YPC2Om3uiyxUVGe/nB8/FGu1Ddqk1VSaS1w=
anyone: observer
listen: [127.0.0.1]
tls: none
"""
SCENARIO = """\
name: faults
description: The DVL loses samples.
events:
  - at: 20
    until: 60
    signal: dvl.t_sample
    fault: drop
    value: 0.5
  - at: 120
    set: guidance.speed
    value: 0.3 m/s
"""
MAPPING = """\
scene: tacoma
cell: 0.1
sensors:
  - kind: depth_camera
    preset: camera_class
    columns: 160
    rows: 120
    period: 0.2
  - component: multibeam
"""
VEHICLE = content("models", "vehicles", "bluerov2", "parameters.yaml").read_text(encoding="utf-8")
FILES: dict[str, tuple[str, Callable[[Path], object]]] = {
    "study": (STUDY, read_study),
    "training": (TRAINING, read_config),
    "curriculum": (CURRICULUM, read_curriculum),
    "access": (ACCESS, read_access),
    "scenario": (SCENARIO, read_scenario),
    "mapping": (MAPPING, read_settings),
    "vehicle": (VEHICLE, lambda path: vehicle_file(str(path))),
}
# Keys that name something of the user's: any name is right for the schema.
FREE = (
    r"(guidance\.count|hull\.v_c.*|thruster_.*|error|ann|n_obstacles|depth|[a-z0-9]+_(20\d\d|gz).*)"
)


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, str], Path]:
    def written(name: str, text: str) -> Path:
        file = tmp_path / f"{name}.yaml"
        file.write_text(text, encoding="utf-8")
        return file

    return written


def found_by_schema(name: str, text: str) -> list[tuple[int, str]]:
    rules = json.loads(schemas()[name].read_text(encoding="utf-8"))
    return list(schema_mistakes(YAML(typ="rt", pure=True).load(text), rules))


@pytest.mark.parametrize("name", FILES)
def test_a_right_file_is_right_for_schema_reader_and_lint(
    name: str, write: Callable[[str, str], Path]
) -> None:
    text, read = FILES[name]
    file = write(name, text)
    assert found_by_schema(name, text) == []
    read(file)
    assert schema_of(file.with_name("mine.yaml"), text, YAML(typ="safe").load(text)) == name
    assert mistakes_in(file) == []


@pytest.mark.parametrize("name", FILES)
def test_each_misspelt_key_is_reported_by_schema_reader_and_lint_at_its_line(
    name: str, write: Callable[[str, str], Path]
) -> None:
    text, read = FILES[name]
    lines = text.splitlines()
    for k, line in enumerate(lines[:40]):
        found = re.match(r"( *(?:- )?)([^\s:#]+):(?= |$)(.*)", line)
        if found is None or re.fullmatch(FREE, found[2]):
            continue
        key = found[2] + found[2][-1]
        wrong = [*lines[:k], f"{found[1]}{key}:{found[3]}", *lines[k + 1 :]]
        file = write(name, "\n".join(wrong) + "\n")
        by_schema = found_by_schema(name, file.read_text(encoding="utf-8"))
        assert any(n == k + 1 and key in message for n, message in by_schema), line
        with pytest.raises(InputInvalid, match=rf":{k + 1}:|{re.escape(key)}"):
            read(file)
        mistakes = mistakes_in(file)
        assert mistakes is not None
        (message,) = (m for _, n, m in mistakes if n == k + 1 and key in m)
        assert found[2] in message.partition("expected")[2], "the right key is named"


def test_the_kinds_of_presets_are_those_that_ship() -> None:
    files = [
        *content("models", "sensors").glob("*/*.yaml"),
        *content("models", "controllers").glob("*/*.yaml"),
        *content("models", "vehicles").glob("*/propeller.yaml"),
        *content("models", "thrusters").glob("*/thruster.yaml"),
    ]
    assert sorted({file.stem for file in files}) == sorted(PRESETS)


def test_all_mistakes_of_all_files_are_listed_and_the_status_is_2(
    uuvsim: Uuvsim, write: Callable[[str, str], Path], tmp_path: Path
) -> None:
    write("my_study", "sytem: bluerov2_hold\nduration: 3 stones\nmetrics: {a: rms(hull.et)}\n")
    write("access", "users:\n  ann: {role: ownr, password: secret}\n")
    write("compose", "services: {web: {image: a}}\nversion: 3\n")
    write("scenario_1", SCENARIO)
    status, out, err = uuvsim("lint", str(tmp_path))
    assert (status, err) == (2, "")
    for words in (
        r"my_study.yaml:1: sytem: unknown; expected one such as system",
        r"my_study.yaml:2: duration: '3 stones'; expected seconds",
        r"access.yaml:2: users.ann.role: role 'ownr'; expected one such as owner",
        r"access.yaml:2: users.ann.password: not a salted hash",
        r"3 files checked: \d mistakes",
        r"not checked, since no schema fits: \S*compose.yaml",
    ):
        assert re.search(words, out), (words, out)
    assert "secret" not in out
    status, out, _ = uuvsim("lint", str(tmp_path), "--json")
    answer = json.loads(out)
    assert status == answer["status"] == 2
    assert {"file", "line", "message"} == set(answer["problems"][0])
    assert answer["checked"] == 3


def test_right_files_are_counted_with_status_0(
    uuvsim: Uuvsim, write: Callable[[str, str], Path]
) -> None:
    file = write("scenario", SCENARIO)
    assert uuvsim("lint", str(file)) == (0, "1 file checked: no mistake\n", "")


def test_a_file_that_is_no_yaml_or_of_no_known_form_is_a_mistake_if_it_is_named(
    uuvsim: Uuvsim, write: Callable[[str, str], Path]
) -> None:
    broken, other = write("broken", "a: [1\n"), write("other", "web: 1\n")
    status, out, _ = uuvsim("lint", str(broken), str(other))
    assert status == 2
    assert re.search(r"broken.yaml:2: .*; expected YAML", out)
    assert "other.yaml:1: its form is not known; expected a first line such as" in out
    status, _, err = uuvsim("lint", "nowhere")
    assert status == 2
    assert "nowhere: no such file or folder" in err


def test_a_mistake_of_another_file_of_a_vehicle_is_reported_once_under_that_file(
    uuvsim: Uuvsim, tmp_path: Path
) -> None:
    folder = tmp_path / "box"
    folder.mkdir()
    for name in ("parameters", "thrusters", "published"):
        text = content("models", "vehicles", "bluerov2_heavy", f"{name}.yaml").read_text("utf-8")
        text = re.sub(r"(?m)^(id|vehicle): .*", r"\1: box", text)
        if name == "parameters":
            text = text.replace("unit: kg,", "unit: kgg,", 1)
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    for target in (folder, folder / "thrusters.yaml"):
        status, out, _ = uuvsim("lint", str(target))
        assert status == 2
        assert re.search(r"(?m)^\S*box/parameters.yaml:\d+: m: unknown unit 'kgg'", out)
        assert out.count("kgg'; expected") == out.count(".yaml:") == 1
        assert "checked: 1 mistake\n" in out


def test_a_file_that_is_too_deep_or_too_large_does_not_hide_the_others(
    uuvsim: Uuvsim, write: Callable[[str, str], Path], tmp_path: Path
) -> None:
    write("access", "users: {ann: {role: ownr}}\n")
    write("deep", "a: " + "[" * 3000 + "]" * 3000)
    write("large", "# settings\n" * 500_000)
    status, out, err = uuvsim("lint", str(tmp_path))
    assert (status, err) == (2, "")
    assert "access.yaml:1: users.ann.role: role 'ownr'" in out
    assert "deep.yaml:1: too deeply nested; expected" in out
    assert "large.yaml:1: 5.5 MB, too large for a file of settings; expected at most 5 MB" in out


def test_paths_without_a_yaml_file_are_refused_but_this_folder_may_have_none(
    uuvsim: Uuvsim, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "smc.py").write_text("", encoding="utf-8")
    status, _, err = uuvsim("lint", str(tmp_path))
    assert status == 2
    assert f"{tmp_path}: no YAML files; expected a folder with" in err
    status, _, err = uuvsim("lint", str(tmp_path / "smc.py"))
    assert status == 2
    assert "expected a YAML file (.yaml or .yml)" in err
    monkeypatch.chdir(tmp_path)
    assert uuvsim("lint") == (0, "this folder has no YAML files\n", "")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: 1\na: 2\n", '2: found duplicate key "a"; expected each name once'),
        ("a: *nope\n", "1: found undefined alias 'nope'; expected an anchor &nope before it"),
        ("a:\n\tb: 1\n", "; expected spaces, since YAML does not allow tabs for indentation"),
    ],
)
def test_a_mistake_in_yaml_itself_is_reported_with_its_correction(
    text: str, expected: str, uuvsim: Uuvsim, write: Callable[[str, str], Path]
) -> None:
    status, out, _ = uuvsim("lint", str(write("study", text)))
    assert status == 2
    assert f"{expected}\n1 file checked: 1 mistake\n" in out


@pytest.mark.parametrize(
    ("name", "text", "key"),
    [
        ("access", ACCESS.replace("password:", "pasword:", 1), "pasword"),
        ("study", STUDY.replace("duration:", "duraton:"), "duraton"),
        ("curriculum", CURRICULUM.replace("algorithm:", "algoritm:"), "algoritm"),
    ],
)
def test_a_key_that_is_misspelt_is_not_reported_as_missing_too(
    name: str, text: str, key: str, write: Callable[[str, str], Path]
) -> None:
    messages = [m.message for m in mistakes_in(write(name, text)) or []]
    assert any(f"{key}: unknown; expected one such as" in message for message in messages)
    assert not any(re.search("has no |required|missing", message) for message in messages)


def test_what_only_a_reader_knows_is_reported_too(write: Callable[[str, str], Path]) -> None:
    text = STUDY.replace("hull.v_c[1]", "hull.v_d[1]").replace("unit: m/s", "unit: kg")
    mistakes = mistakes_in(write("study", text))
    assert mistakes is not None
    assert [m.line for m in mistakes] == [8]
    imu = content("models", "sensors", "stim300", "imu.yaml").read_text(encoding="utf-8")
    mistakes = mistakes_in(write("imu", imu.replace("unit: rad/s", "unit: kg", 1)))
    assert mistakes is not None
    assert len(mistakes) == 1
    assert "kg" in mistakes[0].message
