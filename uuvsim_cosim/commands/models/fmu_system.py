"""`uuvsim fmu system` and `uuvsim fmu client`: a whole system as one FMU."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.completion import of, replacements, systems
from uuvsim_cosim.commands.shared.options import assignments, fmi_version, platform_names
from uuvsim_cosim.commands.shared.system_options import SET, edited_system
from uuvsim_cosim.commands.shared.terminal import console, file_line

__all__ = ["client_command", "system_command"]

_PLATFORMS = "host,linux64,win64"

System = Annotated[
    str, typer.Argument(autocompletion=systems, help="Name of a system, or .ssd, .ssp.")
]
Fmi = Annotated[int, typer.Option(help="FMI version: 2 or 3.")]
Platform = Annotated[str, typer.Option(help="Comma-separated: host, linux64, win64, …")]
Out = Annotated[Path, typer.Option("--out", "-o", help="Folder or .fmu to write.")]
Signals = Annotated[
    list[str] | None, typer.Option(help="Outputs to show, 'hull.*'; all by default.")
]
Inputs = Annotated[
    list[str] | None, typer.Option(help="Inputs to show; '' for none; others are left alone.")
]
Names = Annotated[
    str,
    typer.Option(
        autocompletion=of("flat", "structured"), help="flat: hull_eta; structured: hull.eta."
    ),
]
Replace = Annotated[
    list[str] | None, typer.Option(autocompletion=replacements, help="component=source.")
]
Set = Annotated[list[str] | None, typer.Option("--set", help=f"{SET}; again for more.")]


def system_command(
    system: System,
    fmi: Fmi = 2,
    platform: Platform = _PLATFORMS,
    out: Out = Path(),
    signals: Signals = None,
    inputs: Inputs = None,
    names: Names = "flat",
    replace: Replace = None,
    set_: Set = None,
) -> None:
    """Build one self-contained FMU of a system of declarations."""
    from uuvsim_cosim.kernels.system_fmu.system_fmu import build_system_fmu

    _build(build_system_fmu, system, fmi, platform, out, signals, inputs, names, replace, set_)


def client_command(
    system: System,
    fmi: Fmi = 2,
    platform: Platform = _PLATFORMS,
    out: Out = Path(),
    signals: Signals = None,
    inputs: Inputs = None,
    names: Names = "flat",
    replace: Replace = None,
    set_: Set = None,
    host: Annotated[str, typer.Option(help="Where it will be served, unless set.")] = "127.0.0.1",
    port: Annotated[int | None, typer.Option(help="TCP port (7448), unless set.")] = None,
) -> None:
    """Build an FMU that is a running co-simulation: `uuvsim serve SYSTEM` elsewhere."""
    from uuvsim_cosim.bridge.clients.client_fmu import build_client_fmu
    from uuvsim_cosim.bridge.tcp.framing import TCP_PORT

    _build(
        build_client_fmu, system, fmi, platform, out, signals, inputs, names, replace, set_,
        host=host, port=TCP_PORT if port is None else port,
    )  # fmt: skip


def _build(
    build: Callable[..., Path],
    system: str,
    fmi: int,
    platform: str,
    out: Path,
    signals: list[str] | None,
    inputs: list[str] | None,
    names: str,
    replace: list[str] | None,
    set_: list[str] | None,
    **more: object,
) -> None:
    version, platforms = fmi_version(fmi), platform_names(platform)
    changes = {
        "replace": assignments("--replace", replace or [], "component=source", dotted=False),
        "map": {},
        "rate": {},
        "set": assignments("--set", set_ or [], SET, dotted=True),
    }
    edited = edited_system(system, None, changes)
    with console(stderr=True).status(f"building {edited.name} for {', '.join(platforms)}"):
        path = build(
            edited, fmi=version, platforms=platforms, target=out, signals=signals or (),
            inputs=inputs or (), naming=names, **more,
        )  # fmt: skip
    file_line(path)
