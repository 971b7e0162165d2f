"""Tables of means with intervals: of a study, of the differences of two, and their LaTeX text."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

__all__ = ["IntervalRow", "latex_table"]

_SPECIAL = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}",
    **{c: f"\\{c}" for c in "&%$#_{}"},
}  # fmt: skip


@final
@dataclass(frozen=True)
class IntervalRow:
    """Mean of a metric at a grid point, with its 95 % bootstrap interval."""

    at: Mapping[str, float]  # grid axis: value
    metric: str
    unit: str  # "" without one
    n: int  # finite numbers that the mean is of
    mean: float
    low: float
    high: float


def latex_table(
    rows: Sequence[IntervalRow], names: Mapping[str, str], units: Mapping[str, str],
    *, mean: str = "mean", caption: str = "", label: str = "",
) -> str:  # fmt: skip
    """Return a table for LaTeX with the package booktabs; without a caption, the tabular alone.

    `names` maps metrics and grid axes to words, `units` grid axes to units. Texts are escaped.
    A mean and its interval have two significant digits of the interval's width.
    """
    axes = list(dict.fromkeys(axis for row in rows for axis in row.at))
    heads = [f"{_text(names.get(a, a))}{_in(units.get(a, ''))}" for a in axes]
    heads += ["metric", "unit", _text(mean), r"95\,\% interval", "$n$"]
    lines = [f"\\begin{{tabular}}{{{'r' * len(axes)}llrrr}}", r"\toprule"]
    lines += [_row(heads), r"\midrule"]
    for row in rows:
        middle, low, high = _rounded(row)
        between = f"[{low}, {high}]" if low else "--"
        name, unit = _text(names.get(row.metric, row.metric)), _unit(row.unit) or "--"
        at = [f"${_power(format(row.at[a], '.15g'))}$" if a in row.at else "" for a in axes]
        lines.append(_row([*at, name, unit, middle, between, str(row.n)]))
    lines += [r"\bottomrule", r"\end{tabular}"]
    if caption:
        tag = [f"\\label{{{label}}}"] if label else []
        head = [r"\begin{table}", r"\centering", f"\\caption{{{_text(caption)}}}", *tag]
        lines = [*head, *lines, r"\end{table}"]
    return "\n".join(lines) + "\n"


def _row(cells: Sequence[str]) -> str:
    start = "{}" if cells[0].startswith(("[", "*")) else ""  # else an option of the row before
    return start + " & ".join(cells) + r" \\"


def _text(text: str) -> str:
    """Escape a text; an empty line would begin a paragraph, which a caption cannot hold."""
    return "".join(_SPECIAL.get(c, c) for c in " ".join(text.split()))


def _in(unit: str) -> str:
    return f" [{_unit(unit)}]" if _unit(unit) else ""


def _unit(unit: str) -> str:
    """Return a unit such as N.s2/m2 with thin spaces and superscripts; "" for 1."""
    if unit in ("", "1"):
        return ""
    parts = re.split(r"([./])", unit)
    shown = [
        r"\," if p == "." else re.sub(r"(?<=\D)(-?\d+)$", r"\\textsuperscript{\1}", _text(p))
        for p in parts
    ]
    return "".join(shown)


def _rounded(row: IntervalRow) -> tuple[str, str, str]:
    """Return mean and limits in math mode; the limits are "" where there is no interval."""
    numbers = (row.mean, row.low, row.high)
    if not math.isfinite(row.mean):
        return "--", "", ""
    if not (math.isfinite(row.low) and math.isfinite(row.high)):
        return f"${_power(f'{row.mean:.3g}')}$", "", ""
    width = row.high - row.low
    if width <= 0:
        texts = [f"{x:.3g}" for x in numbers]
    else:
        decimals = 1 - math.floor(math.log10(width))
        large = max(abs(x) for x in numbers)
        if decimals > 5 or large >= 1e6:  # powers of ten, with the digits that the width supports
            digits = max(0, math.floor(math.log10(large)) + decimals)
            texts = [f"{x:.{digits}e}" for x in numbers]
        else:
            texts = [f"{round(x, decimals):.{max(decimals, 0)}f}" for x in numbers]
    mean, low, high = (f"${_power(text)}$" for text in texts)
    return mean, low, high


def _power(number: str) -> str:
    digits, e, exponent = number.partition("e")
    digits = digits.removeprefix("-") if float(number) == 0 else digits  # no -0.0
    return f"{digits} \\times 10^{{{int(exponent)}}}" if e else digits
