"""`uuvsim reproduce` and `uuvsim train --curriculum`: what they say, and what they refuse."""

from pathlib import Path

import pytest

from uuvsim_cosim.cli import status_of

SMALL = """\
settings: {hidden: 16, batch: 16, buffer: 1000, shared: true}
options: {horizon: 4}
envs: 8
evaluate_every: 80
evaluation_episodes: 2
stages:
  - {task: source, steps: 80, settings: {warm_up: 32}}
  - {task: transition_1, steps: 80, promotion: {share: 0.9}}
"""


def test_a_page_is_made_where_nothing_has_been_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["reproduce", "all", "--no-run", "-o", str(tmp_path)]) == 0
    assert "not yet run" in capsys.readouterr().out
    page = (tmp_path / "README.md").read_text()
    assert page.count("Nothing has been run with this budget") == 2
    assert page.count("| 11 |") == 14


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["reproduce", "fig10"], "expected one of fig"),
        (["reproduce", "fig7", "--budget", "big"], "expected batched or paper"),
        (["reproduce", "fig7", "--seeds", "0"], "expected 1 or more"),
        (["train", "--curriculum", "st"], "expected one such as stt"),
        (["train", "--curriculum", "stt", "--seed", "-1"], "--seed -1: expected 0"),
        (["train", "--curriculum", "none.yaml"], "no such file; expected a curriculum"),
        (["train", "target", "--curriculum", "stt", "--steps", "9"], "steps of each stage"),
        (
            ["train", "target", "--curriculum", "stt", "--seeds", "2"],
            "--seeds: applies to one training",
        ),
        (
            ["train", "uuvsim/StationKeeping-v0", "--curriculum", "stt"],
            "curriculum stt ends with target",
        ),
        (["reproduce", "fig7", "--no-run", "-o", __file__], "is a file; expected a folder"),
        (["train", "--curriculum", "stt", "--algo", "dqn"], "transfers nothing; expected masac"),
        (["train", "--curriculum", "stt", "--set", "shard=1"], "expected one such as shared"),
    ],
)
def test_mistakes_are_one_sentence(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert status_of(arguments) == 2
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


def test_a_curriculum_is_trained_through_from_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "small.yaml", tmp_path / "out"
    file.write_text(SMALL)
    for _ in range(2):  # the second time it is there
        assert status_of(
            ["train", "target-tracking", "--curriculum", str(file), "--seed", "2", "-o", str(out),
             "--no-report"]
        ) == 0  # fmt: skip
        said = capsys.readouterr().out
        assert "transition_1" in said
        assert "all steps" in said
    assert (out / "2-transition_1" / "policy.npz").is_file()
