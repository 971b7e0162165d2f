"""`uuvsim new --workspace`: a folder whose files an editor can use, and that runs."""

from __future__ import annotations

import json
import re
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import Uuvsim
from uuvsim_cosim.commands.editor.file_checks import mistakes_in
from uuvsim_cosim.commands.editor.snippets import snippets
from uuvsim_cosim.commands.editor.workspace import workspace_files
from uuvsim_cosim.models.declaration.modeline import schemas
from uuvsim_cosim.orchestrator.running.library import load


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("workspace")
    return workspace_files(folder, "bluerov2_hold", load("bluerov2_hold").slot("controller"))


def read(files: dict[str, str], name: str) -> Any:
    return json.loads(files[name])


def test_the_command_writes_each_file_once_and_refuses_a_folder_that_has_one(
    uuvsim: Uuvsim, tmp_path: Path
) -> None:
    folder = tmp_path / "mine"
    status, out, _ = uuvsim("new", "--workspace", str(folder), "--for", "bluerov2_hold")
    assert status == 0
    assert "launch.json" in out
    assert "uuvsim lint" in out
    launch = (folder / ".vscode" / "launch.json").read_text(encoding="utf-8")
    for file in folder.rglob("*.json"):
        json.loads(file.read_text(encoding="utf-8"))
    (folder / "my_controller.py").unlink()
    status, _, err = uuvsim("new", "--workspace", str(folder))
    assert status == 2
    assert ".vscode/launch.json" in err
    assert err.count(".vscode/schemas") == 1
    assert "my_controller.py" not in err.replace("test_my_controller.py", "")
    assert not (folder / "my_controller.py").exists(), "nothing is written then"
    assert (folder / ".vscode" / "launch.json").read_text(encoding="utf-8") == launch


def test_a_file_is_refused_by_the_name_of_the_option(uuvsim: Uuvsim, tmp_path: Path) -> None:
    (tmp_path / "afile").touch()
    status, _, err = uuvsim("new", "--workspace", str(tmp_path / "afile"))
    assert status == 2
    assert f"--workspace {tmp_path}/afile: is a file" in err
    assert "--out" not in err


def test_printed_commands_quote_paths_for_a_shell(
    uuvsim: Uuvsim, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    _, out, _ = uuvsim("new", "--workspace", "my $work")
    assert "code 'my $work'\n" in out
    assert "uuvsim lint 'my $work'\n" in out
    _, out, _ = uuvsim("new", "controller", "--out", "my $work 2")
    assert "--replace controller='my $work 2/my_controller.py':MyController" in out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("new", "COMPONENT is missing"),
        ("new --workspace a --as c", "--workspace with --as or --out"),
        ("new --workspace a --out b", "--workspace with --as or --out"),
        ("new nobody --workspace a", "nobody"),
    ],
)
def test_wrong_options_are_refused_before_anything_is_written(
    uuvsim: Uuvsim, arguments: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    status, _, err = uuvsim(*arguments.split())
    assert status == 2
    assert said in err
    assert list(tmp_path.iterdir()) == []


def test_the_launch_configuration_runs_the_component_of_the_folder(files: dict[str, str]) -> None:
    run, file = read(files, ".vscode/launch.json")["configurations"]
    assert run["module"] == "uuvsim_cosim"
    assert run["args"][:4] == ["run", "bluerov2_hold", "--replace",
                               "controller=my_controller.py:MyController"]  # fmt: skip
    assert file["program"] == "${file}"
    assert {run["type"], file["type"]} == {"debugpy"}


def test_the_arguments_of_the_launch_configuration_are_those_of_the_command(
    files: dict[str, str], uuvsim: Uuvsim, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_controller.py").write_text(files["my_controller.py"], encoding="utf-8")
    arguments = read(files, ".vscode/launch.json")["configurations"][0]["args"]
    at = arguments.index("--until") + 1
    status, _, err = uuvsim(*arguments[:at], "0.1", *arguments[at + 1 :])
    assert (status, err) == (0, "")


def test_the_test_of_the_component_passes(files: dict[str, str], tmp_path: Path) -> None:
    for name in ("my_controller.py", "test_my_controller.py"):
        (tmp_path / name).write_text(files[name], encoding="utf-8")
    task = next(
        t for t in read(files, ".vscode/tasks.json")["tasks"] if t["label"].endswith("test")
    )
    command = [sys.executable, *task["args"]]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Ran 1 test" in done.stderr


def test_the_problem_matcher_reads_what_lint_writes(files: dict[str, str]) -> None:
    lint = next(
        t for t in read(files, ".vscode/tasks.json")["tasks"] if t["label"].endswith("lint")
    )
    pattern = lint["problemMatcher"]["pattern"]
    found = re.match(pattern["regexp"], "a/my_study.yaml:12: seeds: 0; expected 1 or more")
    assert found is not None
    assert found[pattern["file"]] == "a/my_study.yaml"
    assert found[pattern["line"]] == "12"
    assert found[pattern["message"]].startswith("seeds: 0")


def test_the_settings_bind_each_schema_that_was_copied(files: dict[str, str]) -> None:
    bound = read(files, ".vscode/settings.json")["yaml.schemas"]
    for name, path in schemas().items():
        copy = f".vscode/schemas/{path.name}"
        assert files[copy] == path.read_text(encoding="utf-8")
        assert name == "reference" or bound[f"./{copy}"]


def test_no_file_but_the_settings_names_a_path_of_this_machine(files: dict[str, str]) -> None:
    for name, text in files.items():
        assert name == ".vscode/settings.json" or str(Path(sys.prefix)) not in text, name


@pytest.mark.parametrize("name", [n for n in snippets() if n != "uuvsim component"])
def test_a_snippet_begins_a_file_without_mistakes(name: str, tmp_path: Path) -> None:
    body = "\n".join(map(str, snippets()[name]["body"])) + "\n"  # type: ignore[call-overload]
    text = re.sub(r"\$\{\d+:([^}]*)\}", r"\1", body).replace("\\$", "$")
    assert text.startswith("# yaml-language-server: $schema=.vscode/schemas/")
    file = tmp_path / f"{name.split()[1]}.yaml"
    file.write_text(text, encoding="utf-8")
    mistakes = mistakes_in(file)
    assert mistakes is not None
    if name == "uuvsim access":  # the hash is the user's
        assert [m for _, _, m in mistakes if "password" not in m] == []
    else:
        assert mistakes == []


def test_the_snippet_of_a_component_is_a_component(tmp_path: Path) -> None:
    body = "\n".join(map(str, snippets()["uuvsim component"]["body"]))  # type: ignore[call-overload]
    file = tmp_path / "made.py"
    file.write_text(re.sub(r"\$\{\d+:([^}]*)\}", r"\1", body), encoding="utf-8")
    made = runpy.run_path(str(file))["MyComponent"]()
    assert made.step(0.0, 0.1, {"u": 1.0}) == {"y": 0.0}
    assert made.outputs == {"y": "1"}
