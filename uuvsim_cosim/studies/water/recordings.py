"""Recordings of real vehicles that models are compared with: what each is, and its signals.

A folder of `models/recordings` holds `recording.yaml`, the published nominal parameters if they are
not those of a shipped vehicle, and `recording.csv` if its licence permits to ship it. Other
recordings are read from a folder into which the user has cloned their repositories.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import read_yaml
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.identification.assumptions import MEASURED
from uuvsim_cosim.studies.identification.exclusions import Excluded
from uuvsim_cosim.studies.identification.identify import recorded_system
from uuvsim_cosim.studies.identification.logs import read_log

__all__ = ["Recording", "recording", "recordings"]

# Readers of recordings in the formats of their repositories: (module here, function).
READERS: Mapping[str, tuple[str, str]] = {
    "kolano": ("kolano", "read_kolano"),
    "ardusub": ("ardusub_dives", "read_dives"),
}
_GAP = 1.0  # s without a sample, which separates two runs


@dataclass(frozen=True)
class Recording:
    """A recording, the system that it is compared with, and the unknowns that are fitted to it."""

    name: str
    folder: Path
    title: str
    kind: str  # of vehicle: ROV, glider, AUV
    source: str
    licence: str
    repository: str  # owner/name on GitHub
    commit: str
    reader: str
    files: tuple[str, ...]  # in the repository
    system: str
    values: Mapping[str, Any]  # set in the system, of nominal and fitted model
    parameters: tuple[str, ...]
    measured: tuple[str, ...]  # that the fit uses; without cause in the recording, others are not
    signals: tuple[str, ...]  # of these, that predictions are judged by
    adapted: Mapping[str, float]  # parameters that drift, with the deviation of their changes
    step: float  # s
    past: float  # s before a prediction, from which its state is estimated
    surface: float  # m of depth, above which a glider floats at the surface
    fitted: tuple[float, float]  # s
    judged: tuple[float, float]  # s
    nominal: str  # where the nominal parameters were published
    remarks: tuple[str, ...]

    @property
    def is_shipped(self) -> bool:
        """Whether the data lie beside the description."""
        return any((self.folder / name).is_file() for name in ("recording.csv", "flight.csv"))

    @property
    def is_glide(self) -> bool:
        """Whether its system is the glide of a vehicle (studies/glider)."""
        return self.system.startswith("glide:")

    def is_at_hand(self, fetched: Path | None) -> bool:
        """Whether the data are shipped, or in `fetched`."""
        name = self.repository.rpartition("/")[2]
        return self.is_shipped or (fetched is not None and (fetched / name).is_dir())

    def read(self, fetched: Path | None = None) -> Signals:
        """Read the signals: of the shipped file, else from `fetched`, a folder of repositories."""
        if self.is_shipped:
            return self._prepared(read_log(self.folder / "recording.csv"))
        name = self.repository.rpartition("/")[2]
        if fetched is None:
            raise InputInvalid(
                f"{self.name}: its data are not shipped (licence: {self.licence})",
                f"--fetch DIR, a folder with a clone of https://github.com/{self.repository}",
            )
        root = fetched / name
        if not root.is_dir():
            raise InputInvalid(
                root, "no such folder", f"a clone of https://github.com/{self.repository}"
            )
        return self.read_original(root)

    def read_original(self, root: Path) -> Signals:
        """Read the signals from a clone of the recording's repository."""
        module, function = READERS[self.reader]
        read: Callable[[list[Path]], Signals] = getattr(
            import_module(f"uuvsim_cosim.studies.water.{module}"), function
        )
        found = []
        for pattern in self.files:
            matching = sorted(root.glob(pattern))
            if not matching:
                raise InputInvalid(
                    root, f"no file {pattern}", f"{self.repository} at {self.commit}"
                )
            found += matching
        return self._prepared(read(found))

    def _prepared(self, signals: Signals) -> Signals:
        """Leave out measurements that are not used, and the gaps between runs."""
        values = dict(signals.values_by_name)
        for name, elements in (("eta", MEASURED[:6]), ("nu", MEASURED[6:])):
            if name in values:
                used = [e in self.measured for e in elements]
                values[name] = np.where(used, values[name], np.nan)
        return _with_gaps(replace(signals, values_by_name=values))

    def nominal_system(self, signals: Signals) -> System:
        """Return the system with the published nominal parameters."""
        system = recorded_system(signals, self.system.replace("{here}", str(self.folder)))
        for path, value in self.values.items():
            system = system.set(path, value)
        return system


def recordings() -> list[Recording]:
    """List the recordings by name."""
    files = content("models", "recordings").glob("*/recording.yaml")
    return [_read(file) for file in sorted(files)]


def recording(name: str) -> Recording:
    """Find a recording by its name; raises InputInvalid with similar names."""
    every = {r.name: r for r in recordings()}
    if name not in every:
        raise InputInvalid(f"there is no recording {name!r}", expected_names(name, list(every)))
    return every[name]


def _read(file: Path) -> Recording:
    data: Mapping[str, Any] = read_yaml(file, "recording.schema.json")

    def text(key: str) -> str:
        return str(data[key])

    def texts(key: str) -> tuple[str, ...]:
        return tuple(map(str, data.get(key, ())))

    def span(key: str) -> tuple[float, float]:
        return float(data[key][0]), float(data[key][1])

    return Recording(
        name=file.parent.name,
        folder=file.parent,
        title=text("title"),
        kind=text("kind"),
        source=text("source"),
        licence=text("licence"),
        repository=text("repository"),
        commit=text("commit"),
        reader=text("reader"),
        files=texts("files"),
        system=text("system"),
        values=dict(data.get("set", {})),
        parameters=texts("parameters"),
        measured=texts("measured"),
        signals=texts("signals"),
        adapted={k: float(v) for k, v in data.get("adapted", {}).items()},
        step=float(data["step"]),
        past=float(data.get("past", 3.0)),
        surface=float(data.get("surface", 0.5)),
        fitted=span("fitted"),
        judged=span("judged"),
        nominal=text("nominal"),
        remarks=texts("remarks"),
    )


def _with_gaps(signals: Signals) -> Signals:
    """Exclude the gaps between runs, so that no window spans two."""
    t = signals.time
    gaps = [
        Excluded(float(a), float(b), "gap between two runs") for a, b in pairwise(t) if b - a > _GAP
    ]
    before = list(signals.metadata.get("excluded", ()))
    gaps = [g for g in gaps if not any(e.first <= g.first and g.last <= e.last for e in before)]
    both = sorted([*before, *gaps], key=lambda e: e.first)
    return replace(signals, metadata={**signals.metadata, "excluded": both})


def runs_joined(runs: list[tuple[np.ndarray, dict[str, np.ndarray]]], gap: float = 5.0) -> Signals:
    """Join runs of (times, signals) to one recording, with `gap` seconds between them."""
    times, start = [], 0.0
    for t, _ in runs:
        times.append(start + t - t[0])
        start = float(times[-1][-1]) + gap
    names = runs[0][1]
    time = np.concatenate(times)
    values = {n: np.concatenate([v[n] for _, v in runs]) for n in names}
    return Signals(time, np.arange(len(time)), values, {})
