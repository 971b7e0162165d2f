"""Parts of every command: the options `--json` and `--quiet`, examples and groups in `--help`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Annotated, Any

import typer

__all__ = ["EXAMPLES", "GROUPS", "complete", "path_of", "walk", "with_implied_values"]


OUTPUT = "Output"
_SYSTEM, _TIME, _INPUTS, _CONNECTIONS = "System", "Time", "Inputs", "Connections"
_TASK, _LENGTH = "Task and policy", "Length and evaluation"
_FMU = {
    _SYSTEM: ("--replace", "--set"),
    "FMU": ("--fmi", "--platform", "--signals", "--inputs", "--names"),
    OUTPUT: ("--out",),
}

# Groups of options in the `--help` of commands that have many.
GROUPS: dict[str, dict[str, tuple[str, ...]]] = {
    "run": {
        _SYSTEM: ("--vehicle", "--set", "--replace", "--map", "--force", "--ardusub", "--px4",
                  "--loops", "--native", "--isolate", "--watchdog", "--grant", "--arm-real",
                  "--unsigned"),
        _TIME: ("--until", "--start", "--rate", "--variable-step", "--events", "--real-time",
                "--overruns"),
        _INPUTS: ("--input", "--waypoints", "--origin", "--scenario", "--seed"),
        OUTPUT: ("--out", "--record-every", "--no-report", "--open", "--view", "--port",
                 "--trace-fmi"),
        "One FMU": ("--step", "--interface"),
    },
    "serve": {
        _SYSTEM: ("--vehicle", "--set", "--replace", "--map", "--force", "--ardusub", "--px4",
                  "--loops", "--fmu", "--seed", "--origin"),
        _TIME: ("--real-time", "--paused", "--until", "--rate", "--fail-safe"),
        _CONNECTIONS: ("--host", "--port", "--tcp-port", "--http-port"),
        "ROS 2": ("--ros2", "--topics", "--ros2-port"),
        "Foxglove": ("--foxglove", "--foxglove-port"),
        "MAVLink": ("--mavlink", "--waypoints", "--arm-real", "--unsigned"),
        "Access": ("--access", "--anyone", "--no-code"),
        OUTPUT: ("--out", "--no-record"),
    },
    "export": {
        OUTPUT: ("--out", "--scene"),
        "ROS 2": ("--ros2", "--topics", "--distribution", "--origin"),
        "Images of a sonar": ("--sonar", "--picture", "--span"),
    },
    "film": {
        "Camera": ("--camera", "--path", "--follow"),
        _TIME: ("--from", "--to", "--speed", "--fps"),
        "Picture": ("--panel", "--water", "--caustics", "--contours", "--plain"),
        OUTPUT: ("--out", "--size"),
    },
    "systems new": {
        "Vehicle": ("--vehicle", "--mission", "--force"),
        "FMUs": ("--from", "--connect", "--step"),
        OUTPUT: ("--out",),
    },
    "terrain": {
        "Area": ("--around", "--size", "--resolution"),
        "Reading": ("--datum", "--unit", "--positive", "--crs", "--local"),
        "Surface": ("--land", "--relief", "--fill"),
        OUTPUT: ("--out",),
    },
    "identify": {
        _SYSTEM: ("--system", "--replace", "--set", "--hull"),
        "Recording": ("--map", "--log-parameters", "--channel",
                      "--from", "--to", "--step"),
        "Fit": ("--parameters", "--inputs", "--delay", "--unknown", "--residuals",
                "--no-proposals"),
        OUTPUT: ("--save-as", "--manoeuvre"),
    },
    "study": {
        _SYSTEM: ("--force", "--loops", "--master"),
        "Execution": ("--jobs", "--restart", "--ray"),
        OUTPUT: ("--out", "--no-report", "--open"),
    },
    "train": {
        _TASK: ("--task-set", "--force", "--curriculum", "--profile"),
        "Algorithm": ("--algo", "--set", "--config", "--seed", "--seeds"),
        _LENGTH: ("--envs", "--steps", "--evaluate-every", "--evaluation-episodes", "--ray"),
        OUTPUT: ("--out", "--restart", "--no-report", "--open"),
    },
    "collect": {
        _TASK: ("--policy", "--task-set", "--episodes", "--seed", "--ray"),
        "Recorded runs": ("--recorded", "--signal"),
        OUTPUT: ("--out", "--overwrite"),
    },
    "play": {
        _TASK: ("--policy", "--task-set", "--other-task", "--seed"),
        OUTPUT: ("--out", "--live", "--window", "--open", "--view", "--port"),
    },
    "models import": {
        "Surface": ("--scale", "--axes", "--turn-inside-out"),
        "Vehicle": ("--mass", "--volume", "--z-g", "--rho", "--added-mass"),
        OUTPUT: ("--out",),
    },
    "fmu system": _FMU,
    "fmu container": {
        group: tuple(option for option in options if option != "--platform")
        for group, options in _FMU.items()
    },
    "fmu client": {**_FMU, _CONNECTIONS: ("--host", "--port")},
}  # fmt: skip

# Examples in the `--help` of each command: command lines without the first `uuvsim`.
EXAMPLES: dict[str, tuple[str, ...]] = {
    "": (
        "run bluerov2_survey",
        "view runs/bluerov2_survey-0",
        "run bluerov2_survey --replace controller=my_controller.fmu --out mine",
        "compare runs/bluerov2_survey-0 mine --tol 1e-6",
        "doctor",
    ),
    "run": (
        "run bluerov2_survey --until '2 min'",
        "run hold --vehicle rexrov --until 60",
        "run bluerov2_survey --replace controller=my_controller.fmu --set controller.gain=2",
        "run bluerov2_survey --waypoints plan.csv --seed 7 --json",
        "run bluerov2_hold --input currents.csv",
        "run bluerov2_hold --input +controller.tau_d[1]:prbs,amplitude=5,hold=0.5,at=10,until=60",
        "run my_controller.fmu --input inputs.csv --until 10 -o outputs.csv",
    ),
    "cite": (
        "cite bluerov2_survey -o sources.bib",
        "cite bluerov2_heavy@wu_2018",
        "cite runs/bluerov2_survey-0",
    ),
    "compare": (
        "compare runs/bluerov2_survey-0 runs/bluerov2_survey-0-2",
        "compare before.parquet after.parquet --tol 1e-9 --json",
    ),
    "serve": (
        "serve bluerov2_hold",
        "serve bluerov2_hold --paused --no-record",
        "serve bluerov2_hold --replace pilot=keyboard --mavlink --waypoints mission.plan",
        "serve bluerov2_survey --foxglove",
        "serve runs/bluerov2_survey-0",
    ),
    "view": ("view", "view runs/bluerov2_survey-0 --port 8090"),
    "film": (
        "film runs/bluerov2_survey-0 -o dive.webp --panel depth,speed",
        "film runs/wreck_inspection-0 -o wreck.webp --camera orbit --speed 4 --panel sonar",
        "film runs/bluerov2_survey-0 -o dive.png --from 30 --camera side:3 --caustics 0.5",
    ),
    "export": (
        "export runs/bluerov2_survey-0 -o run.csv",
        "export runs/bluerov2_survey-0 -o run.mcap --scene",
        "export runs/wreck_inspection-0 -o sonar.webp --picture fan",
        "export bluerov2_hold -o page.html",
    ),
    "verify": (
        "verify bluerov2_hold",
        "verify bluerov2_survey --steps 6000 --set controller.Kp=60,60,80,14,14,6",
    ),
    "report": (
        "report runs/bluerov2_survey-0",
        "report runs/bluerov2_survey-0 -o run.svg",
        "report runs/bluerov2_hold-0 --page",
    ),
    "map": ("map runs/seabed_mapping-0 -o map.tif", "map runs/seabed_mapping-0 -o points.laz"),
    "terrain": (
        "terrain chart.000 --resolution 10 -o seabed.tif",
        "terrain survey.tif --around 47.27,-122.55 --size 3x5 -o my_scene",
    ),
    "study": ("study docs/examples/hold_in_current.yaml", "study study.yaml --jobs 4 -o results"),
    "analyse": (
        "analyse bluerov2_hold --break controller.tau_d",
        "analyse bluerov2_hold --break controller.tau_d[3] --replace controller=lqr --out depth",
    ),
    "identify": ("identify dive.csv --system model:my_rov --parameters D_q_11,M_A_11",),
    "systems": ("systems", "systems show bluerov2_survey -o survey.svg"),
    "systems show": (
        "systems show bluerov2_survey -o survey.svg",
        "systems show bluerov2_hold --plan",
    ),
    "systems missions": ("systems missions", "systems missions bluerov2 my_rov --until 60"),
    "systems new": (
        "systems new my_rov",
        "systems new heavy --vehicle bluerov2_heavy",
        "systems new plant --from tank.fmu controller.fmu",
    ),
    "systems slot": ("systems slot bluerov2_survey controller",),
    "models": ("models", "models show remus100"),
    "models show": ("models show remus100", "models show imu@stim300"),
    "models check": (
        "models check",
        "models check remus100 --source prestero",
        "models check bluerov2_heavy@wu_2018 --against trajectory.csv --tolerance 1e-6",
    ),
    "models picture": ("models picture", "models picture remus100 my_rov -o both.svg"),
    "models mesh": ("models mesh remus100 -o remus100.glb",),
    "models speeds": ("models speeds", "models speeds bluerov2_heavy --voltage 14.8"),
    "models new": ("models new my_rov --shape box",),
    "models import": ("models import hull.stl --mass 11.5 -o my_rov",),
    "fmu": ("fmu build thruster --fmi 2", "fmu check my_controller.fmu"),
    "fmu build": ("fmu build thruster --fmi 2 --platform linux64,win64 -o out",),
    "fmu inspect": ("fmu inspect my_controller.fmu", "fmu inspect my_controller.fmu --json"),
    "fmu check": ("fmu check my_controller.fmu", "fmu check a.fmu b.fmu --junit fmus.xml"),
    "fmu conformance": ("fmu conformance my_fmus", "fmu conformance my_fmus -o table.md"),
    "fmu compare": ("fmu compare before.fmu after.fmu", "fmu compare a.fmu b.fmu --json"),
    "fmu system": ("fmu system bluerov2_hold -o .",),
    "fmu client": ("fmu client bluerov2_hold -o .",),
    "fmu container": ("fmu container plant.ssd -o .", "fmu container plant.ssd --fmi 3"),
    "pack": ("pack bluerov2_survey -o survey.ssp",),
    "new": (
        "new controller",
        "new controller --as c",
        "new --workspace my_project",
        "new --ros2-workspace my_ros2",
    ),
    "lint": ("lint", "lint my_study.yaml", "lint my_project --json"),
    "envs": ("envs",),
    "train": ("train source --algo sac --seed 1", "train source --algo sac --seeds 8"),
    "train-offline": ("train-offline s.npz --algo dt -o dt",),
    "collect": ("collect transition_1 --policy scripted --episodes 400 -o s.npz",),
    "evaluate": ("evaluate source_sac runs/train/source-sac-3 -o figures.csv",),
    "play": (
        "play --policy runs/train/source-sac-3",
        "play transition_1 -o episode.html",
        "play --policy source_sac --live -o page.html",
    ),
    "export-policy": ("export-policy models/policies/source_sac.npz -o policy.fmu",),
    "reproduce": ("reproduce fig7 --no-run",),
    "access": ("access check access.yaml",),
    "access password": ("access password",),
    "access token": ("access token", "access token --port 7449"),
    "access certificates": ("access certificates pki --host 192.168.2.1 --client rov-1",),
    "access check": ("access check access.yaml",),
    "matlab": ("matlab",),
    "doctor": ("doctor", "doctor --json"),
}


def complete(command: Any) -> Any:
    """Add shared options, examples and groups of options to a command and all commands below it."""
    # `answer.mode_of` reads these options before anything is parsed.
    app = typer.Typer(add_completion=False)

    @app.command()
    def options(
        json: Annotated[
            bool,
            typer.Option(
                "--json", expose_value=False, rich_help_panel=OUTPUT,
                help="Write the result to stdout as one JSON object.",
            ),
        ] = False,
        quiet: Annotated[
            bool,
            typer.Option(
                "--quiet", expose_value=False, rich_help_panel=OUTPUT,
                help="Write only warnings and errors, to stderr.",
            ),
        ] = False,
    ) -> None:  # fmt: skip
        """Declare the options that every command has."""

    shared = typer.main.get_command(app).params[:2]
    for path, each in walk(command):
        if path in GROUPS:
            place = {option: name for name, options in GROUPS[path].items() for option in options}
            order = list(place)
            for parameter in each.params:
                if (name := place.get(parameter.opts[0])) is not None:
                    parameter.rich_help_panel = name
            each.params.sort(key=lambda p: order.index(p.opts[0]) if p.opts[0] in place else -1)
        each.params.extend(shared)
        if any("--mavlink" in parameter.opts for parameter in each.params):
            each.parse_args = partial(_parsed, each.parse_args, with_implied_values)
        if path == "systems new":
            each.parse_args = partial(_parsed, each.parse_args, with_several_files)
        if path in EXAMPLES:
            each.epilog = "\n\n".join(("Examples:", *(f"uuvsim {x}" for x in EXAMPLES[path])))
    return command


def _parsed(
    parse: Callable[[Any, list[str]], Any],
    change: Callable[[Sequence[str]], list[str]],
    context: Any,
    arguments: list[str],
) -> Any:
    return parse(context, change(arguments))


def with_several_files(arguments: Sequence[str]) -> list[str]:
    """Return the arguments, with a `--from` before each of several FMUs that follow one.

    Typer has no options with a number of values that the user chooses.
    """
    filled: list[str] = []
    several = False
    for argument in arguments:
        several = several and argument.lower().endswith(".fmu")
        if several and filled[-1] != "--from":
            filled.append("--from")
        filled.append(argument)
        several = several or argument == "--from"
    return filled


def with_implied_values(arguments: Sequence[str]) -> list[str]:
    """Return the arguments, with the default address behind a `--mavlink` that has no value.

    Typer has no options whose value may be left out. An address contains a colon.
    """
    if "--mavlink" not in arguments:
        return list(arguments)
    from uuvsim_cosim.bridge.mavlink.link import DEFAULT

    filled: list[str] = []
    for number, argument in enumerate(arguments):
        filled.append(argument)
        following = arguments[number + 1] if number + 1 < len(arguments) else "-"
        is_value = ":" in following or following.isdigit()
        if argument == "--mavlink" and (following.startswith("-") or not is_value):
            filled.append(DEFAULT)
    return filled


def walk(command: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path of words and the command, for a command and all commands below it."""
    yield path, command
    for name, each in getattr(command, "commands", {}).items():
        yield from walk(each, f"{path} {name}".strip())


def path_of(command: Any, arguments: Sequence[str]) -> str:
    """Return the command that arguments name, such as "uuvsim models show"."""
    words = ["uuvsim"]
    for argument in arguments:
        if argument in getattr(command, "commands", {}):
            command = command.commands[argument]
            words.append(argument)
        elif not argument.startswith("-"):
            break
    return " ".join(words)
