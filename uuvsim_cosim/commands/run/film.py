"""`uuvsim film`: a run as a film or a picture, drawn without a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.completion import of
from uuvsim_cosim.commands.shared.progress import StudyProgress
from uuvsim_cosim.commands.shared.terminal import file_line, line, put
from uuvsim_cosim.errors import InputInvalid

__all__ = ["film_command"]


def film_command(
    run: Annotated[Path, typer.Argument(help="Run's folder, .parquet or .mcap.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            help="File to write: .webp, .mp4 (by ffmpeg), .png (one frame), or a name without "
            "ending: a folder of .png.",
        ),
    ],
    camera: Annotated[
        str,
        typer.Option(
            autocompletion=of("chase", "orbit", "top", "side", "fixed:0,0,1"),
            help="chase, orbit, top or side, with a distance in m after a colon, or "
            "fixed:N,E,D. [default: chase]",
        ),
    ] = "",
    path: Annotated[
        Path | None, typer.Option(help="YAML file of keyframes, instead of --camera.")
    ] = None,
    follow: Annotated[
        str, typer.Option(metavar="VEHICLE", help="Vehicle to follow; by default the first.")
    ] = "",
    start: Annotated[
        float | None, typer.Option("--from", metavar="S", help="First time of the run to show.")
    ] = None,
    end: Annotated[
        float | None, typer.Option("--to", metavar="S", help="Last time of the run to show.")
    ] = None,
    speed: Annotated[float, typer.Option(help="Seconds of the run in a second of the film.")] = 1.0,
    fps: Annotated[float, typer.Option(help="Frames a second.")] = 20.0,
    size: Annotated[str, typer.Option(metavar="WxH", help="Width and height in pixels.")] = (
        "640x360"
    ),
    panel: Annotated[
        str,
        typer.Option(
            metavar="NAMES",
            help="Panels, with commas between: depth, speed, altitude, a signal, a sonar or a "
            "colour camera.",
        ),
    ] = "",
    water: Annotated[
        str,
        typer.Option(
            autocompletion=of("I", "IA", "IB", "II", "III", "1C", "3C", "5C", "7C", "9C", "none"),
            help="Jerlov type of the water, or none: clear without an end.",
        ),
    ] = "II",
    caustics: Annotated[
        float, typer.Option(help="Strength of the net of light on the ground, 0 to 1.")
    ] = 0.0,
    contours: Annotated[
        bool, typer.Option("--contours", help="Draw lines of equal depth on the seabed.")
    ] = False,
    plain: Annotated[
        bool, typer.Option("--plain", help="Draw no captions, no tracks and no planned path.")
    ] = False,
) -> None:
    """Film a run: vehicles, seabed and water, computed on the processor.

    Ctrl-C ends a film early: the file has the frames so far.
    """
    from uuvsim_cosim.view.film.files import check_target
    from uuvsim_cosim.view.film.film import Film, FilmSettings, write_film

    if camera and path is not None:
        raise InputInvalid(f"--camera {camera} and --path {path}", "one of the two")
    names = tuple(name for name in panel.split(",") if name)
    width, height = _size(size)
    settings = FilmSettings(
        camera or "chase", path, follow, start, end, speed, fps, (width, height), water, caustics,
        contours, not plain, not plain, names,
    )  # fmt: skip
    check_target(out, height, width)
    film = Film(run, settings)
    for note in film.notes:
        line(f"note: {note}")
    with StudyProgress("frames") as progress:
        count = write_film(film, out, progress)
    if film.nearer:
        line(
            f"note: in {film.nearer} of {count} frames the camera came nearer to the vehicle, "
            "because its place was out of the water or behind something"
        )
    put("film", {"frames": count, "seconds": count / fps, "camera_moved": film.nearer})
    line(f"{count} frames of {width} x {height}, {count / fps:.4g} s")
    file_line(out)


def _size(text: str) -> tuple[int, int]:
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise InputInvalid("--size", f"{text!r}", "two whole numbers, such as 640x360") from None
    return width, height
