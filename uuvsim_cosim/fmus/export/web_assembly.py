"""An FMU's binary for WebAssembly: a component of the layered standard FMI-LS-WASM.

The module inside the component also exports the functions of FMI's C interface, which a host may
call directly; this package does.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

from uuvsim_cosim.cache import cache_dir, content_hash, intact, keep
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ToolchainError
from uuvsim_cosim.fmus.codegen.toolchain import compile_web_assembly, generated_sources
from uuvsim_cosim.fmus.export.component_binary import component_of
from uuvsim_cosim.fmus.export.component_interface import CO_SIMULATION, MODEL_EXCHANGE
from uuvsim_cosim.fmus.export.model_description import xml_text

__all__ = ["MANIFEST", "component_file", "manifest"]

MANIFEST = "extra/org.modelica.fmi-ls-wasm/manifest.xml"
_STANDARD = "0.1.0"  # of the layered standard: a working draft without a release
_MACROS = {"CO_SIMULATION": CO_SIMULATION, "MODEL_EXCHANGE": MODEL_EXCHANGE}
_KINDS = {"CoSimulation": CO_SIMULATION, "ModelExchange": MODEL_EXCHANGE}
# Uses of the C library by the functions of WASI that it calls for them.
_USES = {
    "print or open files": ("fd_", "path_"),
    "read the clock": ("clock_",),
    "call exit() or the system": ("proc_", "poll_", "random_", "sched_", "sock_", "args_", "env"),
}


def component_file(
    sources: Sequence[Path], *, name: str, description: Element, include: Sequence[Path],
    flags: Sequence[str] = (),
) -> Path:  # fmt: skip
    """Compile C sources with FMI 3.0's functions into a component; return its path in the cache.

    `description` is the root of modelDescription.xml. Raises ToolchainError, also without wasmtime,
    whose assembler encodes the component.
    """
    interfaces = [i for tag, i in _KINDS.items() if description.find(tag) is not None]
    (header,) = generated_sources({"component_sizes.h": _sizes(description)})
    kinds = [f"-D{name}={int(i in interfaces)}" for name, i in _MACROS.items()]
    module = compile_web_assembly(
        [*sources, content("fmus", "sandbox", "component.c")],
        name=name,
        include=[header.parent, content("fmus", "sandbox"), *include],
        flags=["-rdynamic", "-Wl,-z,stack-size=1048576", *kinds, *flags],
    )
    data = module.read_bytes()
    missing = sorted(set(re.findall(rb"\x16wasi_snapshot_preview1.([a-z_]+)", data)))
    if missing:
        needed = [m.decode() for m in missing]
        uses = [what for what, starts in _USES.items() if any(n.startswith(starts) for n in needed)]
        raise ToolchainError(
            name, f"its sources {' and '.join(uses)} (WASI's {', '.join(needed)})",
            "sources that do not, because a component may only compute; "
            "`uuvsim run --isolate wasm` runs these sources as they are",
        )  # fmt: skip
    made = cache_dir("compiled", content_hash(["component", *kinds, data])) / f"{name}.wasm"
    if not intact(made):
        try:
            keep(made, component_of(data, interfaces))
        except ImportError:
            raise ToolchainError(
                "platform wasm32", "the package 'wasmtime' is missing",
                "it with `pip install 'uuvsim-cosim[sandbox]'`",
            ) from None  # fmt: skip
    return made


def manifest() -> str:
    """Return the file that says which layered standard the FMU follows."""
    prefix = "fmi-ls:fmi-ls"
    return xml_text(
        Element(
            "fmiLayeredStandardManifest",
            {
                "xmlns:fmi-ls": "http://fmi-standard.org/fmi-ls-manifest",
                f"{prefix}-name": "org.modelica.fmi-ls-wasm",
                f"{prefix}-version": _STANDARD,
                f"{prefix}-description": "FMI Layered Standard for WebAssembly",
            },
        )
    )


def _sizes(root: Element) -> str:
    """Return C with the number of values of each value reference."""
    found: dict[int, int] = {}
    for variable in root.iterfind("ModelVariables/*"):
        size = math.prod(int(d.get("start", "1")) for d in variable.iterfind("Dimension"))
        found[int(variable.get("valueReference", "0"))] = size
    rows = ", ".join(f"{{{reference}u, {size}u}}" for reference, size in sorted(found.items()))
    return (
        f"enum {{ N_REFERENCES = {len(found)} }};\n"
        f"static const unsigned sizes[N_REFERENCES][2] = {{{rows}}};\n"
    )
