"""Files for hosted CI, conda, containers and editors agree with the project's own."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from uuvsim_cosim import __version__

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def read(name: str) -> Any:
    return YAML(typ="safe").load((ROOT / name).read_text(encoding="utf-8"))


def test_the_conda_recipe_has_the_version_and_the_requirements_of_the_project() -> None:
    recipe = read(".ci/packaging/recipe.yaml")
    assert recipe["context"]["version"] == __version__
    needed = [f"python {PROJECT['requires-python']}"]
    needed += [re.sub(r"(?=[<>=])", " ", name, count=1) for name in PROJECT["dependencies"]]
    assert recipe["requirements"]["run"] == needed
    assert recipe["build"]["python"]["entry_points"] == ["uuvsim = " + PROJECT["scripts"]["uuvsim"]]


def test_the_hosted_ci_calls_the_script_that_everybody_has() -> None:
    steps = read(".github/workflows/ci.yml")["jobs"]["ci"]["steps"]
    assert steps[-1] == {"run": ".ci/run"}


def test_hosted_documentation_is_built_as_here() -> None:
    settings = read(".readthedocs.yaml")["sphinx"]
    assert (ROOT / settings["configuration"]).is_file()
    assert settings["fail_on_warning"]


def test_hooks_before_a_commit_are_checks_of_the_ci() -> None:
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    for hook in read(".pre-commit-config.yaml")["repos"][0]["hooks"]:
        command = hook["entry"].removeprefix(".venv/bin/")
        assert f"\n{command}" in script, command


def test_forms_of_issues_ask_for_something() -> None:
    for form in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"):
        fields = read(str(form.relative_to(ROOT)))["body"]
        assert any(f.get("validations", {}).get("required") for f in fields), form.name


def test_the_version_of_the_citation_is_that_of_the_package() -> None:
    assert read("CITATION.cff")["version"] == __version__
