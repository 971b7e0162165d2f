"""uuvsim-cosim: unmanned underwater vehicles as a co-simulation of exchangeable parts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from uuvsim_cosim._version import __version__
from uuvsim_cosim.errors import UuvsimError

if TYPE_CHECKING:
    from uuvsim_cosim.bridge.client import connect
    from uuvsim_cosim.bridge.zenoh_bridge import Bridge
    from uuvsim_cosim.envs.single import CosimEnv
    from uuvsim_cosim.envs.vector import CosimVectorEnv
    from uuvsim_cosim.kernels import fuse
    from uuvsim_cosim.models.library import declare
    from uuvsim_cosim.models.model import Model
    from uuvsim_cosim.models.simulate import simulate
    from uuvsim_cosim.orchestrator.library import available, load
    from uuvsim_cosim.orchestrator.linearize import linearize, trim
    from uuvsim_cosim.orchestrator.master import Master
    from uuvsim_cosim.orchestrator.recording import Signals, read_signals
    from uuvsim_cosim.orchestrator.run import Run, run
    from uuvsim_cosim.orchestrator.system import System
    from uuvsim_cosim.studies import Study, study

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
    "available",
    "connect",
    "declare",
    "fuse",
    "linearize",
    "load",
    "read_signals",
    "run",
    "simulate",
    "study",
    "trim",
]

# Names are imported when first used: `uuvsim --help` must not wait for CasADi or Arrow.
_HOME = {
    "Bridge": "bridge.zenoh_bridge",
    "CosimEnv": "envs.single",
    "CosimVectorEnv": "envs.vector",
    "Master": "orchestrator.master",
    "Model": "models.model",
    "Run": "orchestrator.run",
    "Signals": "orchestrator.recording",
    "Study": "studies",
    "System": "orchestrator.system",
    "available": "orchestrator.library",
    "connect": "bridge.client",
    "declare": "models.library",
    "fuse": "kernels",
    "linearize": "orchestrator.linearize",
    "load": "orchestrator.library",
    "read_signals": "orchestrator.recording",
    "run": "orchestrator.run",
    "simulate": "models.simulate",
    "study": "studies",
    "trim": "orchestrator.linearize",
}


def __dir__() -> list[str]:
    """List the public names, also those not imported yet."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value
