"""Saving of fitted parameters as a named set of the vehicle, and as a distribution.

The set of the hull is the declared one with the fitted values instead of its own. Each value states
its source and its 95 % interval. Both ends of the interval and the correlation of the errors are
added to `published.yaml`, which `published(...)` draws from. Parameters of thrusters become a set
of the same name in thrusters.yaml. The comments of all files are kept.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl

import numpy as np

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.actuators.thruster_geometry import OF_VEHICLE, options_of, thrusters_file
from uuvsim_cosim.models.declaration.hull_parameters import meaning_of
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.modeline import BY_FILE_NAME, headed, keep_schemas
from uuvsim_cosim.models.declaration.parameter_files import (
    Quantity,
    parameter_set,
    read_yaml,
    split_address,
    vehicle_file,
    vehicle_folder,
)
from uuvsim_cosim.models.importing.vehicle_draft import quoted, row_of
from uuvsim_cosim.studies.identification.identify import Identified, Number

if TYPE_CHECKING:
    from ruamel.yaml.comments import CommentedMap

__all__ = ["Saved", "address_of", "save_as"]

_COPIED = ("parameters.yaml", "thrusters.yaml", "fins.yaml", "propeller.yaml", "control.yaml",
           "published.yaml", "shape.yaml", "README.md")  # fmt: skip


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
    words = ("true", "false", "null")  # of YAML
    if not re.fullmatch(r"[a-z][a-z0-9_]*", set_name) or set_name in words:
        raise InputInvalid(
            f"--save-as {name}: expected lower case letters, digits and _, as "
            f"my_fit or my_rov@my_fit, and no word of YAML ({', '.join(words)})"
        )
    id, base = address_of(found.source)
    prefix = f"{found.hull}."
    fitted = {
        p.removeprefix(prefix): n for n in found.numbers for p in n.places if p.startswith(prefix)
    }
    known = {k: n for k, n in fitted.items() if n.is_known}
    origin = f"identified from {found.recording} on {datetime.now(UTC).date().isoformat()}"
    residuals = ", ".join(f"{n} {s:.2g}" for n, s in found.residuals.items())
    facts = f"{found.samples} samples of {found.seconds:.4g} s; residuals (rms): {residuals}"
    if not found.converged:
        facts += f"; not converged after {found.iterations} iterations: {found.status}"
    thruster_set = _thruster_set(found, set_name, origin, facts)
    if not known and thruster_set is None:
        why = (
            "the data do not determine any of them well enough"
            if fitted or found.actuators
            else "none of the numbers is the hull's or a thruster's"
        )
        raise InputInvalid(f"--save-as {name}: {why}; nothing to save")
    target = Path(place) if place else vehicle_folder(id)
    if target.resolve().is_relative_to(content("models", "vehicles").resolve()):
        own = f"my_{target.name}@{set_name}"
        raise InputInvalid(
            f"--save-as {name}: the vehicle's folder {target} belongs to the package, and nothing "
            "is written there",
            f"a folder of your own, to which the vehicle is copied: --save-as {own}",
        )
    folder = _copied(id, target) if place else target
    file, thrusters_yaml = folder / "parameters.yaml", folder / "thrusters.yaml"
    _, data = vehicle_file(str(file))
    there = set(data["sets"]) if known else set()
    if thruster_set is not None:
        if not thrusters_yaml.is_file():
            raise InputInvalid(
                f"--save-as: {folder} has no thrusters.yaml",
                "a vehicle with thrusters, because parameters of thrusters were fitted",
            )
        thrusters: CommentedMap = thrusters_file(thrusters_yaml)
        count = found.actuators[0].of
        if len(thrusters["thrusters"]) != count:
            raise InputInvalid(
                thrusters_yaml,
                f"{len(thrusters['thrusters'])} thrusters, and the system's wrench has {count}",
                "the wrench of that vehicle",
            )
        there |= set(thrusters.get("sets", {}))
    if set_name in there:
        raise InputInvalid(
            f"--save-as {name}: {folder} has a set of this name",
            f"a name other than {', '.join(sorted(there))}",
        )
    address = f"{place or folder.name}@{set_name}"
    saved = []
    if thruster_set is not None:
        model, text = thruster_set
        _insert(thrusters_yaml, thrusters, text, lambda path: thrusters_file(Path(path)))
        saved.append(Saved(thrusters_yaml, f"model:{model}?vehicle={address}"))
    if known:
        declared = parameter_set(id, base)
        also = "; its thrusters: the set of this name in thrusters.yaml" if saved else ""
        obtained = f"{facts}; what was not fitted is of the set {declared.name}{also}"
        text = (
            f"  {set_name}:\n"
            f"    citation: {quoted(f'{origin} by uuvsim identify')}\n"
            f"    obtained: {quoted(obtained)}\n"
            "    parameters:\n"
        )
        for key in dict.fromkeys([*declared.quantities, *known]):
            if key in known:
                number = known[key]
                text += row_of(key, Quantity(number.value, number.unit, _source(origin, number)))
                continue
            quantity = declared.quantities[key]
            value, source = found.held.get(key, quantity.value), "set for the fit, not identified"
            if abs(value - quantity.value) <= 1e-9 * abs(quantity.value):
                value, source = quantity.value, quantity.source
            text += row_of(key, Quantity(value, quantity.unit, f"{source} (set {declared.name})"))
        _insert(file, data, text, vehicle_file)
        _add_published(
            folder / "published.yaml",
            str(data["id"]),
            known,
            _pairs(found, known),
            origin,
            set_name,
        )
        saved.append(Saved(file, f"model:{address}"))
    return saved


def _copied(id: str, folder: Path) -> Path:
    """Copy a vehicle's folder to `folder`, unless that is a vehicle's already."""
    if (folder / "parameters.yaml").is_file():
        return folder
    if not re.fullmatch(r"[a-z][a-z0-9_]*", folder.name):
        raise InputInvalid(f"--save-as: folder {folder.name!r}", "lower case, digits and _")
    if folder.exists():
        raise InputInvalid(f"{folder} exists and is no vehicle", "an unused name")
    source = vehicle_folder(id)
    try:
        folder.mkdir(parents=True)
        for name in _COPIED:
            if not (source / name).is_file():
                continue
            shutil.copyfile(source / name, folder / name)
            if name.endswith(".yaml"):
                text = (folder / name).read_text(encoding="utf-8")
                own = rf"\1: {folder.name}"
                text = re.sub(r"^(id|vehicle): .*$", own, text, count=1, flags=re.M)
                text = headed(BY_FILE_NAME[name], text)
                (folder / name).write_text(text, encoding="utf-8")
                keep_schemas(folder / name)
    except OSError as error:
        raise InputInvalid(f"{folder}: cannot be written ({error.strerror})") from None
    return folder


def _thruster_set(found: Identified, name: str, origin: str, facts: str) -> tuple[str, str] | None:
    """Return model and text of a set for thrusters.yaml; None if no parameter of them is known.

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
    units: dict[str, str] = {}
    fitted: dict[str, dict[int, Number]] = {}  # by parameter and thruster
    for n in found.numbers:
        for place in n.places:
            path, _, key = place.rpartition(".")
            for a in (a for a in found.actuators if a.path == path):
                units.setdefault(key, n.unit)
                if n.is_known:
                    fitted.setdefault(key, {})[a.number] = n
    first = found.actuators[0]
    rows = ""
    for key, unit in units.items():
        if key in fitted:
            value, interval, source = _of_thrusters(fitted[key], first.of, origin)
            rows += (f"      {key}: {{value: {value}, unit: {quoted(unit)}, interval: [{interval}],"
                     f" source: {quoted(source)}}}\n")  # fmt: skip
    if not rows:
        return None
    options = options_of(model, dict(parse_qsl(first.source.partition("?")[2])))
    plain = declare(model, **options).variables
    for key, held in first.held.items():
        shared = all(a.held.get(key) == held for a in found.actuators)
        if shared and held != float(np.ravel(plain[key].start)[0]):
            rows += (
                f"      {key}: {{value: {held:.9g}, unit: {quoted(plain[key].unit)}, "
                'source: "set for the fit, not identified"}\n'
            )
    chosen = ", ".join(f"{k}: {quoted(v)}" for k, v in options.items())
    return model, (
        f"  {name}:\n    model: {model}\n"
        + (f"    options: {{{chosen}}}\n" if chosen else "")
        + f"    source: {quoted(f'{origin} by uuvsim identify: {facts}')}\n    parameters:\n"
        + rows
    )


