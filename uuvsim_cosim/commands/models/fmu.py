"""`uuvsim fmu`: build FMUs from declarations and whole systems; inspect and check any FMU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from inspect import Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uuvsim_cosim.cache import written
from uuvsim_cosim.commands.shared.answer import answer
from uuvsim_cosim.commands.shared.completion import models, of, systems
from uuvsim_cosim.commands.shared.options import (
    fmi_version,
    folder_option,
    platform_names,
)
from uuvsim_cosim.commands.shared.system_options import (
    Replacements,
    Values,
    changes_of,
    edited_system,
)
from uuvsim_cosim.commands.shared.terminal import (
    console,
    file_line,
    line,
    put,
    range_of,
    remark,
    table,
    tilde,
)
from uuvsim_cosim.errors import InputInvalid, UuvsimError

if TYPE_CHECKING:
    from uuvsim_cosim.fmus.check.check_fmu import Look
    from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["app"]

app = typer.Typer(help="Build, inspect and check FMUs.", no_args_is_help=True)


def _build(
    build: Callable[..., Path],
    system: Annotated[
        str,
        typer.Argument(autocompletion=systems, help="Name of a system, or a path to .ssd or .ssp."),
    ],
    fmi: Annotated[int, typer.Option(help="FMI version: 2 or 3.")] = 2,
    platform: Annotated[
        str, typer.Option(help="Platforms, comma-separated: host, linux64, win64, …")
    ] = "host,linux64,win64",
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder or .fmu to write.")] = Path(),
    signals: Annotated[
        list[str] | None, typer.Option(help="Outputs of the FMU, such as 'hull.*'; by default all.")
    ] = None,
    inputs: Annotated[
        list[str] | None,
        typer.Option(help="Inputs of the FMU; '' for none; other inputs keep their start values."),
    ] = None,
    names: Annotated[
        str,
        typer.Option(
            autocompletion=of("flat", "structured"), help="flat: hull_eta; structured: hull.eta."
        ),
    ] = "flat",
    replace: Replacements = None,
    set_: Values = None,
    **more: object,
) -> None:
    version, platforms = fmi_version(fmi), platform_names(platform)
    edited = edited_system(system, None, changes_of(set_, replace))
    with console(stderr=True).status(f"building {edited.name} for {', '.join(platforms)}"):
        path = build(
            edited, fmi=version, platforms=platforms, target=out, signals=signals or (),
            inputs=inputs or (), naming=names, **more,
        )  # fmt: skip
    file_line(path)


def _with_options_of_build(command: Callable[..., None], *without: str) -> Callable[..., None]:
    """Declare the options of `_build` for a command, before its own: typer reads the signature."""
    _, *shared, _ = signature(_build, eval_str=True).parameters.values()
    *own, _ = signature(command, eval_str=True).parameters.values()
    options = [*(p for p in shared if p.name not in without), *own]
    command.__signature__ = Signature(options)  # type: ignore[attr-defined]
    return command


@app.command("system")
@_with_options_of_build
def system(**options: Any) -> None:
    """Build one self-contained FMU of a system of declarations."""
    from uuvsim_cosim.kernels.system_fmu.system_fmu import build_system_fmu

    _build(build_system_fmu, **options)


def container(**options: Any) -> None:
    """Build one FMU that contains the FMUs of a system, and steps them as the master does."""
    from uuvsim_cosim.kernels.system_fmu.container import build_container_fmu

    def build(system: System, *, platforms: Sequence[str], **more: Any) -> Path:
        path, remarks = build_container_fmu(system, **more)
        for text in remarks:
            remark("note", text)
        return path

    _build(build, **options, platform="host")


app.command("container")(_with_options_of_build(container, "platform"))


@app.command("client")
@_with_options_of_build
def client(
    host: Annotated[str, typer.Option(help="Default address of the server.")] = "127.0.0.1",
    port: Annotated[int | None, typer.Option(help="Default TCP port of the server; 7448.")] = None,
    **options: Any,
) -> None:
    """Build an FMU that is a client of `uuvsim serve SYSTEM`, which runs the co-simulation."""
    from uuvsim_cosim.bridge.clients.client_fmu import build_client_fmu
    from uuvsim_cosim.bridge.tcp.framing import TCP_PORT

    _build(build_client_fmu, **options, host=host, port=TCP_PORT if port is None else port)


@app.command("build")
def build(
    names: Annotated[
        list[str],
        typer.Argument(
            autocompletion=models,
            help="Models, named as in `uuvsim models`, with options: 'dvl?scene=tacoma'; or .fmu.",
        ),
    ],
    fmi: Annotated[int, typer.Option(help="FMI version: 2 or 3.")] = 3,
    platform: Annotated[
        str, typer.Option(help="Platforms, comma-separated: host, linux64, win64, wasm32, …")
    ] = "host",
    out: Annotated[Path, folder_option("Folder to write into.")] = Path("fmus/dist"),
) -> None:
    """Build an FMU of each named model, with a binary for each platform.

    An .fmu with C sources gets a binary for WebAssembly in addition, by `--platform wasm32`.
    """
    version = fmi_version(fmi)
    platforms = platform_names(platform)
    from uuvsim_cosim.fmus.export.fmu_file import build_many
    from uuvsim_cosim.fmus.sandbox.extend import add_web_assembly

    files = [name for name in names if name.endswith(".fmu")]
    if files and platforms != ["wasm32"]:
        raise InputInvalid(f"--platform {platform}", f"{files[0]} is an FMU already", "wasm32")
    with console(stderr=True).status(f"building {', '.join(names)} for {', '.join(platforms)}"):
        built = [add_web_assembly(Path(file), out) for file in files]
        models_ = [name for name in names if name not in files]
        built += build_many(models_, fmi=version, platforms=platforms, target_dir=out)
    for path in built:
        file_line(path)


@app.command("inspect")
def inspect(
    file: Annotated[Path, typer.Argument(help="An .fmu.")],
) -> None:
    """List the variables, units, capabilities and platforms of an FMU."""
    from uuvsim_cosim.fmus.check.inspect_fmu import inspect as look

    found = look(file).as_dict()
    if answer().mode == "json":
        for key, value in found.items():
            put(key, value)
        return
    words = {
        "CoSimulation": "Co-Simulation",
        "ModelExchange": "Model Exchange",
        "ScheduledExecution": "Scheduled Execution",
    }
    able = [name.replace("_", " ") for name, yes in found["capabilities"].items() if yes]
    rows = [
        ("file", tilde(file)),
        ("name", found["name"]),
        ("FMI", f"{found['fmi']}, {' and '.join(words[i] for i in found['interfaces'])}"),
        ("description", found["description"]),
        ("written by", found["tool"] or "not stated"),
        ("platforms", ", ".join(found["platforms"]) or "none (sources only)"),
        ("can", ", ".join(able) or "only step"),
        ("step size", found["step_size"] if found["step_size"] is not None else "not stated"),
    ]
    table(("", ""), rows)
    line()
    table(("a master may rely on", ""), list(found["a_master_may_rely_on"].items()))
    line()
    wanted = ("input", "output", "parameter", "structuralParameter")
    table(
        ("causality", "variable", "size", "type", "unit", "start", "range", "description"),
        [
            (v["causality"], v["name"], " x ".join(map(str, v["shape"])) or "1", v["type"],
             v["unit"] or "-", _short(v["start"]), range_of(v["min"], v["max"]),
             v["description"] or "")
            for v in sorted(
                (v for v in found["variables"] if v["causality"] in wanted),
                key=lambda v: wanted.index(v["causality"]),
            )
        ],
    )  # fmt: skip


def _short(value: object) -> str:
    if value is None:
        return ""
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 32 else text[:31] + "…"


@app.command("compare")
def compare(
    a: Annotated[Path, typer.Argument(help="An .fmu.")],
    b: Annotated[Path, typer.Argument(help="The .fmu that replaces it, or a later version.")],
) -> None:
    """Compare the interfaces of two FMUs: variables, units, capabilities, terminals.

    The exit status is 0 if they are equal, 1 if they differ.
    """
    from uuvsim_cosim.fmus.check.compare_fmu import compare_interfaces

    found = compare_interfaces(a, b)
    put("equal", not found)
    put("differences", [vars(d) for d in found])
    if not found:
        line(f"{tilde(a)} and {tilde(b)} have equal interfaces")
        return
    if answer().mode != "json":
        head = ("what", "name", "property", "A", "B")
        rows = [(d.topic, d.name, d.property, _short(d.a), _short(d.b)) for d in found]
        table(head, rows)
        line(f"{len(found)} difference{'s' * (len(found) != 1)}; --json has every value in full")
    raise typer.Exit(1)


@app.command("check")
def check(
    files: Annotated[list[Path], typer.Argument(help="One .fmu, or several.")],
    junit: Annotated[
        Path | None,
        typer.Option("--junit", help="File for the results in JUnit's XML, which CI servers read."),
    ] = None,
) -> None:
    """Check FMUs: rules, run, reset, state, reference result; status 2 if something is wrong."""
    from uuvsim_cosim.fmus.check.check_fmu import examine, relied_on
    from uuvsim_cosim.fmus.check.junit import junit_report

    wrong = []
    results: list[tuple[Path, Sequence[Look] | UuvsimError]] = []
    for file in files:
        try:
            with console(stderr=True).status(f"checking {file.name}"):
                looks = examine(file)
        except UuvsimError as error:
            if junit is None:
                raise
            results.append((file, error))
            wrong.append(str(error))
            continue
        results.append((file, looks))
        line(tilde(file))
        for look in looks:
            line(f"  {look.check}: {look.result}{': ' if look.text else ''}{look.text}")
        relied = relied_on(file, looks)
        checks = [{"check": k.check, "result": k.result, "text": k.text} for k in looks]
        put("files", [*answer().fields.get("files", []),
                      {"file": str(file), "checks": checks, "relied_on": relied}])  # fmt: skip
        line()
        table(("a master may rely on", ""), list(relied.items()))
        found = sum(look.result == "finding" for look in looks)
        if found:
            wrong.append(f"{file}: {found} finding(s)")
        else:
            line(f"{tilde(file)}: nothing wrong was found")
    if junit is not None:
        written(junit, junit_report(results))
        file_line(junit)
    if wrong:
        raise InputInvalid("; ".join(wrong), "none")


@app.command("conformance")
def conformance(
    folder: Annotated[Path, typer.Argument(help="Folder with .fmu, .ssp, .ssd and OSP systems.")],
    until: Annotated[float, typer.Option(help="Longest simulated time of each [s].")] = 10.0,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File for the table, as Markdown.")
    ] = None,
    libcosim: Annotated[
        Path | None,
        typer.Option(help="Interpreter that has libcosimpy, to compare systems with libcosim."),
    ] = None,
) -> None:
    """Run every FMU and system in a folder: equal to the reference, runs, or refused.

    An FMU is compared with the result that it carries, else with FMPy. The exit status is 1 if one
    deviates, crashes or fails.
    """
    if not 0 < until < float("inf"):
        raise InputInvalid(f"--until {until:g}", "more than 0 seconds")
    python = "" if libcosim is None else str(libcosim.absolute())
    if python and not Path(python).is_file():
        raise InputInvalid(libcosim, "no such file", "a Python interpreter that has libcosimpy")
    from uuvsim_cosim.orchestrator.running.conformance import Judged, markdown
    from uuvsim_cosim.orchestrator.running.conformance import conformance as run_all

    def show(judged: Judged) -> None:
        name = judged.subject.path.relative_to(folder)
        if answer().mode != "json":
            line(f"{judged.result}: {name}, {judged.subject.kind}: {judged.text}")

    found = run_all(folder, until=until, libcosim=python, report=show)
    put("results", [
        {"file": str(j.subject.path), "kind": j.subject.kind, "result": j.result, "text": j.text}
        for j in found
    ])  # fmt: skip
    counts = {r: sum(j.result == r for j in found) for r in dict.fromkeys(j.result for j in found)}
    table(("result", "number"), list(counts.items()), key="counts")
    if out is not None:
        written(out, markdown(folder, found))
        file_line(out)
    if counts.get("deviates") or counts.get("failed"):
        raise typer.Exit(1)
