"""The page on recordings of real vehicles: a table for each, and a summary, between its marks.

`uuvsim models check --real --page docs/water.md` writes them. The table of a recording whose data
are not at hand stays as it is.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from math import isfinite, pi

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.water.bootstrap import LEAST_BLOCKS, Measured
from uuvsim_cosim.studies.water.judge import OTHERS, Judged, Row
from uuvsim_cosim.studies.water.recordings import Recording

__all__ = ["SIGNALS", "TITLES", "block_of", "page_with", "shown", "table_of"]

_BEGIN, _END = "<!-- rows: uuvsim models check --real {} -->", "<!-- end of rows -->"
_SUMMARY = "<!-- summary: uuvsim models check --real -->"
TITLES = {
    "fitted": "fitted",
    "persistence": "persistence",
    "linear": "linear",
    "nominal": "published",
}
SIGNALS = {
    "N": "north", "E": "east", "D": "depth", "phi": "roll", "theta": "pitch", "psi": "yaw",
    "u": "surge u", "v": "sway v", "w": "heave w", "p": "roll rate p", "q": "pitch rate q",
    "r": "yaw rate r", "V": "speed through the water",
}  # fmt: skip
_DEGREES = {"rad": ("deg", 180 / pi), "rad/s": ("deg/s", 180 / pi)}


def shown(row: Row) -> tuple[str, float]:
    """Return the unit that a row's errors are shown in, and the factor from SI."""
    return _DEGREES.get(row.unit, (row.unit, 1.0))


def table_of(judged: Judged) -> str:
    """Return the table of a recording as Markdown, with the fitted parameters below it."""
    names = list(TITLES)
    head = ["signal", "ahead [s]", "windows", *(TITLES[n] for n in names)]
    head += [f"than {TITLES[n]}" for n in OTHERS]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for row in judged.rows:
        unit, factor = shown(row)
        cells = [f"{SIGNALS[row.signal]} [{unit}]", f"{row.ahead:g}", f"{row.windows}"]
        cells += [_figure(row.errors[n], factor) for n in names]
        cells += [f"{row.verdict(n)}: {_figure(row.ratios[n])}" for n in OTHERS]
        lines.append(f"| {' | '.join(cells)} |")
    few = [r for r in judged.rows if r.blocks < LEAST_BLOCKS]
    if few:
        lines += ["", f"Rows without intervals have fewer than {LEAST_BLOCKS} blocks of windows."]
    lines += ["", "| parameter | published | fitted, 95 % interval | unit |", "|---|---|---|---|"]
    lines += [
        f"| `{n.name}` | {n.published:.5g} | {n.value:.5g}"
        f"{f' ± {n.half_width:.2g}' if isfinite(n.half_width) else ''}"
        f"{' (at its bound)' if n.at_bound else ''} | {n.unit} |"
        for n in judged.unknowns
    ]
    return "\n".join(lines)


def block_of(page: str, name: str) -> str:
    """Return the text between a recording's marks; raises InputInvalid if the page has none."""
    begin = _BEGIN.format(name)
    _, found, rest = page.partition(begin)
    if not found:
        raise InputInvalid(f"the page has no line {begin}", "a line for each recording")
    return rest.partition(_END)[0].strip()


def page_with(page: str, judged: Iterable[Judged], every: Iterable[Recording]) -> str:
    """Return the page with these tables, and a summary of all that it has."""
    for each in judged:
        page = _replaced(page, _BEGIN.format(each.recording.name), table_of(each))
    return _replaced(page, _SUMMARY, _summary(page, {r.name: r for r in every}))


def _replaced(page: str, begin: str, text: str) -> str:
    before, found, rest = page.partition(begin)
    if not found:
        raise InputInvalid(f"the page has no line {begin}", f"that line, and {_END} after it")
    return f"{before}{begin}\n\n{text}\n\n{_END}{rest.partition(_END)[2]}"


def _summary(page: str, every: Mapping[str, Recording]) -> str:
    """Count the verdicts of all tables."""
    head = ["recording", "vehicle", "licence", "data"]
    head += [f"than {TITLES[n]}: better, undecided, worse" for n in OTHERS]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for name, recording in every.items():
        block = block_of(page, name)
        rows = [r.split("|")[1:-1] for r in block.splitlines() if re.match(r"\|.*\[", r)]
        rows = [r for r in rows if ":" in r[-1]]
        counts = []
        for i in range(len(OTHERS)):
            said = [r[len(r) - len(OTHERS) + i].partition(":")[0].strip() for r in rows]
            counts.append(", ".join(str(said.count(v)) for v in (
                "better", "cannot be decided", "worse")))  # fmt: skip
        data = "shipped" if recording.is_shipped else "fetched"
        cells = [f"[{name}](#{name.replace('_', '-')})", recording.kind, recording.licence, data]
        lines.append(f"| {' | '.join([*cells, *counts])} |")
    return "\n".join(lines)


def _figure(m: Measured, factor: float = 1.0) -> str:
    value = f"{_number(factor * m.value)}"
    if not isfinite(m.low):
        return value
    return f"{value} ({_number(factor * m.low)} to {_number(factor * m.high)})"


def _number(value: float) -> str:
    return f"{value:.3g}" if value < 1000 else "> 1000"
