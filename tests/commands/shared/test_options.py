"""A command that writes a folder refuses the name of a file that it cannot write."""

from __future__ import annotations

from pathlib import Path

import pytest

from uuvsim_cosim.cli import main
from uuvsim_cosim.commands.shared.options import expect_folder
from uuvsim_cosim.errors import InputInvalid


def refused(out: Path) -> bool:
    try:
        expect_folder(out)
    except InputInvalid:
        return True
    return False


@pytest.mark.parametrize("name", ["run", "run.v1", "a.b", "2026-11-24", "x.DOCX/run"])
def test_a_folder_may_have_any_name_but_that_of_a_file(name: str) -> None:
    assert not refused(Path(name))
    assert refused(Path(f"{name}.csv"))


def test_a_folder_that_exists_may_have_the_name_of_a_file(tmp_path: Path) -> None:
    assert refused(tmp_path / "run.csv")
    (tmp_path / "run.csv").mkdir()
    assert not refused(tmp_path / "run.csv")


def test_a_file_that_exists_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("mine")
    with pytest.raises(InputInvalid, match=r"notes: is a file; expected the name of a folder"):
        expect_folder(tmp_path / "notes")
    assert (tmp_path / "notes").read_text() == "mine"


def test_the_ending_and_what_is_expected_are_named() -> None:
    with pytest.raises(InputInvalid, match=r"--out a.CSV: .*'.CSV' was read; expected .html, or"):
        expect_folder(Path("a.CSV"), ".html")
    expect_folder(Path("a.HTML"), ".html")


@pytest.mark.parametrize(
    "command",
    [
        "run bluerov2_survey --until 1", "serve bluerov2_survey", "train source", "play target",
        "study study.yaml", "models new my_rov", "fmu build hull", "new controller",
        "models import hull.stl", "train-offline data.npz",
    ],
)  # fmt: skip
def test_each_command_that_writes_a_folder_refuses_the_name_of_a_file(
    command: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main([*command.split(), "-o", "out.docx"])
    assert ended.value.code == 2
    assert "--out out.docx: ending '.docx' was read" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
