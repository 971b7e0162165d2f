"""Saving of fitted parameters as a named set of the vehicle, with intervals for randomisation.

Parameters of thrusters become a set of the same name in thrusters.yaml (save_thrusters.py). The
set of the hull is the declared one with the fitted values instead of its own. Each value states
its source and its 95 % interval. Both ends of the interval are added to `published.yaml`, which
`published(...)` draws from.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl

import numpy as np

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.actuators.thruster_geometry import OF_VEHICLE, thrusters_file
from uuvsim_cosim.models.actuators.thruster_set import options_of
from uuvsim_cosim.models.declaration.hull_parameters import meaning_of
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import (
    Quantity,
    parameter_set,
    read_yaml,
    split_address,
    vehicle_file,
    vehicle_folder,
)
from uuvsim_cosim.models.importing.vehicle_draft import quoted, row_of
from uuvsim_cosim.studies.identification.ambiguity import WEAK
from uuvsim_cosim.studies.identification.identify import Actuator, Identified, Number

if TYPE_CHECKING:
    from ruamel.yaml.comments import CommentedMap

__all__ = [
    "Saved",
    "ThrusterSet",
    "address_of",
    "inserted",
    "is_known",
    "replaced",
    "save_as",
    "thruster_set",
    "words_of",
]

_COPIED = ("parameters.yaml", "thrusters.yaml", "fins.yaml", "propeller.yaml", "control.yaml",
           "published.yaml", "README.md")  # fmt: skip


@dataclass(frozen=True)
class Saved:
    """A file that a set was written to, and the source that the set is used as."""

    file: Path
    source: str


def address_of(source: str) -> tuple[str, str | None]:
    """Return (vehicle, set) of a hull's source, such as ``model:bluerov2_heavy@wu_2018``."""
    name, _, query = source.removeprefix("model:").partition("?")
    options = dict(parse_qsl(query))
    id, chosen = split_address(options.get("id", name))
    return id, options.get("set", chosen)


def save_as(found: Identified, name: str) -> list[Saved]:
    """Write the set `name` into the vehicle's folder; ``folder@name`` into a copy of it at folder.

    Returns the files, and the source that each is used as. Raises InputInvalid if the set exists,
    or there is nothing to save.
    """
    place, set_name = split_address(name) if "@" in name else ("", name)
    set_name = set_name or ""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", set_name):
        raise InputInvalid(
            f"--save-as {name}: expected lower case letters, digits and _, as "
            "my_fit or my_rov@my_fit"
        )
    id, base = address_of(found.source)
    prefix = f"{found.hull}."
    fitted: dict[str, Number] = {}
    for number in found.numbers:
        own = [p.removeprefix(prefix) for p in number.places if p.startswith(prefix)]
        fitted |= dict.fromkeys(own, number)
    known = {k: n for k, n in fitted.items() if is_known(n)}
    turned = thruster_set(found, set_name, datetime.now(UTC).date().isoformat())
    if not known and turned is None:
        why = (
            "the data say too little of each"
            if fitted or found.actuators
            else "none of the numbers is the hull's or a thruster's"
        )
        raise InputInvalid(f"--save-as {name}: {why}; nothing to save")
    folder = vehicle_folder(id) if not place else _copied(id, Path(place))
    _, data = vehicle_file(str(folder / "parameters.yaml"))
    there = set(data["sets"]) if known else set()
    if turned is not None:
        there |= turned.names_in(folder)
    if set_name in there:
        raise InputInvalid(
            f"--save-as {name}: {folder} has a set of this name",
            f"a name other than {', '.join(sorted(there))}",
        )
    address = f"{place or folder.name}@{set_name}"
    saved = []
    if turned is not None:
        saved.append(Saved(turned.written(folder), f"model:{turned.model}?vehicle={address}"))
    if known:
        saved.append(Saved(_hull(found, id, base, known, folder, set_name, turned is not None),
                           f"model:{address}"))  # fmt: skip
    return saved


