"""uuvsim-cosim: unmanned underwater vehicles as a co-simulation of exchangeable parts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim._version import __version__
from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.lazy import lazy

if TYPE_CHECKING:
    from uuvsim_cosim.bridge.clients.client import connect
    from uuvsim_cosim.bridge.zenoh.bridge import Bridge
    from uuvsim_cosim.envs.single import CosimEnv
    from uuvsim_cosim.envs.vector import CosimVectorEnv
    from uuvsim_cosim.kernels import fuse
    from uuvsim_cosim.models.analysis.simulate import simulate
    from uuvsim_cosim.models.declaration.library import declare
    from uuvsim_cosim.models.declaration.model import Model
    from uuvsim_cosim.orchestrator.master.master import Master
    from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
    from uuvsim_cosim.orchestrator.recording.signals import Signals
    from uuvsim_cosim.orchestrator.running.analysis import (
        analyse,
        dynamics,
        linearize,
        optimal_control,
        trim,
    )
    from uuvsim_cosim.orchestrator.running.library import available, load
    from uuvsim_cosim.orchestrator.running.run import Run, run
    from uuvsim_cosim.orchestrator.shipped.of_vehicle import system_of
    from uuvsim_cosim.orchestrator.system.system import System
    from uuvsim_cosim.studies import Study, study
    from uuvsim_cosim.view.notebook.plot import plot

__all__ = [
    "Bridge",
    "CosimEnv",
    "CosimVectorEnv",
    "Master",
    "Model",
    "Run",
    "Signals",
    "Study",
    "System",
    "UuvsimError",
    "__version__",
    "analyse",
    "available",
    "connect",
    "declare",
    "dynamics",
    "fuse",
    "linearize",
    "load",
    "optimal_control",
    "plot",
    "read_signals",
    "run",
    "simulate",
    "study",
    "system_of",
    "trim",
]

# `uuvsim --help` must not wait for CasADi or Arrow.
__getattr__, __dir__ = lazy(
    __name__,
    {
        "Bridge": "bridge.zenoh.bridge",
        "CosimEnv": "envs.single",
        "CosimVectorEnv": "envs.vector",
        "Master": "orchestrator.master.master",
        "Model": "models.declaration.model",
        "Run": "orchestrator.running.run",
        "Signals": "orchestrator.recording.signals",
        "Study": "studies",
        "System": "orchestrator.system.system",
        "analyse": "orchestrator.running.analysis",
        "available": "orchestrator.running.library",
        "connect": "bridge.clients.client",
        "declare": "models.declaration.library",
        "dynamics": "orchestrator.running.analysis",
        "fuse": "kernels",
        "linearize": "orchestrator.running.analysis",
        "load": "orchestrator.running.library",
        "optimal_control": "orchestrator.running.analysis",
        "plot": "view.notebook.plot",
        "read_signals": "orchestrator.recording.recording_reader",
        "run": "orchestrator.running.run",
        "simulate": "models.analysis.simulate",
        "study": "studies",
        "system_of": "orchestrator.shipped.of_vehicle",
        "trim": "orchestrator.running.analysis",
    },
)
