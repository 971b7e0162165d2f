"""Files for hosted CI, conda, containers and editors agree with the project's own."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from uuvsim_cosim import __version__

ROOT = Path(__file__).parents[2]
OF_A_RELEASE = [
    ".ci/packaging/recipe.yaml",
    ".ci/release",
    "CHANGELOG.md",
    "CITATION.cff",
    "uuvsim_cosim/_version.py",
]
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


def git(folder: Path, *arguments: str) -> str:
    who = ["-c", "user.name=tester", "-c", "user.email=tester@localhost"]
    command = ["git", *who, *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """Return a clean git repository with the files of a release, as they are in this checkout."""
    for name in OF_A_RELEASE:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, tmp_path / name)
    git(tmp_path, "init", "--quiet")
    commit(tmp_path)
    return tmp_path


def commit(folder: Path) -> None:
    git(folder, "add", ".")
    git(folder, "commit", "--quiet", "--no-gpg-sign", "--message", "Files of a release")


def replace(folder: Path, file: str, old: str, new: str) -> None:
    text = (folder / file).read_text(encoding="utf-8")
    assert old in text
    (folder / file).write_text(text.replace(old, new), encoding="utf-8")


def release(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(folder / ".ci" / "release"), *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_the_version_has_dated_notes_and_the_citation_agrees() -> None:
    log = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    citation = read("CITATION.cff")
    assert citation["version"] == __version__
    assert f"\n## {__version__} ({citation['date-released'].isoformat()})\n" in log
    assert log.index("\n## Unreleased\n") < log.index(f"\n## {__version__} ")


def test_this_version_can_be_released_from_a_clean_clone(clone: Path) -> None:
    # Items that wait in "Unreleased" are for the next version.
    log = (clone / "CHANGELOG.md").read_text(encoding="utf-8")
    waiting = log[log.index("## Unreleased") : log.index(f"## {__version__} ")]
    replace(clone, "CHANGELOG.md", waiting, "## Unreleased\n\n### Added\n\nNothing yet.\n\n")
    if git(clone, "status", "--porcelain"):
        commit(clone)
    checked = release(clone, "--check")
    assert (checked.returncode, checked.stderr) == (0, "")
    assert f"v{__version__} can be released" in checked.stdout
    assert not git(clone, "tag")


def test_the_notes_are_the_section_of_the_version(clone: Path) -> None:
    heading = f"## {__version__} ({read('CITATION.cff')['date-released'].isoformat()})\n"
    new = f"{heading}\n### A\n\n- One.\n\n## 0.0.9 (2026-01-01)\n"
    replace(clone, "CHANGELOG.md", heading, new)
    replace(clone, "CHANGELOG.md", "## Unreleased\n", "## Unreleased\n\nNothing yet.\n\n## x\n")
    assert release(clone, "--notes", f"v{__version__}").stdout == "### A\n\n- One.\n"
    other = release(clone, "--notes", "v9.9.9")
    assert other.returncode == 2
    assert f"The tag is v9.9.9; expected v{__version__}" in other.stderr


@pytest.mark.parametrize(
    ("file", "old", "new", "reason"),
    [
        ("CHANGELOG.md", f"## {__version__} ", "## 0.0.9 ", f"there is no section {__version__}"),
        ("CHANGELOG.md", f"## {__version__} (", f"## {__version__} (un", 'the date of .* is "un'),
        ("CHANGELOG.md", "## Unreleased\n", "## Unreleased\n- More.\n", '"Unreleased" has items'),
        ("CITATION.cff", f"\nversion: {__version__}", "\nversion: 0.0.9", "the version is 0.0.9"),
        ("CITATION.cff", "date-released: 2", "date-released: 1", "date-released is 1"),
        (".ci/packaging/recipe.yaml", f'"{__version__}"', '"0.0.9"', f"expected {__version__}, as"),
        ("uuvsim_cosim/_version.py", __version__, "0.2", "expected three numbers"),
    ],
)
def test_a_release_of_files_that_disagree_is_refused(
    clone: Path, file: str, old: str, new: str, reason: str
) -> None:
    replace(clone, file, old, new)
    commit(clone)
    refused = release(clone)
    assert refused.returncode == 2
    assert re.search(f"^{re.escape(file)}: .*{reason}", refused.stderr, re.M), refused.stderr
    assert not git(clone, "tag")


def test_a_tag_that_exists_and_a_changed_tree_are_refused(clone: Path) -> None:
    git(clone, "tag", f"v{__version__}")
    replace(clone, "CITATION.cff", "type: software", "type: dataset")
    refused = release(clone, "--check")
    assert refused.returncode == 2
    assert f"The tag v{__version__} exists; expected a version without a tag." in refused.stderr
    assert "There are changes in CITATION.cff; expected that all are committed." in refused.stderr


def test_the_hosted_release_runs_the_checks_of_the_hosted_ci_first() -> None:
    ci = read(".github/workflows/ci.yml")["jobs"]["ci"]["steps"]
    steps = read(".github/workflows/release.yml")["jobs"]["release"]["steps"]
    assert [step for step in steps if step in ci] == ci
    assert {s["uses"] for s in steps if "uses" in s} == {s["uses"] for s in ci if "uses" in s}
    assert steps.index(ci[-1]) < len(steps) - 1
    assert steps[-1]["run"].startswith("gh release create")
