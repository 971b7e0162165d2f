"""Readers and checks of options: `--out`, times, NAME=VALUE, `--fmi`, `--platform`, `--ray`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.isolation.grants import GRANTS

if TYPE_CHECKING:
    from uuvsim_cosim.cluster.ray_cluster import Cluster
    from uuvsim_cosim.fmus.export.model_description import FmiVersion

__all__ = [
    "RAY",
    "assignments",
    "by_component",
    "clustered",
    "expect_folder",
    "fmi_version",
    "folder_option",
    "grants",
    "nested",
    "platform_names",
    "rates",
    "seconds",
    "step_text",
    "value_of",
]

RAY = "Ray cluster: HOST:PORT, ray://HOST:PORT, auto or local."
_OF_FILES = """
    avi bag csv db3 doc docx fmu gif h5 hdf5 htm html jpeg jpg json laz mat mcap md mkv mov mp4 npy
    npz onnx parquet pdf png pt pth py rrd ssd ssp svg tif tiff toml txt webm xls xlsx xml yaml yml
    zip
""".split()  # noqa: SIM905


def folder_option(help: str) -> Any:
    """Return the option `--out` of a command that writes a folder."""

    def checked(out: Path | None) -> Path | None:
        if out is not None:
            expect_folder(out)
        return out

    return typer.Option("--out", "-o", callback=checked, help=help)


def expect_folder(out: Path, *files: str, option: str = "--out") -> None:
    """Raise InputInvalid for a file or a name like ``run.csv``; endings in `files` are allowed.

    `option` is the name of the option for the message.
    """
    ending = out.suffix.lower()
    if ending in files or out.is_dir():
        return
    wanted = ", ".join([*files, "or the name of a folder" if files else "the name of a folder"])
    if out.exists():
        raise InputInvalid(f"{option} {out}: is a file", wanted)
    if ending[1:] in _OF_FILES:
        raise InputInvalid(f"{option} {out}: ending {out.suffix!r} was read", wanted)


def seconds(option: str) -> Callable[[str], float]:
    """Return the parser of an option that takes a time: ``90``, ``"90 s"`` or ``1.5min``."""

    def parse(text: str) -> float:
        from uuvsim_cosim.models.declaration.units import seconds_of

        return seconds_of(str(text), option)

    return parse


def step_text(text: str, option: str) -> str:
    """Return a step in s as text; one without a unit stays as it is, ``1/50`` for example."""
    if "/" in text or not any(c.isalpha() for c in text.lower().replace("e", "")):
        return text
    from uuvsim_cosim.models.declaration.units import seconds_of

    return repr(seconds_of(text, option))


def assignments(
    option: str, texts: Iterable[str], expected: str, *, dotted: bool
) -> dict[str, str]:
    """Return {left: right} of texts ``left=right``; `dotted`: the left side must hold a dot."""
    found: dict[str, str] = {}
    for text in texts:
        left, equals, right = (part.strip() for part in text.partition("="))
        component, dot, rest = left.rpartition(".")
        if not equals or not left or not right or (dotted and not (component and dot and rest)):
            raise InputInvalid(f"{option} {text}: expected {expected}")
        if left in found:
            raise InputInvalid(f"{option} {text}", f"{left} is given twice", "once")
        found[left] = right
    return found


def rates(texts: Iterable[str]) -> dict[str, str]:
    """Return the communication steps [s] of ``component=step``; a step may carry a unit."""
    found = assignments("--rate", texts, "component=step, such as 0.02 or 20ms", dotted=False)
    return {name: step_text(text, f"--rate {name}") for name, text in found.items()}


def grants(texts: Iterable[str]) -> dict[str, list[str]]:
    """Return the grants of each component of ``component=grant``."""
    found: dict[str, list[str]] = {}
    for text in texts:
        name, equals, grant = (part.strip() for part in text.partition("="))
        if not (name and equals and grant):
            raise InputInvalid(f"--grant {text}: expected component={GRANTS}")
        found.setdefault(name, []).append(grant)
    return found


def by_component(found: dict[str, str]) -> dict[str, dict[str, str]]:
    """Group {component.variable: value} by component; an index may follow the variable."""
    grouped: dict[str, dict[str, str]] = {}
    for left, right in found.items():
        component, _, variable = left.rpartition(".")
        grouped.setdefault(component, {})[variable] = right
    return grouped


def value_of(text: str) -> float | str:
    """Return a number if the text is one; else the text, e.g. ``2 km/h`` or ``true``."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def nested(option: str, texts: Iterable[str], expected: str) -> dict[str, Any]:
    """Return {"rules": {"credit": "own"}} of ``rules.credit=own``; raises InputInvalid."""
    found: dict[str, Any] = {}
    for name, text in assignments(option, texts, expected, dotted=False).items():
        *parents, last = name.split(".")
        place = found
        for parent in parents:
            place = place.setdefault(parent, {})
            if not isinstance(place, dict):
                raise InputInvalid(f"{option} {name}", f"{parent} has a value already", "one")
        place[last] = value_of(text)
        if isinstance(place[last], str):  # no number; YAML may read a truth value, list or mapping
            from ruamel.yaml import YAML
            from ruamel.yaml.error import YAMLError

            try:
                place[last] = YAML(typ="safe", pure=True).load(text)
            except YAMLError:
                raise InputInvalid(
                    f"{option} {name}={text}", "cannot be read", "a value as in YAML"
                ) from None
    return found


def fmi_version(number: int) -> FmiVersion:
    """Return 2 or 3; raises InputInvalid for another number."""
    if number not in (2, 3):
        raise InputInvalid(f"--fmi: {number} was read", "2 or 3")
    return 2 if number == 2 else 3


def platform_names(text: str) -> list[str]:
    """Split a list of platforms; a wrong name is refused before anything is built."""
    from uuvsim_cosim.fmus.codegen.toolchain import platform_named

    names = [p.strip() for p in text.split(",") if p.strip()]
    for name in names:
        platform_named(name)
    return names


@contextmanager
def clustered(
    address: str | None, jobs: int | None = None, *, alike: tuple[str, ...] = ()
) -> Iterator[Cluster | None]:
    """Connect to the cluster of `--ray`, if any; `jobs` are the workers of a local cluster."""
    if address is None:
        yield None
        return
    if jobs is not None and address != "local":
        raise InputInvalid(
            f"--jobs {jobs} with --ray {address}: the cluster sets the number", "one of them"
        )
    from uuvsim_cosim.cluster.ray_cluster import Cluster

    with Cluster(address, workers=jobs, alike=alike) as cluster:
        yield cluster
