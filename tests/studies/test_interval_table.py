"""Tables of intervals, in LaTeX that a strict reader accepts."""

from __future__ import annotations

import re

import pytest

from uuvsim_cosim.studies.interval_table import IntervalRow, latex_table

HOSTILE = r"50 % of a_b & {c} # \d ~ ^ $ <1> |e|"


def row(mean: float, low: float, high: float, **other: object) -> IntervalRow:
    given = {"at": {}, "metric": "error", "unit": "m", "n": 8, **other}
    return IntervalRow(mean=mean, low=low, high=high, **given)  # type: ignore[arg-type]


def cells(table: str) -> list[list[str]]:
    """Read a table as LaTeX would: balanced braces and environments, and no stray character."""
    opened: list[str] = []
    rows: list[list[str]] = []
    for line in table.splitlines():
        for kind, name in re.findall(r"\\(begin|end)\{(\w+)\}", line):
            if kind == "begin":
                opened.append(name)
            else:
                assert opened.pop() == name
        bare = re.sub(r"\\[&%$#_{}]", "", line)  # escaped characters
        assert bare.count("{") == bare.count("}")
        assert bare.count("$") % 2 == 0
        text = "".join(bare.split("$")[::2])
        assert not re.search(r"[%#_^~<>|]", text), line
        commands = {"textbackslash", "textasciitilde", "textasciicircum", "textless", "textbar"}
        commands |= {"textgreater", "textsuperscript", "caption", "label", "begin", "end"}
        commands |= {"toprule", "midrule", "bottomrule", "centering", "times"}
        assert set(re.findall(r"\\([a-z]+)", line)) <= commands
        if line.endswith(r" \\"):
            rows.append([c.strip() for c in re.split(r"(?<!\\)&", line.removesuffix(r"\\"))])
    assert not opened
    columns = re.search(r"\\begin\{tabular\}\{(\w+)\}", table)
    assert columns is not None
    assert {len(r) for r in rows} == {len(columns[1])}
    return rows


def test_every_special_character_is_escaped() -> None:
    rows = [row(1, 0.5, 1.5, metric=HOSTILE, unit=HOSTILE, at={HOSTILE: 0.1})]
    found = cells(latex_table(rows, {}, {HOSTILE: "m/s"}, caption=HOSTILE, label="tab:x"))
    assert r"50 \% of a\_b \& \{c\} \# \textbackslash{}d" in found[1][1]
    assert len(found) == 2


def test_a_name_that_begins_with_a_bracket_is_no_option_of_the_row_before() -> None:
    table = latex_table([row(1, 0.5, 1.5, metric="[x]")], {}, {})
    assert "\n{}[x] & " in table


@pytest.mark.parametrize(
    ("numbers", "shown"),
    [
        ((0.0681, 0.0432, 0.0881), ("$0.068$", "[$0.043$, $0.088$]")),
        ((-1.234, -1.456, -1.012), ("$-1.23$", "[$-1.46$, $-1.01$]")),
        ((123456.7, 123000.0, 124000.0), ("$123500$", "[$123000$, $124000$]")),
        ((2.21e-9, 1.18e-9, 3.26e-9), (
            r"$2.2 \times 10^{-9}$", r"[$1.2 \times 10^{-9}$, $3.3 \times 10^{-9}$]")),
        ((-0.0004, -0.5, 0.5), ("$0.0$", "[$-0.5$, $0.5$]")),
        ((2.0, 2.0, 2.0), ("$2$", "[$2$, $2$]")),
        ((2.0, float("nan"), float("nan")), ("$2$", "--")),
        ((float("nan"),) * 3, ("--", "--")),
    ],
)  # fmt: skip
def test_numbers_have_two_digits_of_their_intervals_width(
    numbers: tuple[float, float, float], shown: tuple[str, str]
) -> None:
    found = cells(latex_table([row(*numbers)], {}, {}))
    assert found[1] == ["error", "m", *shown, "8"]


def test_units_have_superscripts_and_thin_spaces() -> None:
    rows = [row(1, 0.5, 1.5, unit=unit) for unit in ("N.s2/m2", "rad/s", "1", "")]
    found = cells(latex_table(rows, {}, {}))
    assert [r[1] for r in found[1:]] == [
        r"N\,s\textsuperscript{2}/m\textsuperscript{2}", "rad/s", "--", "--",
    ]  # fmt: skip


def test_words_replace_names_of_metrics_and_axes() -> None:
    rows = [row(1, 0.5, 1.5, at={"v": 0.1}), row(2, 1.5, 2.5, at={"v": 0.2})]
    found = cells(latex_table(rows, {"error": "position error", "v": "current"}, {"v": "m/s"}))
    assert found[0][0] == "current [m/s]"
    assert [r[:2] for r in found[1:]] == [["$0.1$", "position error"], ["$0.2$", "position error"]]
