"""`uuvsim new`: write a template of a component that fits its slot."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.completion import components, of, systems
from uuvsim_cosim.commands.shared.options import expect_folder, folder_option
from uuvsim_cosim.commands.shared.terminal import file_line, for_shell, line, tilde
from uuvsim_cosim.errors import InputInvalid

__all__ = ["new_command"]


def new_command(
    component: Annotated[
        str | None,
        typer.Argument(
            autocompletion=components,
            help="Component to replace; with --workspace: controller.",
        ),
    ] = None,
    kind: Annotated[
        str,
        typer.Option(
            "--as",
            autocompletion=of("python", "pythonfmu3", "c"),
            help="Kind of template: python, pythonfmu3 or c.",
        ),
    ] = "python",
    system: Annotated[
        str,
        typer.Option("--for", autocompletion=systems, help="System that contains the component."),
    ] = "bluerov2_survey",
    out: Annotated[Path, folder_option("Folder to write into.")] = Path(),
    workspace: Annotated[
        Path | None,
        typer.Option(help="Folder for VS Code to write: component, test, settings, debugging."),
    ] = None,
    ros2_workspace: Annotated[
        Path | None,
        typer.Option(help="Folder for ROS 2 to write: nodes, launch file, RViz, Foxglove."),
    ] = None,
) -> None:
    """Write a template of a component that fits a system, and print how to run it.

    With --workspace, the folder also gets settings, tasks, a debug configuration, snippets and
    schemas for VS Code, and a development container. With --ros2-workspace, the folder gets a node
    in Python and in C++ for colcon, a launch file, and layouts of RViz and Foxglove.
    """
    if ros2_workspace is not None:
        if (component, kind, out, workspace) != (None, "python", Path(), None):
            raise InputInvalid(
                "--ros2-workspace with other options", "--for SYSTEM alone beside it"
            )
        _write_for_ros2(ros2_workspace, system)
        return
    from uuvsim_cosim.orchestrator.running.library import load
    from uuvsim_cosim.orchestrator.shipped.scaffold import class_name, write_scaffold

    if component is None and workspace is None:
        raise InputInvalid("COMPONENT is missing", "the component to take the place of")
    slot = load(system).slot(component or "controller")
    if workspace is not None:
        from uuvsim_cosim.commands.editor.workspace import write_workspace

        if kind != "python" or out != Path():
            raise InputInvalid("--workspace with --as or --out", "a Python component in FOLDER")
        expect_folder(workspace, option="--workspace")
        for path in write_workspace(workspace, system, slot):
            if path.parent.name != "schemas":
                file_line(path, tilde(path))
        line()
        line(f"open it with   code {for_shell(workspace)}")
        line(f"check it with  uuvsim lint {for_shell(workspace)}")
        return
    written = write_scaffold(slot, kind, out)
    for path in written:
        file_line(path, tilde(path))
    first = written[0]
    source, before = f"{for_shell(first)}:{class_name(slot)}", ""
    if kind == "pythonfmu3":
        source, before = f"{class_name(slot)}.fmu", f"pythonfmu3 build -f {for_shell(first)}"
    elif kind == "c":
        source = for_shell(first.with_suffix(".fmu"))
        before = f"python {for_shell(first.with_name('build.py'))}"
    line()
    if before:
        line(f"build it with  {before}")
    line(f"run it with    uuvsim run {quote(system)} --replace {component}={source}")


def _write_for_ros2(folder: Path, system: str) -> None:
    from uuvsim_cosim.commands.editor.ros2_workspace import write_ros2_workspace
    from uuvsim_cosim.orchestrator.plan.flatten import flatten
    from uuvsim_cosim.orchestrator.running.library import load

    expect_folder(folder, option="--ros2-workspace")
    for path in write_ros2_workspace(folder, system, flatten(load(system))):
        file_line(path, tilde(path))
    line()
    line(f"serve it with  uuvsim serve {quote(system)} --ros2 jazzy")
    line(f"build it with  cd {for_shell(folder)} && colcon build, on a machine with ROS 2")
