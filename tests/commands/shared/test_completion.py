"""Completion: what bash writes for a word, through the script that `--show-completion` prints."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Completed = Callable[[str], list[str]]
RUN = f'{shlex.quote(sys.executable)} -m uuvsim_cosim "$@"'
ENVIRONMENT = {
    **os.environ,
    "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1",
    "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
}


def shell_words(line: str) -> list[str]:
    """Split as readline does with bash's default COMP_WORDBREAKS."""
    return re.findall(r"[=:@]+|[^\s=:@]+", line) + ([""] if line.endswith(" ") else [])


@pytest.fixture
def completed(tmp_path: Path) -> Completed:
    """Return what bash offers at the end of a command line; "(shell)": its own file names."""
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("bash is not installed")
    program = tmp_path / "bin" / "uuvsim"
    program.parent.mkdir()
    program.write_text(f"#!{bash}\nexec {RUN}\n")
    program.chmod(0o755)
    environment = {**ENVIRONMENT, "PATH": f"{program.parent}{os.pathsep}{os.environ['PATH']}"}
    script = subprocess.run(
        [str(program), "--show-completion", "bash"],
        env=environment, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    (tmp_path / "script").write_text(script)
    (tmp_path / "work").mkdir()

    def complete(line: str) -> list[str]:
        words = shell_words(line)
        ask = (
            f"source {shlex.quote(str(tmp_path / 'script'))}\n"
            f"COMP_WORDS=({shlex.join(words)}); COMP_CWORD={len(words) - 1}\n"
            "function=$(complete -p uuvsim | sed 's/.*-F \\([^ ]*\\).*/\\1/')\n"
            '"$function" uuvsim; printf "%s\\n" "${COMPREPLY[@]}"\n'
        )
        done = subprocess.run(
            [bash, "--norc", "-c", ask], cwd=tmp_path / "work", env=environment,
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert done.stderr == ""
        return done.stdout.split()

    return complete


def test_bash_completes_names_that_ship(completed: Completed) -> None:
    assert completed("uuvsim run bluerov2_") == [
        "bluerov2_ardusub", "bluerov2_hold", "bluerov2_px4", "bluerov2_survey", "bluerov2_task",
    ]  # fmt: skip
    assert completed("uuvsim run sloc") == ["slocum_yo"]
    assert completed("uuvsim models show rem") == ["remus100"]
    assert "thruster_t200" in completed("uuvsim fmu build thruster thr")
    assert completed("uuvsim train uuvsim/Stat") == ["uuvsim/StationKeeping-v0"]
    assert completed("uuvsim train transition_1 --algo ma") == ["masac", "mappo"]
    assert completed("uuvsim systems slot bluerov2_hold contr") == ["controller"]


def test_bash_completes_the_part_behind_a_break(completed: Completed) -> None:
    assert completed("uuvsim models show bluerov2_heavy@wu") == ["wu_2018"]
    assert "stim300" in completed("uuvsim models show imu@")
    assert completed("uuvsim run bluerov2_hold --loops=it") == ["iterate"]
    assert completed("uuvsim identify x.csv --system model:rem") == ["remus100"]
    assert completed("uuvsim run bluerov2_hold --qui") == ["--quiet"]


def test_bash_completes_a_replacement_step_by_step(completed: Completed, tmp_path: Path) -> None:
    (tmp_path / "work" / "mine.fmu").touch()
    offered = completed("uuvsim run bluerov2_hold --replace contr")
    assert offered == ["controller=model:", "controller=policy:"]  # two: no space behind "="
    assert completed("uuvsim run bluerov2_hold --replace controller=mi") == ["mine.fmu"]
    assert completed("uuvsim run bluerov2_hold --replace controller=model:slid") == ["sliding_mode"]


def test_bash_completes_files_with_the_right_ending(completed: Completed, tmp_path: Path) -> None:
    for name in ("mine.ssd", "mine.fmu", "mine.txt", ".mine.ssd", "a policy.npz", "policy.npz"):
        (tmp_path / "work" / name).touch()
    (tmp_path / "work" / "minerals").mkdir()
    assert completed("uuvsim run mi") == ["mine.fmu", "mine.ssd", "minerals/"]
    assert completed("uuvsim run miner") == []  # bash itself, without a space behind the folder
    assert completed("uuvsim view mi") == []  # files of any kind: bash itself
    assert completed("uuvsim play --policy p") == ["policy.npz"]


def test_a_wrong_system_completes_nothing_and_prints_nothing(completed: Completed) -> None:
    assert completed("uuvsim systems slot nowhere contr") == []
    assert completed("uuvsim run nosuchthing") == []


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_complete_whole_words(shell: str) -> None:
    def completed(line: str) -> str:
        variables = {
            "_UUVSIM_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_ARGS": line,
            "_TYPER_COMPLETE_FISH_ACTION": "get-args",
        }  # fmt: skip
        return subprocess.run(
            [sys.executable, "-m", "uuvsim_cosim"], capture_output=True, text=True, check=False,
            env={**ENVIRONMENT, **variables},
        ).stdout  # fmt: skip

    assert "bluerov2_heavy@wu_2018" in completed("uuvsim models show bluerov2_heavy@wu")
    assert "bluerov2_survey" in completed("uuvsim run blue")
