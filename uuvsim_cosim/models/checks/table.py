"""Tables of docs/trust.md, made from the rows that `uuvsim models check` prints.

To write them again: python -c "from uuvsim_cosim.models.checks.table import write; write()".
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from uuvsim_cosim.models.checks.checks import every_check
from uuvsim_cosim.models.checks.comparison import GROUPS, Checked

__all__ = ["BEGIN", "END", "tables", "write"]

BEGIN, END = "<!-- rows: uuvsim models check -->", "<!-- end of rows -->"
NOISE = 1e-12
FORMS = {
    "M is symmetric": "M symmetric",
    "M is positive definite": "M > 0",
    "inertia is of a body": "inertia",
    "water takes energy only": "energy",
    "level is neutral": "level",
    "upright is stable": "upright",
    "weight is near buoyancy": "W, B",
}


def tables(rows: Iterable[Checked]) -> str:
    """Return, as Markdown, a table of the comparisons, one of the closed forms, and the causes."""
    done = list(rows)
    forms = [c for c in done if c.what in FORMS]
    others = sorted((c for c in done if c.what not in FORMS), key=lambda c: c.group)
    kept, known = (sum(c.verdict == v for c in done) for v in ("holds", "known"))
    lines = [
        f"{len(done)} comparisons: {kept} hold; for {known}, the cause of the difference is known "
        + "and stated"
        + (f", {len(done) - kept - known} FAIL." if kept + known < len(done) else "."),
        "",
        "| source | vehicle | quantity | difference | tolerance | verdict |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {c.group} | {c.address or '-'} | {_plain(c.what)} | {_number(c.off)} "
        f"| {c.tolerance:g} | {c.verdict} |"
        for c in others
    ]
    heads, numbers = list(FORMS), {(c.address, c.what): c for c in forms}
    lines += [
        "",
        "Closed forms, evaluated with the numbers of each set; 0 if they hold exactly:",
        "",
        f"| vehicle | {' | '.join(FORMS.values())} |",
        "|---" * (len(heads) + 1) + "|",
    ]
    for address in dict.fromkeys(c.address for c in forms):
        cells = [numbers[address, head] for head in heads]
        texts = [
            _number(c.off) + ("" if c.verdict == "holds" else f" ({c.verdict})") for c in cells
        ]
        lines.append(f"| {address} | {' | '.join(texts)} |")
    limits = ", ".join(f"{FORMS[h]} {numbers[forms[0].address, h].tolerance:g}" for h in heads)
    lines += ["", f"Tolerances: {limits}.", "", "| known difference | cause |", "|---|---|"]
    lines += [
        f"| {c.address or c.group}: {_plain(c.what)} | {_plain(c.known)} |"
        for c in done
        if c.verdict == "known"
    ]
    lines += ["", "| source | description |", "|---|---|"]
    lines += [f"| {g} | {GROUPS[g]} |" for g in sorted({c.group for c in done} & set(GROUPS))]
    return "\n".join(lines)


def write(path: Path | None = None) -> None:
    """Run everything and put the tables between the marks of docs/trust.md."""
    path = path or Path("docs/trust.md")
    text = path.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    body = f"{before}{BEGIN}\n\n{tables(every_check())}\n\n{END}{after}"
    path.write_text(body, encoding="utf-8")


def _number(off: float) -> str:
    if 0 < off < NOISE:
        return f"< {NOISE:g}"
    return "0" if off == 0 else f"{off:.1e}".replace("e-0", "e-").replace("e+00", "")


def _plain(text: str) -> str:
    return text.replace("|", "\\|")