def _hull(
    found: Identified,
    id: str,
    base: str | None,
    known: dict[str, Number],
    folder: Path,
    set_name: str,
    with_thrusters: bool,
) -> Path:
    """Write the hull's set and its intervals."""
    origin = parameter_set(id, base)
    day = datetime.now(UTC).date().isoformat()
    quantities = dict(origin.quantities)
    for key, quantity in origin.quantities.items():
        held = found.held.get(key, quantity.value)
        if abs(held - quantity.value) > 1e-9 * abs(quantity.value):
            quantities[key] = Quantity(held, quantity.unit, "set for the fit, not identified")
    for key, number in known.items():
        words = words_of(found, number, day)
        quantities[key] = Quantity(number.value, number.unit, words)
    also = "; its thrusters: the set of this name in thrusters.yaml" if with_thrusters else ""
    text = _set(found, set_name, origin.name, quantities, set(known), day, also)
    file = folder / "parameters.yaml"
    _, data = vehicle_file(str(file))
    replaced(file, inserted(file.read_text(encoding="utf-8"), data, text), vehicle_file)
    _published(folder, str(data["id"]), known, found, day, set_name)
    return file


def _set(
    found: Identified,
    name: str,
    base: str,
    quantities: dict[str, Quantity],
    fitted: set[str],
    day: str,
    also: str,
) -> str:
    worst = ", ".join(f"{n} {s:.2g}" for n, s in found.residuals.items())
    rows = [
        row_of(key, q if key in fitted else Quantity(q.value, q.unit, f"{q.source} (set {base})"))
        for key, q in quantities.items()
    ]
    facts = f"{found.samples} samples of {found.seconds:.4g} s; residuals (rms): {worst}"
    cited = f"identified from {found.recording} on {day} by uuvsim identify"
    return (
        f"  {name}:\n"
        f"    citation: {quoted(cited)}\n"
        f"    obtained: {quoted(f'{facts}; what was not fitted is of the set {base}{also}')}\n"
        "    parameters:\n" + "".join(rows)
    )


def _published(
    folder: Path, id: str, fitted: dict[str, Number], found: Identified, day: str, set_name: str
) -> None:
    """Add both ends of each interval to published.yaml."""
    file = folder / "published.yaml"
    data = read_yaml(file, "published.schema.json") if file.is_file() else None
    have = dict(data["parameters"]) if data is not None else {}
    head = (
        "# Every published value of each number, for `published(...)` in "
        "uuvsim_cosim/envs/randomisation/published.py.\n"
    )
    text = (
        file.read_text(encoding="utf-8") if data is not None else f"{head}id: {id}\nparameters:\n"
    )
    lines = text.splitlines(keepends=True)
    for key, n in fitted.items():
        meaning = meaning_of(key)
        least = meaning.min if meaning is not None and meaning.min is not None else None
        if re.match(r"(M_A|D_l|D_q|D_u)_(\d)\2$", key):
            least = 0.0
        low = n.low if least is None else max(n.low, least)
        end = f"identified from {found.recording} on {day}"
        rows = "".join(
            f"    - {{value: {v:.9g}, unit: {quoted(n.unit)}, source: "
            f"{quoted(f'{end}: {which} end of the 95 % interval')}, set: {set_name}}}\n"
            for v, which in ((low, "lower"), (n.high, "upper"))
        )
        row = next((k for k, line in enumerate(lines) if line.rstrip() == f"  {key}:"), None)
        if key in have and row is not None:
            lines.insert(row + 1, rows)
        elif key not in have:
            lines.insert(_end_of_parameters(lines), f"  {key}:\n{rows}")
    made = "".join(lines)
    with whole_file(file) as scratch:
        scratch.write_text(made, encoding="utf-8")
        read_yaml(scratch, "published.schema.json")


def _end_of_parameters(lines: list[str]) -> int:
    """Return the line before the key that follows `parameters`, in the lines as they are now."""
    begun = False
    for k, line in enumerate(lines):
        if line.startswith("parameters:"):
            begun = True
        elif begun and line[:1].isalpha():
            return k
    return len(lines)


