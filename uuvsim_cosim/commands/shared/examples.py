"""Examples in the `--help` of each command: whole command lines without the first `uuvsim`."""

from __future__ import annotations

__all__ = ["EXAMPLES"]

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
        "run bluerov2_survey --replace controller=my_controller.fmu --set controller.gain=2",
        "run bluerov2_survey --waypoints plan.csv --seed 7 --json",
        "run bluerov2_hold --input currents.csv",
        "run bluerov2_hold --input +controller.tau_d[1]:prbs,amplitude=5,hold=0.5,at=10,until=60",
        "run my_controller.fmu --input inputs.csv --until 10 -o outputs.csv",
    ),
    "compare": (
        "compare runs/bluerov2_survey-0 runs/bluerov2_survey-0-2",
        "compare before.parquet after.parquet --tol 1e-9 --json",
    ),
    "serve": (
        "serve bluerov2_hold",
        "serve bluerov2_hold --paused --no-record",
        "serve runs/bluerov2_survey-0",
    ),
    "view": ("view", "view runs/bluerov2_survey-0 --port 8090"),
    "export": (
        "export runs/bluerov2_survey-0 -o run.csv",
        "export runs/bluerov2_survey-0 -o run.mcap --scene",
    ),
    "report": ("report runs/bluerov2_survey-0", "report runs/bluerov2_survey-0 -o run.svg"),
    "map": ("map runs/seabed_mapping-0 -o map.tif", "map runs/seabed_mapping-0 -o points.laz"),
    "terrain": (
        "terrain chart.000 --resolution 10 -o seabed.tif",
        "terrain survey.tif --around 47.27,-122.55 --size 3x5 -o my_scene",
    ),
    "study": ("study docs/examples/hold_in_current.yaml", "study study.yaml --jobs 4 -o results"),
    "identify": ("identify dive.csv --system model:my_rov --parameters D_q_11,M_A_11",),
    "systems": ("systems", "systems show bluerov2_survey -o survey.svg"),
    "systems show": (
        "systems show bluerov2_survey -o survey.svg",
        "systems show bluerov2_hold --plan",
    ),
    "systems slot": ("systems slot bluerov2_survey controller",),
    "models": ("models", "models show remus100"),
    "models show": ("models show remus100", "models show imu@stim300"),
    "models check": (
        "models check",
        "models check remus100 --source prestero",
        "models check bluerov2_heavy@wu_2018 --against trajectory.csv --tolerance 1e-6",
    ),
    "models new": ("models new my_rov --shape box",),
    "models import": ("models import hull.stl --mass 11.5 -o my_rov",),
    "fmu": ("fmu build thruster --fmi 2", "fmu check my_controller.fmu"),
    "fmu build": ("fmu build thruster --fmi 2 --platform linux64,win64 -o out",),
    "fmu inspect": ("fmu inspect my_controller.fmu", "fmu inspect my_controller.fmu --json"),
    "fmu check": ("fmu check my_controller.fmu",),
    "fmu system": ("fmu system bluerov2_hold -o .",),
    "fmu client": ("fmu client bluerov2_hold -o .",),
    "pack": ("pack bluerov2_survey -o survey.ssp",),
    "new": ("new controller", "new controller --as c"),
    "envs": ("envs",),
    "train": ("train source --algo sac --seed 1", "train source --algo sac --seeds 8"),
    "train-offline": ("train-offline s.npz --algo dt -o dt",),
    "collect": ("collect transition_1 --policy scripted --episodes 400 -o s.npz",),
    "evaluate": ("evaluate source_sac runs/train/source-sac-3 -o figures.csv",),
    "play": ("play --policy runs/train/source-sac-3", "play transition_1 -o episode.html"),
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
