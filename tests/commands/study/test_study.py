from collections.abc import Callable
from pathlib import Path

import pytest

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd

STUDY = """\
system: bluerov2_hold
duration: 1 s
every: 0.1
seeds: 3
parameters:
  hull.m: {uniform: [13, 14]}
  hull.v_c[1]: {grid: [0, 0.4, 0.8]}
  hull.nu_0[2]: {grid: [0, 1.0e+200]}
metrics:
  error: rms(norm(hull.eta[1:2]))
  "a <b>": final(hull.eta[6])
"""
Uuvsim = Callable[..., tuple[int, str, str]]


@pytest.fixture
def uuvsim(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Uuvsim:
    """Run the command line in a folder with a study: give its status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.yaml").write_text(STUDY)

    def call(*arguments: str) -> tuple[int, str, str]:
        capsys.readouterr()
        status = status_of(list(arguments))
        said = capsys.readouterr()
        return status, said.out, said.err

    return call


def test_a_study_becomes_one_table_and_one_page(uuvsim: Uuvsim, tmp_path: Path) -> None:
    status, out, _ = uuvsim("study", "s.yaml", "--jobs", "1")
    folder = tmp_path / "studies" / "s"
    assert status == 0
    assert "18 runs by a fused kernel" in out
    assert "9 failed" in out
    assert (folder / "runs.parquet").is_file()
    page = (folder / "report.html").read_text()
    assert "9 runs failed" in page
    assert "a &lt;b&gt;" in page
    assert "<b>" not in page.replace("</b>", "")
    assert "http" not in page.replace("http://www.w3.org", "")
    assert page.count("<svg") >= 6
    status, out, _ = uuvsim("study", "s.yaml", "--no-report")
    assert status == 0
    assert "18 from before" in out


def test_a_broken_study_has_status_2_and_says_every_line(uuvsim: Uuvsim, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(STUDY.replace("hull.m:", "hull.mm:").replace("rms(", "rsm("))
    status, _, err = uuvsim("study", "s.yaml")
    assert status == 2
    assert "s.yaml:6: " in err
    assert "s.yaml:10: " in err
    assert not (tmp_path / "studies").exists()


def test_a_changed_study_has_status_2_unless_it_restarts(uuvsim: Uuvsim, tmp_path: Path) -> None:
    assert uuvsim("study", "s.yaml", "-o", "x", "--no-report")[0] == 0
    (tmp_path / "s.yaml").write_text(STUDY.replace("1 s", "2 s"))
    status, _, err = uuvsim("study", "s.yaml", "-o", "x")
    assert status == 2
    assert "--restart" in err
    assert uuvsim("study", "s.yaml", "-o", "x", "--restart", "--no-report")[0] == 0


def test_an_interrupted_study_has_status_130_and_says_what_is_kept(
    uuvsim: Uuvsim, monkeypatch: pytest.MonkeyPatch
) -> None:
    from uuvsim_cosim.studies.result import StudyFolder

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(StudyFolder, "keep", interrupted)
    status, _, err = uuvsim("study", "s.yaml")
    assert status == 130
    assert "0 of 18 runs are kept" in err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [(["nowhere.yaml"], "no such file"), (["s.yaml", "--jobs", "0"], "1 or more")],
)
def test_wrong_arguments_have_status_2(uuvsim: Uuvsim, arguments: list[str], says: str) -> None:
    status, _, err = uuvsim("study", *arguments)
    assert status == 2
    assert says in err


def test_force_runs_a_study_of_mixed_vehicles_and_warns_of_each(
    uuvsim: Uuvsim, tmp_path: Path
) -> None:
    mixed = load("bluerov2_hold").replace("hull", "model:rexrov")
    write_ssd(mixed, tmp_path / "mixed.ssd")
    (tmp_path / "s.yaml").write_text(
        "{system: mixed.ssd, duration: 0.1, metrics: {depth: 'final(hull.eta[3])'}}"
    )
    status, _, err = uuvsim("study", "s.yaml", "--no-report")
    assert (status, "made for bluerov2_heavy" in err, "--force" in err) == (2, True, True)
    status, out, _ = uuvsim("study", "s.yaml", "--no-report", "--force")
    assert status == 0
    assert "thruster_8: made for bluerov2_heavy, but hull is rexrov" in " ".join(out.split())
