"""Imports inside functions: each is listed here, with its reason."""

import ast
from pathlib import Path

import uuvsim_cosim

ROOT = Path(uuvsim_cosim.__file__).parent
PACKAGES = ("models", "fmus", "kernels")

# Module (without uuvsim_cosim) -> package that a function of it imports -> reason: "extra" (it
# may not be installed), "start-up" (it takes long to import, and few commands need it), "POSIX"
# (other systems lack it) or "order" (it is imported after the process was restricted).
DEFERRED = {
    "fmus.check.check_fmu": {"fmpy": "start-up"},
    "fmus.codegen.toolchain": {"importlib": "start-up"},
    "fmus.export.component_binary": {"wasmtime": "extra"},
    "fmus.isolation.confined_child": {
        "uuvsim_cosim.fmus.isolation": "order",
        "uuvsim_cosim.fmus.isolation.confinement": "order",
    },
    "fmus.isolation.confinement": {
        "resource": "POSIX",
        "uuvsim_cosim.cache": "start-up",
        "uuvsim_cosim.content": "start-up",
    },
    "fmus.isolation.isolated": {
        "fcntl": "POSIX",
        "uuvsim_cosim.fmus.isolation.refusals": "POSIX",
    },
    "fmus.model_exchange.solver": {"fmpy": "start-up", "scipy": "start-up"},
    "fmus.sandbox.component_library": {"wasmtime": "extra"},
    "fmus.sandbox.engine": {"importlib": "start-up", "wasmtime": "extra"},
    "fmus.sandbox.host": {"wasmtime": "extra"},
    "fmus.sandbox.library": {"wasmtime": "extra"},
    "kernels.derivatives.autograd": {"torch": "extra"},
    "models.acoustics.target_strength": {"scipy": "start-up"},
    "models.analysis.linearize": {"control": "start-up"},
    "models.analysis.trim": {"scipy": "start-up"},
    "models.checks.comparison": {"ruamel": "start-up"},
    "models.control.fin_design": {"scipy": "start-up"},
    "models.control.lqr": {"control": "start-up"},
    "models.control.vehicle_design": {"control": "start-up", "scipy": "start-up"},
    "models.declaration.parameter_files": {
        "jsonschema": "start-up",
        "ruamel": "start-up",
        "uuvsim_cosim.models.declaration.inertia": "start-up",  # CasADi
    },
    "models.guidance.sampled_signal": {"scipy": "start-up"},
    "models.importing.import_description": {"ruamel": "start-up"},
    "models.importing.import_mesh": {"scipy": "start-up"},
    "models.importing.panel_method": {"capytaine": "extra", "scipy": "start-up"},
    "models.importing.xacro": {"lxml": "start-up"},
    "models.shapes.ellipsoid": {"scipy": "start-up"},
    "models.shapes.mesh": {"trimesh": "extra"},
    "models.shapes.panels": {"scipy": "start-up"},
    "models.vehicles.top_speeds": {"scipy": "start-up"},
    "models.vehicles.vehicle_figures": {"scipy": "start-up"},
    "models.water.current_file": {"scipy": "start-up"},
    "models.water.netcdf": {"netCDF4": "extra", "scipy": "start-up"},
}


def imported_in_functions(path: Path) -> set[str]:
    """Return the packages that functions of a file import; of this project, whole modules."""
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    found = set()
    for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        for node in ast.walk(function) if isinstance(function, functions) else ():
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or "."]
            found |= {n if n.startswith("uuvsim_cosim") else n.partition(".")[0] for n in names}
    return found


def test_functions_import_only_what_is_listed() -> None:
    found = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            if names := imported_in_functions(path):
                found[".".join(path.relative_to(ROOT).with_suffix("").parts)] = names
    assert found == {module: set(names) for module, names in DEFERRED.items()}
    assert {r for names in DEFERRED.values() for r in names.values()} == {
        "extra", "start-up", "POSIX", "order",
    }  # fmt: skip
