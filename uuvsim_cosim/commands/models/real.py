"""`uuvsim models check --real`: predictions of models compared with recordings of real vehicles."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.cache import written
from uuvsim_cosim.commands.shared.terminal import Shown, file_line, line, number, remark, table
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.studies.water.bootstrap import Measured
    from uuvsim_cosim.studies.water.judge import Judged, Row

__all__ = ["check_real"]

_STRETCH = 240  # points of a trace that are drawn, a second apart


def check_real(name: str | None, fetched: Path | None, page: Path | None) -> None:
    """Judge one recording, or all whose data are at hand; print tables, or write the page."""
    from uuvsim_cosim.studies.water.judge import judge
    from uuvsim_cosim.studies.water.page import page_with
    from uuvsim_cosim.studies.water.recordings import recording, recordings

    every = recordings()
    wanted = every if name is None else [recording(name)]
    if fetched is not None and not fetched.is_dir():
        raise InputInvalid(fetched, "no such folder", "a folder with clones of repositories")
    if page is not None and not page.is_file():
        raise InputInvalid(page, "no such file", "a page with marks for each recording")
    found = []
    for each in wanted:
        if name is None and not each.is_at_hand(fetched):
            remark(
                "note",
                f"{each.name} is left out: its data are not shipped; --fetch DIR takes a folder "
                f"with a clone of https://github.com/{each.repository}",
            )
            continue
        judged = judge(each, fetched, report=line)
        found.append(judged)
        _print(judged)
        if page is not None:
            picture = page.parent / "images" / f"water_{each.name}.svg"
            file_line(written(picture, _picture(judged), make_folder=True))
    if page is not None:
        text = page_with(page.read_text(encoding="utf-8"), found, every)
        file_line(written(page, text))


def _print(judged: Judged) -> None:
    from uuvsim_cosim.studies.water.judge import OTHERS
    from uuvsim_cosim.studies.water.page import SIGNALS, TITLES, shown

    def cells(row: Row) -> tuple[object, ...]:
        unit, factor = shown(row)
        errors = [number(factor * row.errors[n].value, ".3g") for n in TITLES]
        verdicts = [
            Shown(row.ratios[n].value, f"{row.verdict(n)} ({row.ratios[n].value:.2f})")
            for n in OTHERS
        ]
        return (
            f"{SIGNALS[row.signal]} [{unit}]", number(row.ahead, "g"),
            number(row.windows, "d"), *errors, *verdicts,
        )  # fmt: skip

    line(f"{judged.recording.name}: {judged.recording.title}")
    table(
        ("signal", "ahead [s]", "windows", *TITLES.values(),
         *(f"than {TITLES[n]}" for n in OTHERS)),
        [cells(row) for row in judged.rows],
        key=judged.recording.name,
    )  # fmt: skip


def _picture(judged: Judged) -> str:
    from uuvsim_cosim.studies.water.page import SIGNALS, TITLES, shown
    from uuvsim_cosim.view.plots.prediction_plot import Predicted, prediction_picture

    signals = []
    for trace in judged.traces:
        rows = [r for r in judged.rows if r.signal == trace.signal]
        unit, factor = shown(rows[0])
        n = _STRETCH
        gaps = np.flatnonzero(np.diff(trace.t) > 1.5) + 1
        broken = {
            k: np.insert(factor * v[:n], gaps[gaps < n], np.nan)
            for k, v in {"": trace.measured, **trace.predicted}.items()
        }
        signals.append(
            Predicted(
                SIGNALS[trace.signal], unit, np.array([r.ahead for r in rows]),
                {t: factor * _intervals(r.errors[k] for r in rows) for k, t in TITLES.items()},
                np.insert(trace.t[:n], gaps[gaps < n], np.nan), broken[""],
                {t: broken[k] for k, t in TITLES.items()}, trace.before,
            )
        )  # fmt: skip
    return prediction_picture(signals, judged.recording.title)


def _intervals(figures: Iterable[Measured]) -> NDArray[np.float64]:
    return np.array([[m.value, m.low, m.high] for m in figures])