def _copied(id: str, folder: Path) -> Path:
    """Copy a vehicle's folder to `folder`, unless that is a vehicle's already."""
    if (folder / "parameters.yaml").is_file():
        return folder
    if not re.fullmatch(r"[a-z][a-z0-9_]*", folder.name):
        raise InputInvalid(f"--save-as: folder {folder.name!r}", "lower case, digits and _")
    if folder.exists():
        raise InputInvalid(f"{folder} is there, and is no vehicle", "a name that is free")
    source = vehicle_folder(id)
    try:
        folder.mkdir(parents=True)
        for name in _COPIED:
            if (source / name).is_file():
                shutil.copyfile(source / name, folder / name)
        for name in _COPIED:
            if name.endswith(".yaml") and (folder / name).is_file():
                text = (folder / name).read_text(encoding="utf-8")
                own = rf"\1: {folder.name}"
                text = re.sub(r"^(id|vehicle): .*$", own, text, count=1, flags=re.M)
                (folder / name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputInvalid(f"{folder}: cannot be written ({error.strerror})") from None
    return folder


@dataclass(frozen=True)
class ThrusterSet:
    """The set's component, and its text."""

    model: str
    text: str
    count: int  # of the vehicle's thrusters

    def names_in(self, folder: Path) -> set[str]:
        """Return the names of the sets that the folder's thrusters have."""
        return set(self._read(folder).get("sets", {}))

    def written(self, folder: Path) -> Path:
        """Write it into the folder's thrusters.yaml, and give that file."""
        file = folder / "thrusters.yaml"
        data = self._read(folder)
        text = inserted(file.read_text(encoding="utf-8"), data, self.text)
        replaced(file, text, lambda path: thrusters_file(Path(path)))
        return file

    def _read(self, folder: Path) -> CommentedMap:
        file = folder / "thrusters.yaml"
        if not file.is_file():
            raise InputInvalid(
                f"--save-as: {folder} has no thrusters.yaml",
                "a vehicle with thrusters, as numbers of thrusters were fitted",
            )
        data: CommentedMap = thrusters_file(file)
        if len(data["thrusters"]) != self.count:
            raise InputInvalid(
                file,
                f"{len(data['thrusters'])} thrusters, and the system's wrench has {self.count}",
                "the wrench of that vehicle",
            )
        return data


def thruster_set(found: Identified, name: str, day: str) -> ThrusterSet | None:
    """Return the set of the fitted parameters of thrusters; None if none of them is known.

    A parameter that all thrusters share is one number. Else there is one for each thruster; those
    that were not fitted keep the system's values.
    """
    if not found.actuators:
        return None
    sources = {a.source.partition("?")[0].removeprefix("model:") for a in found.actuators}
    model = next(iter(sources))
    if len(sources) > 1 or model not in OF_VEHICLE:
        raise InputInvalid(
            f"--save-as: numbers of {', '.join(sorted(sources))} were fitted",
            f"those of one component among {', '.join(OF_VEHICLE)}",
        )
    query = found.actuators[0].source.partition("?")[2]
    options = options_of(model, dict(parse_qsl(query)))
    rows = []
    for key, unit in _fitted(found.actuators, found.numbers):
        rows.append(_row(found, key, unit, day))
    rows = [r for r in rows if r]
    if not rows:
        return None
    plain = declare(model, **options).variables
    for key, value in found.actuators[0].held.items():
        shared = all(a.held.get(key) == value for a in found.actuators)
        if shared and value != float(np.ravel(plain[key].start)[0]):
            rows.append(
                f"      {key}: {{value: {value:.9g}, unit: {quoted(plain[key].unit)}, "
                'source: "set for the fit, not identified"}\n'
            )
    residuals = ", ".join(f"{n} {s:.2g}" for n, s in found.residuals.items())
    source = (
        f"identified from {found.recording} on {day} by uuvsim identify: {found.samples} samples "
        f"of {found.seconds:.4g} s; residuals (rms): {residuals}"
    )
    chosen = "".join(f"{k}: {quoted(v)}, " for k, v in options.items()).removesuffix(", ")
    text = (
        f"  {name}:\n    model: {model}\n"
        + (f"    options: {{{chosen}}}\n" if chosen else "")
        + f"    source: {quoted(source)}\n    parameters:\n"
        + "".join(rows)
    )
    return ThrusterSet(model, text, found.actuators[0].of)


def _fitted(actuators: Sequence[Actuator], numbers: Sequence[Number]) -> list[tuple[str, str]]:
    """Return (parameter, unit) of each number that is a thruster's, once."""
    paths = {a.path for a in actuators}
    out: dict[str, str] = {}
    for n in numbers:
        for place in n.places:
            path, _, key = place.rpartition(".")
            if path in paths:
                out.setdefault(key, n.unit)
    return list(out.items())


def _row(found: Identified, key: str, unit: str, day: str) -> str:
    """Return the line of a parameter: one number, or one for each thruster."""
    of: dict[int, Number] = {}
    for a in found.actuators:
        number = next((n for n in found.numbers if f"{a.path}.{key}" in n.places), None)
        if number is not None and is_known(number):
            of[a.number] = number
    count = found.actuators[0].of
    if not of:
        return ""
    shared = set(of) == set(range(1, count + 1)) and len({n.name for n in of.values()}) == 1
    if shared:
        n = of[1]
        value, interval = f"{n.value:.9g}", f"{n.low:.6g}, {n.high:.6g}"
        words = words_of(found, n, day)
    else:
        some = of[min(of)]
        values = [of[k].value if k in of else some.start for k in range(1, count + 1)]
        ends = [(of[k].low, of[k].high) if k in of else (some.start,) * 2
                for k in range(1, count + 1)]  # fmt: skip
        value = f"[{', '.join(f'{v:.9g}' for v in values)}]"
        interval = ", ".join(f"[{low:.6g}, {high:.6g}]" for low, high in ends)
        missing = [str(k) for k in range(1, count + 1) if k not in of]
        words = f"identified from {found.recording} on {day}, 95 % intervals beside it"
        if missing:
            words += f"; not identified of thruster {', '.join(missing)}: as before"
    return (
        f"      {key}: {{value: {value}, unit: {quoted(unit)}, interval: [{interval}], "
        f"source: {quoted(words)}}}\n"
    )


def is_known(number: Number) -> bool:
    """Return whether a number's 95 % interval is within half of it."""
    return bool(number.half_width < 2.0 * WEAK * abs(number.value))


def words_of(found: Identified, number: Number, day: str) -> str:
    """Return the source of a fitted number: the recording, the day, the interval."""
    return (
        f"identified from {found.recording} on {day}, 95 % interval {number.low:.6g} to "
        f"{number.high:.6g}"
    )


def inserted(text: str, data: CommentedMap, block: str) -> str:
    """Insert a set (indented by two) after the last one, or add `sets` at the file's end."""
    lines = text.splitlines(keepends=True)
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    if "sets" not in data:
        return "".join([*lines, "sets:\n", block])
    keys = sorted(data.lc.key(k)[0] for k in data)
    sets_at = data.lc.key("sets")[0]
    end = next((k for k in keys if k > sets_at), len(lines))
    indent = data["sets"].lc.key(next(iter(data["sets"])))[1]
    if indent != 2:
        block = "".join(" " * (indent - 2) + row for row in block.splitlines(keepends=True))
    return "".join([*lines[:end], block, *lines[end:]])


def replaced(file: Path, text: str, read: Callable[[str], object]) -> None:
    """Write a parameter file if `read` accepts it; otherwise the old file stays."""
    try:
        with whole_file(file) as scratch:
            scratch.write_text(text, encoding="utf-8")
            read(str(scratch))
    except OSError as error:
        raise InputInvalid(
            file,
            f"cannot be written ({error.strerror})",
            "a folder of your own, as --save-as my_rov@my_fit",
        ) from None