def _of_thrusters(of: Mapping[int, Number], count: int, origin: str) -> tuple[str, str, str]:
    """Return value, interval and source: one number, or one for each of `count` thrusters."""
    every = range(1, count + 1)
    some = of[min(of)]
    if set(of) == set(every) and len({n.name for n in of.values()}) == 1:
        return f"{some.value:.9g}", f"{some.low:.6g}, {some.high:.6g}", _source(origin, some)
    values = [of[k].value if k in of else some.start for k in every]
    ends = [(of[k].low, of[k].high) if k in of else (some.start,) * 2 for k in every]
    missing = ", ".join(str(k) for k in every if k not in of)
    source = f"{origin}, 95 % intervals beside it"
    if missing:
        source += f"; not identified of thruster {missing}: as before"
    interval = ", ".join(f"[{low:.6g}, {high:.6g}]" for low, high in ends)
    return f"[{', '.join(f'{v:.9g}' for v in values)}]", interval, source


def _source(origin: str, number: Number) -> str:
    return f"{origin}, 95 % interval {number.low:.6g} to {number.high:.6g}"


def _insert(file: Path, data: CommentedMap, block: str, read: Callable[[str], object]) -> None:
    """Insert a set (indented by two) after the last one, or add `sets` at the file's end.

    The old file stays if `read` refuses the new one.
    """
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    end = len(lines)
    if "sets" in data:
        sets_at = data.lc.key("sets")[0]
        end = min((row for k in data if (row := data.lc.key(k)[0]) > sets_at), default=end)
        indent = data["sets"].lc.key(next(iter(data["sets"])))[1]
        if indent != 2:
            rows = block.splitlines(keepends=True)
            block = "".join(" " * (indent - 2) + row for row in rows)
    else:
        block = f"sets:\n{block}"
    try:
        with whole_file(file) as scratch:
            scratch.write_text("".join([*lines[:end], block, *lines[end:]]), encoding="utf-8")
            read(str(scratch))
    except OSError as error:
        raise InputInvalid(
            file,
            f"cannot be written ({error.strerror})",
            "a folder of your own, as --save-as my_rov@my_fit",
        ) from None


