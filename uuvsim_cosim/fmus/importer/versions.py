"""The class of instances for each version of FMI."""

from __future__ import annotations

from collections.abc import Mapping

from uuvsim_cosim.fmus.importer.fmu1 import Fmu1
from uuvsim_cosim.fmus.importer.fmu2 import Fmu2
from uuvsim_cosim.fmus.importer.fmu3 import Fmu3
from uuvsim_cosim.fmus.importer.read_description import FmuArchive

__all__ = ["AnyFmu", "version_of"]

AnyFmu = Fmu1 | Fmu2 | Fmu3
_VERSIONS: Mapping[str, type[Fmu1] | type[Fmu2] | type[Fmu3]] = {
    "FMI 1.0": Fmu1,
    "FMI 2.0": Fmu2,
    "FMI 3.0": Fmu3,
}


def version_of(archive: FmuArchive) -> type[Fmu1] | type[Fmu2] | type[Fmu3]:
    """Return the class for an FMU's version."""
    return _VERSIONS[archive.description.kind]
