"""`uuvsim export`: a recording as CSV, MATLAB, MCAP or Rerun, or images of its sonar as pictures.

A system is exported as a page that runs.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.commands.shared.completion import of
from uuvsim_cosim.commands.shared.progress import StudyProgress
from uuvsim_cosim.commands.shared.terminal import file_line, line, put, remark
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.modeline import keep_schemas

__all__ = ["export_command"]

KINDS = (".csv", ".mat", ".mcap", ".rrd")
IMAGES = (".png", ".webp", ".npz", ".xtf")  # of a sonar
PAGES = (".html", ".htm")


def export_command(
    run: Annotated[
        Path,
        typer.Argument(
            help="Folder that `uuvsim run` wrote, or a recording; for .html, a system by name, "
            ".ssd or .ssp; for pictures, also an .xtf file."
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            help="File to write: .csv, .mat, .mcap, .rrd (Rerun) or .html (a page); of a sonar: "
            ".png, .webp (animated), .npz (arrays) or .xtf (side-scan).",
        ),
    ],
    scene: Annotated[
        bool, typer.Option("--scene", help="With .mcap: write the 3-D scene as well, for Foxglove.")
    ] = False,
    ros2: Annotated[
        bool,
        typer.Option(
            "--ros2",
            help="Write a rosbag2: one .mcap, a folder (no ending), or its topics as .yaml.",
        ),
    ] = False,
    topics: Annotated[
        Path | None, typer.Option(help="With --ros2: file of topics; default by the signals.")
    ] = None,
    distribution: Annotated[
        str,
        typer.Option(
            autocompletion=of("humble", "jazzy", "kilted", "lyrical", "rolling"),
            help="With --ros2: distribution of ROS 2 whose messages are written.",
        ),
    ] = "jazzy",
    origin: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON", help="With --ros2: place of the local frame's origin, for GPS fixes."
        ),
    ] = None,
    sonar: Annotated[
        str,
        typer.Option(
            metavar="COMPONENT",
            help="With .png, .webp, .npz, .xtf: the sonar, if there are several.",
        ),
    ] = "",
    picture: Annotated[
        str,
        typer.Option(
            autocompletion=of("fan", "polar", "labels", "waterfall"),
            help="With .png, .webp: a fan in metres, a polar picture by beam and range, labels, "
            "or the waterfall of a side-scan sonar.",
        ),
    ] = "",
    span: Annotated[
        float | None,
        typer.Option(metavar="DB", help="With .png, .webp: decibels from black to white (60)."),
    ] = None,
) -> None:
    """Convert a recording for other tools, or write a system as a page that runs in a browser.

    The ending of the file name selects the format.
    """
    kind = out.suffix.lower()
    for option, value in {"--sonar": sonar, "--picture": picture, "--span": span}.items():
        allowed = IMAGES if option == "--sonar" else IMAGES[:2]
        if value not in ("", None) and (ros2 or kind not in allowed):
            raise InputInvalid(f"{option} and {out}", f"a file {', '.join(allowed)}")
    if ros2:
        _export_bag(run, out, topics, distribution, origin, scene=scene)
        return
    for option, given in {"--topics": topics, "--origin": origin}.items():
        if given is not None:
            raise InputInvalid(f"{option} {given}", "--ros2 beside it")
    if kind in PAGES:
        _export_page(str(run), out, scene=scene)
        return
    if kind in IMAGES and not scene:
        _export_images(run, out, sonar, picture, span)
        return
    if kind not in KINDS:
        raise InputInvalid(
            out,
            f"ending {out.suffix!r} was read",
            f"{', '.join(KINDS)}, {', '.join(IMAGES)} of a sonar, or .html of a system",
        )
    if scene and kind != ".mcap":
        raise InputInvalid(f"--scene and {out}: expected a file .mcap; .rrd has the scene anyway")
    with StudyProgress("rows" if kind in (".csv", ".mcap") else "signals") as progress:
        if kind == ".rrd":
            from uuvsim_cosim.view.scene3d.rerun_file import export_rrd

            export_rrd(run, out, progress)
        elif scene:
            from uuvsim_cosim.view.scene3d.foxglove import export_scene_mcap

            export_scene_mcap(run, out, progress)
        else:
            from uuvsim_cosim.orchestrator.recording.export import export

            export(run, out, progress)
    file_line(out)


def _export_images(run: Path, out: Path, sonar: str, picture: str, span: float | None) -> None:
    from uuvsim_cosim.view.sonar.files import write_scans
    from uuvsim_cosim.view.sonar.recorded import scans_of_run
    from uuvsim_cosim.view.sonar.xtf import read_xtf

    scans = read_xtf(run) if run.suffix.lower() == ".xtf" else scans_of_run(run, sonar)
    usual = "waterfall" if scans.is_side_scan else "fan"
    for note in write_scans(scans, out, picture or usual, 60.0 if span is None else span):
        line(note)
    put("sonar", {"component": scans.name, "pings": len(scans)})
    file_line(out)


def _export_page(system: str, out: Path, *, scene: bool) -> None:
    from uuvsim_cosim.orchestrator.running.library import load
    from uuvsim_cosim.view.live_page.live_page import write_live_page

    if scene:
        raise InputInvalid(f"--scene and {out}", "a file .mcap; a page has the scene anyway")
    file_line(write_live_page(load(system), out, source=system))


def _export_bag(
    run: Path, out: Path, topics: Path | None, distribution: str, origin: str | None, *, scene: bool
) -> None:
    from uuvsim_cosim.bridge.ros2.bag import recorded_topics, write_bag
    from uuvsim_cosim.bridge.ros2.topics import topics_text
    from uuvsim_cosim.commands.shared.waypoints import origin_of

    place = None if origin is None else origin_of(origin)
    if scene:
        raise InputInvalid("--scene with --ros2", "one of them")
    if out.suffix.lower() in (".yaml", ".yml"):
        with whole_file(out) as fresh:
            fresh.write_text(topics_text(recorded_topics(run, place)), encoding="utf-8")
        keep_schemas(out)
        file_line(out)
        return
    if out.suffix and out.suffix.lower() != ".mcap":
        raise InputInvalid(
            out, f"ending {out.suffix!r} was read", ".mcap, no ending for a folder, or .yaml"
        )
    with StudyProgress("rows") as progress:
        written, notes = write_bag(run, out, topics, distribution, progress, place)
    for note in notes:
        remark("note", note)
    put("topics", [{"topic": topic.name, "type": topic.type} for topic in written])
    line(f"{len(written)} topics of ROS 2 {distribution}; world ENU, body FLU")
    file_line(out)