def _pairs(found: Identified, known: Mapping[str, Number]) -> dict[tuple[str, str], float]:
    """Return the correlation of the errors of each two saved numbers of the hull."""
    at = {key: found.numbers.index(number) for key, number in known.items()}
    return {
        (a, b): float(np.clip(found.correlation[at[a], at[b]], -1.0, 1.0))
        for a, b in combinations(known, 2)
    }


def _add_published(
    file: Path,
    id: str,
    fitted: Mapping[str, Number],
    pairs: Mapping[tuple[str, str], float],
    origin: str,
    set_name: str,
) -> None:
    """Add both ends of each interval, and the correlations, to published.yaml."""
    if file.is_file():
        have = set(read_yaml(file, "published.schema.json")["parameters"])
        lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    else:
        have = set()
        lines = [
            headed("published", ""),
            "# Every published value of each number, for `published(...)` in "
            "uuvsim_cosim/envs/randomisation/published.py.\n",
            f"id: {id}\n",
            "parameters:\n",
        ]
    for key, n in fitted.items():
        meaning = meaning_of(key)
        least = meaning.min if meaning is not None else None
        if re.match(r"(M_A|D_l|D_q|D_u)_(\d)\2$", key):
            least = 0.0
        low = n.low if least is None else max(n.low, least)
        rows = "".join(
            f"    - {{value: {v:.9g}, unit: {quoted(n.unit)}, source: "
            f"{quoted(f'{origin}: {which} end of the 95 % interval')}, set: {set_name}}}\n"
            for v, which in ((low, "lower"), (n.high, "upper"))
        )
        row = next((k for k, line in enumerate(lines) if line.rstrip() == f"  {key}:"), None)
        if key in have and row is not None:
            lines.insert(row + 1, rows)
        elif key not in have:
            begin = next((k for k, line in enumerate(lines) if line.startswith("parameters:")), 0)
            ends = (k for k, line in enumerate(lines) if k > begin and line[:1].isalpha())
            lines.insert(next(ends, len(lines)), f"  {key}:\n{rows}")
    if pairs:
        rows = "".join(
            f"  - {{between: [{a}, {b}], value: {rho:.15g}, because: "
            f"{quoted(f'{origin}: errors of one fit')}, set: {set_name}}}\n"
            for (a, b), rho in pairs.items()
        )
        at = next((k for k, line in enumerate(lines) if line.startswith("correlation:")), None)
        if lines and not lines[-1].endswith("\n"):
            lines[-1] += "\n"
        if at is None:
            lines.append(f"correlation:\n{rows}")
        else:
            lines.insert(at + 1, rows)
    with whole_file(file) as scratch:
        scratch.write_text("".join(lines), encoding="utf-8")
        read_yaml(scratch, "published.schema.json")
    keep_schemas(file)
