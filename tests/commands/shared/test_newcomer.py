"""Wrong words and files, as a newcomer types them: status 2, one line, and what would be right."""

from pathlib import Path

import pytest

from tests.conftest import Uuvsim


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("map nowhere", "nowhere: no such folder; expected one that `uuvsim run` wrote"),
        (
            "run bluerov2_hold --input nofile.csv",
            "nofile.csv: cannot be read (No such file or directory); expected a CSV of inputs",
        ),
        ("access token --port 1", "expected the --port of `uuvsim serve` or of a page"),
        ("report r -o report.docx", "report.docx: ending '.docx' was read; expected .html or .svg"),
        ("report r -o report", "report: ending '' was read; expected .html or .svg"),
    ],
)
def test_a_wrong_word_or_file_is_refused_in_one_line(
    uuvsim: Uuvsim, arguments: str, said: str
) -> None:
    status, out, err = uuvsim(*arguments.split())
    assert (status, out) == (2, "")
    assert said in err
    assert err.startswith("uuvsim: ")
    assert err.count("\n") == 1
    assert not Path("report.docx").exists()
