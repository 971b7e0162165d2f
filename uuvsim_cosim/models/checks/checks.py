"""Every comparison of a vehicle, a component or a function, in one list of rows.

In a vehicle's folder `reference/<set>_*.csv` are trajectories (reference_trajectory.py);
`checks.yaml` holds single published values and the closed forms that a published set is known to
break, with the cause. What needs more than one number has a module here; the figures lie in
models/reference.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from uuvsim_cosim.errors import ComponentFailed, InputInvalid
from uuvsim_cosim.models.checks.comparison import GROUPS, Checked, compared
from uuvsim_cosim.models.checks.compiled_run import end_of
from uuvsim_cosim.models.checks.reference_trajectory import check, group_of
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import (
    is_vehicle,
    line_of,
    read_yaml,
    split_address,
    vehicle_folder,
    vehicle_ids,
    vehicle_sets,
)
from uuvsim_cosim.models.vehicles.check_vehicle_folder import read_folder
from uuvsim_cosim.models.vehicles.closed_forms import closed_forms

__all__ = ["Checked", "checks_of", "every_check", "groups_of"]

TRAJECTORY_TOLERANCE = {"prestero": 1e-6, "typed_again": 1e-6}  # of others 1e-5
EXPECTED = ("eta", "nu", "nu_dot", "nu_r")
# (group, vehicle or component, empty for functions; where the rows come from)
COMPARISONS = (
    ("closed_form", "", "exact_solutions:solutions"),
    ("mss", "", "mss:rotations"),
    ("mss", "", "mss:matrices"),
    ("mss", "", "mss:others"),
    ("gz_sim", "", "gz_sim:functions"),
    ("uuv_simulator", "thruster", "uuv_simulator:thrusters"),
    ("blue_robotics", "thruster_t200", "actuators:t200"),
    ("mss", "npsauv", "npsauv:npsauv"),
    ("healey_lienard", "npsauv", "actuators:fins_of_npsauv"),
    ("lauv_gazebo", "lauv", "actuators:fins_of_lauv"),
    ("fossen", "remus100", "fossen:trajectories"),
    ("prestero", "remus100", "prestero:coefficients"),
    ("uuv_simulator", "rexrov", "uuv_simulator:rexrov"),
    ("uuv_simulator", "rexrov2", "uuv_simulator:allocation_of_rexrov2"),
    ("uuv_simulator", "sphere", "uuv_simulator:sphere"),
    ("lrauv", "tethys_lrauv", "lrauv:tethys"),
    ("lrauv", "tethys_lrauv", "lrauv:mass_forward"),
)


def every_check(groups: Collection[str] = ()) -> Iterator[Checked]:
    """Run all checks, or those of these groups: functions, components, then vehicles."""
    ids = vehicle_ids()
    for owner in dict.fromkeys(owner for _, owner, _ in COMPARISONS if owner not in ids):
        yield from _of(owner, None, groups)
    for id in ids:
        yield from checks_of(id, groups)


def checks_of(address: str, groups: Collection[str] = ()) -> Iterator[Checked]:
    """Run every check of a vehicle, of one of its sets (``id@set``), or of a component.

    First every file of its folder is read: raises ParameterInvalid with all mistakes of all.
    """
    if address and address in {owner for _, owner, _ in COMPARISONS} - set(vehicle_ids()):
        yield from _of(address, None, groups)
        return
    id, chosen = split_address(address)
    if not is_vehicle(id):
        if Path(id).expanduser().is_dir():
            raise InputInvalid(
                f"{id}: a folder without a parameters.yaml; expected a vehicle's folder"
            )
        known = sorted({*vehicle_ids(), *(owner for _, owner, _ in COMPARISONS if owner)})
        raise InputInvalid(
            f"there is nothing to compare {id!r} with; expected "
            f"{expected_names(id, known)}, the path of a folder with a parameters.yaml, "
            "or of such a file"
        )
    read_folder(id)
    sets = vehicle_sets(id)
    if chosen is not None and chosen not in sets:
        raise InputInvalid(id, f"there is no parameter set {chosen!r}", ", ".join(sets))
    data = _read(vehicle_folder(id), sets)
    wanted = sets if chosen is None else [chosen]
    for file, owner in _trajectories(id, sets):
        group = group_of(file)
        if owner in wanted and (not groups or group in groups):
            worst = max(check(f"{id}@{owner}", file, 5e-3), key=lambda d: d.max)
            what = f"trajectory {file.stem.removeprefix(owner).strip('_')}: {worst.column}"
            source = f"{GROUPS.get(group, group)}: {file.name}"
            at_most = TRAJECTORY_TOLERANCE.get(group, 1e-5)
            yield Checked(f"{id}@{owner}", what, worst.max, at_most, source, group=group)
    for i, entry in enumerate(data.get("checks", ())):
        group = str(entry.get("group", "published"))
        if entry["set"] in wanted and (not groups or group in groups):
            try:
                yield _published(id, entry, group)
            except (InputInvalid, ComponentFailed) as error:
                at = line_of(data, ["checks", i])
                place = vehicle_folder(id) / "checks.yaml"
                raise InputInvalid(f"{place}:{at}: {entry['what']}: {error}") from None
    yield from _of(id, chosen, groups)
    for name in wanted if not groups or "closed_form" in groups else ():
        for form in closed_forms(declare(f"{id}@{name}", surface=False)):
            causes = [
                str(k["because"])
                for k in data.get("known", ())
                if k["check"] == form.name and k["set"] in (name, "*")
            ]
            cause = causes[0] if causes and form.off > form.tolerance else ""
            yield Checked(
                f"{id}@{name}", form.name, form.off, form.tolerance, "closed form", cause,
                "closed_form",
            )  # fmt: skip


def groups_of(address: str) -> list[str]:
    """List the groups that there are comparisons of, for a vehicle, a component, or all ("")."""
    id, _ = split_address(address)
    found = {group for group, owner, _ in COMPARISONS if not id or owner == id}
    for one in [id] if id else vehicle_ids():
        if is_vehicle(one):
            sets = vehicle_sets(one)
            found |= {group_of(file) for file, _ in _trajectories(one, sets)} | {"closed_form"}
            data = _read(vehicle_folder(one), sets)
            found |= {str(e.get("group", "published")) for e in data.get("checks", ())}
    return sorted(found)


def _of(owner: str, chosen: str | None, groups: Collection[str]) -> Iterator[Checked]:
    """Yield the rows of modules for a vehicle or a component."""
    for group, of, place in COMPARISONS:
        if of == owner and (not groups or group in groups):
            module, function = place.split(":")
            for row in getattr(import_module(f"uuvsim_cosim.models.checks.{module}"), function)():
                if chosen is None or row.address in (owner, f"{owner}@{chosen}"):
                    yield row


def _trajectories(id: str, sets: list[str]) -> Iterator[tuple[Path, str]]:
    for file in sorted((vehicle_folder(id) / "reference").glob("*.csv")):
        owners = [s for s in sets if file.stem == s or file.stem.startswith(f"{s}_")]
        if not owners:
            raise InputInvalid(f"{file}: expected a name that begins with {', '.join(sets)}")
        yield file, max(owners, key=len)


def _published(id: str, entry: Mapping[str, Any], group: str) -> Checked:
    address = f"{id}@{entry['set']}"
    inputs = {name: entry[name] for name in ("tau", "v_c") if name in entry}
    model = declare(address, surface=False)
    result = end_of(model, float(entry["until"]), 2e-2, inputs, entry.get("parameters"))
    ours, theirs = [], []
    for output, values in entry["expect"].items():
        for one, other in zip(result[output], values, strict=True):
            if other is not None:
                ours.append(one)
                theirs.append(float(other))
    what, source, most = str(entry["what"]), str(entry["source"]), float(entry["tolerance"])
    return compared(group, address, what, ours, theirs, most, source=source)


def _read(folder: Path, sets: list[str]) -> Any:
    path = folder / "checks.yaml"
    if not path.is_file():
        return {}
    data = read_yaml(path, "checks.schema.json")
    for part in ("checks", "known"):
        for i, entry in enumerate(data.get(part, ())):
            if entry["set"] not in sets and (part == "checks" or entry["set"] != "*"):
                line = line_of(data, [part, i, "set"])
                raise InputInvalid(f"{path}:{line}", f"set: {entry['set']!r}", ", ".join(sets))
            for output, values in entry.get("expect", {}).items():
                if output not in EXPECTED:
                    line = line_of(data, [part, i, "expect"])
                    known = f"{', '.join(EXPECTED[:-1])} or {EXPECTED[-1]}"
                    raise InputInvalid(f"{path}:{line}", f"expect: {output!r}", known)
                if all(v is None for v in values):
                    line = line_of(data, [part, i, "expect"])
                    raise InputInvalid(f"{path}:{line}", "expect: nothing", "a number")
    return data
