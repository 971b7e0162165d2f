"""Recordings in CSV as signals, and files of an autopilot's parameters."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.logs import read_log, read_parameter_file


def test_a_csv_may_have_units_arrays_or_the_columns_of_a_reference(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "time,nav.eta[1],nav.eta[2],psi\ns,m,km,deg\n0,1,2,90\n1,,3,180\n"
    )
    signals = read_log(tmp_path / "a.csv")
    assert signals["nav.eta"][0].tolist() == [1, 2000]
    assert np.isnan(signals["nav.eta"][1, 0])
    assert signals["psi"].tolist() == pytest.approx([pi / 2, pi])
    (tmp_path / "b.csv").write_text("# a note\nt_s,u_mps,r_rps,X_N\n0,0.5,0,7\n1,0.6,0,8\n")
    signals = read_log(tmp_path / "b.csv")
    assert signals["nu"][1, 0] == 0.6
    assert signals["tau"].tolist() == [[7, 0, 0, 0, 0, 0], [8, 0, 0, 0, 0, 0]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("a,b\n1,2\n", "expected one named time"),
        ("time,a,a\n0,1,2\n", "two columns 'a'"),
        ("time,a\n0,1\n1\n", r"bad.csv:3: 1 values; expected 2"),
        ("time,a\n0,1\n1,x\n", r"bad.csv:3: a = 'x'; expected a number"),
    ],
)
def test_a_csv_that_is_none_is_refused_with_its_line(
    text: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputInvalid, match=message):
        read_log(tmp_path / "bad.csv")


def test_parameters_are_read_from_the_files_of_three_programs(tmp_path: Path) -> None:
    for name, text in (
        ("a.parm", "FRAME_CONFIG 1\nMOT_1_DIRECTION -1 # turned\n"),
        ("b.param", "FRAME_CONFIG,1\nMOT_1_DIRECTION,-1\n"),
        (
            "c.params",
            "# by QGroundControl\n1\t1\tFRAME_CONFIG\t1\t2\n1\t1\tMOT_1_DIRECTION\t-1\t2\n",
        ),
    ):
        (tmp_path / name).write_text(text)
        found = read_parameter_file(tmp_path / name)
        assert found == {"FRAME_CONFIG": 1.0, "MOT_1_DIRECTION": -1.0}
    (tmp_path / "d.parm").write_text("FRAME_CONFIG 1\nMOT_1_DIRECTION turned\n")
    with pytest.raises(InputInvalid, match=r"d.parm:2.*expected a name and a number"):
        read_parameter_file(tmp_path / "d.parm")
