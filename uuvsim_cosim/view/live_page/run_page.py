"""The page on which a recorded run goes on from any instant, with other parameters.

It has the run's system, seed and scenario. At a communication point of the run, it has the bits of
the recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from uuvsim_cosim.cache import written
from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.scenarios.scenario import scenario_of_record
from uuvsim_cosim.view.live_page.live_page import live_page_html
from uuvsim_cosim.view.recorded.traces import provenance_of

__all__ = ["PAGE", "preventing", "write_run_page"]

PAGE = "page.html"  # beside the report


def preventing(folder: Path, provenance: Mapping[str, Any]) -> list[Problem]:
    """Return the components and settings of a run because of which no page can repeat it."""
    found = [
        Problem(
            str(c.get("path", "")),
            f"it is no declaration: {c.get('kind', '')}, {c.get('source', '')}",
            "a declaration (model:…); a page computes no others",
        )
        for c in provenance.get("components", ())
        if not str(c.get("source", "")).startswith("model:")
    ]
    if not (folder / "system.ssd").is_file():
        found.append(Problem(str(folder), "without system.ssd", "a folder that `uuvsim run` wrote"))
    if provenance.get("start"):
        found.append(Problem("--start", f"the run begins at {provenance['start']:g} s", "0 s"))
    if (folder / "inputs.csv").is_file():
        found.append(Problem("--input", "its inputs change with every step", "a --scenario"))
    if int(provenance.get("seed", 0)) >= 2**53:
        found.append(
            Problem("--seed", str(provenance["seed"]), "at most 2^53, as a page's numbers")
        )
    if "scenario" in (provenance.get("changes") or {}) and "scenario" not in provenance:
        found.append(Problem("--scenario", "run.json has no events", "a run of this version"))
    return found


def write_run_page(folder: str | Path, target: Path | None = None) -> Path:
    """Write the page of a run, by default page.html in its folder, and return its path.

    Raises SystemInvalid, which names what prevents it, and ToolchainError.
    """
    folder, provenance = Path(folder), provenance_of(folder)
    problems = preventing(folder, provenance)
    if problems:
        raise SystemInvalid(problems)
    record = provenance.get("scenario")
    page = live_page_html(
        load(folder / "system.ssd"),
        source=f"{folder.name}/system.ssd",
        seed=int(provenance.get("seed", 0)),
        scenario=None if record is None else scenario_of_record(record),
    )
    return written(target or folder / PAGE, page, make_folder=True)
