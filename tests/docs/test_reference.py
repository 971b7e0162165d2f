"""The generated reference has an entry for each public name, component, environment and command."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import pytest

import uuvsim_cosim.envs
from uuvsim_cosim import errors
from uuvsim_cosim.commands.shared.common_options import EXAMPLES

sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "extensions"))

import api
import commands
import components
from environments import SHIPPED, example, slug

assert uuvsim_cosim.envs


def test_every_public_name_has_one_entry() -> None:
    text = "\n".join(api.pages().values())
    for path in api.public_names():
        if path != "__version__":
            assert text.count(f":: uuvsim_cosim.{path}\n") == 1, path


@pytest.mark.parametrize("path", sorted(api.public_names()))
def test_a_public_name_and_its_members_have_a_docstring_of_their_own(path: str) -> None:
    value = api.public_names()[path]
    if not (inspect.isclass(value) or inspect.isroutine(value)):
        return
    assert inspect.getdoc(value), path
    for name, member in api.public_members(value).items():
        assert inspect.getdoc(member), f"{path}.{name}"


def test_every_error_that_can_be_raised_is_on_the_page_of_errors() -> None:
    page = api.pages()["errors.md"]
    for name in set(errors.__all__) - {"Problem"}:
        assert f"\n| `{name}` |" in page


def test_every_component_of_the_library_has_a_page() -> None:
    from uuvsim_cosim.models.declaration.library import available

    assert set(components.names()) == {name for name in available() if "@" not in name}


def test_a_page_of_a_component_has_equations_variables_sources_and_commands() -> None:
    import uuvsim_cosim as uuv

    page = components.page("thruster", uuv.declare("thruster"))
    assert "d(shaft)/dt = (n_max * if_else(1 < u, 1, if_else(u < -1, -1, u)) - shaft)" in page
    assert "| `n_max` | Float64 | parameter | tunable | rad/s | 369.97 |" in page
    assert "`imu@stim300`" in components.page("imu", uuv.declare("imu"))
    assert "uuvsim fmu build thruster" in page
    vehicle = components.page("remus100", uuv.declare("remus100"))
    assert "`remus100@prestero_2001`, the default" in vehicle


@pytest.mark.slow
def test_the_commands_of_a_components_page_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("thruster", "battery"):
        for command in components.build_commands(name).splitlines():
            words = command.split()
            subprocess.run([sys.executable, "-m", "uuvsim_cosim", *words[1:]], check=True)
        assert (tmp_path / f"{name}.csv").stat().st_size > 1000


def test_every_environment_that_is_registered_has_a_page_and_is_made_by_its_id_alone() -> None:
    registered = {id for id in gymnasium.registry if id.startswith("uuvsim/")}
    assert registered == set(SHIPPED)
    assert len({slug(id) for id in SHIPPED}) == len(SHIPPED)
    code = (
        "import gymnasium; env = gymnasium.make('uuvsim_cosim.envs:uuvsim/StationKeeping-v0');"
        "env.reset(seed=0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("id", SHIPPED)
def test_the_example_on_the_page_of_an_environment_runs(id: str) -> None:
    names: dict[str, Any] = {}
    exec(example(id), names)
    assert names["observation"].shape == names["env"].observation_space.shape
    assert names["many"].num_envs == 64


def test_every_command_has_a_page_with_its_options_and_examples() -> None:
    pages = commands.pages()
    for path in commands.commands():
        page = pages[f"{path.split()[0]}.md"]
        assert f" uuvsim {path}\n" in page
        assert "`--json`" in page
        assert EXAMPLES[path], path
        for line in EXAMPLES[path]:  # tests/commands/shared/test_answer.py parses them
            assert f"\nuuvsim {line}\n" in page


def test_docstrings_become_valid_restructured_text() -> None:
    lines = ["thrust = K_n |n| n, x_ and *args; `a_b`s", "", "    y = a*b", "", "- one", "- two",
             "", "Example:", "", ">>> x_ = *a, |b|", ">>> x_", "    1"]  # fmt: skip
    api.as_rst(None, "function", "f", None, None, lines)
    assert lines == [
        r"thrust = K_n \|n\| n, x\_ and \*args; ``a_b``\s", "", "::", "", "    y = a*b", "",
        "- one", "- two", "", "Example:", "", ">>> x_ = *a, |b|", ">>> x_", "    1",
    ]  # fmt: skip
