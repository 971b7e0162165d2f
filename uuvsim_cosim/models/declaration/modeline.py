"""Modelines: the first line of a YAML file names its JSON schema, so that editors check the file.

A file of ours names the schema in `models/schema` by a relative path. A file that the program
writes for a user names a copy in the folder `.schema` beside it: a path into the installed package
would differ from machine to machine, and a copied folder would lose its schemas.
"""

from __future__ import annotations

import re
from pathlib import Path

from uuvsim_cosim.content import content

__all__ = ["BY_FILE_NAME", "PATTERNS", "headed", "keep_schemas", "schema_in", "schemas"]

FOLDER = ".schema"
_LINE = re.compile(r"#\s*yaml-language-server:\s*\$schema=\S*?(\w+)\.schema\.json\s*\n")
# A preset's file has the name of the component that reads it.
PRESETS = (
    "altimeter", "color_camera", "compass", "controller", "depth_camera", "dvl", "gps", "guidance",
    "imaging_sonar", "imu", "lbl", "leak", "link", "magnetometer", "modem", "multibeam",
    "multibeam_sonar", "path_following", "pilot", "pressure", "propeller", "scanning_sonar",
    "side_scan_sonar", "thruster", "trajectory", "usbl",
)  # fmt: skip
# Names of the files of each schema: fixed ones, and those that editors and `uuvsim lint` expect.
PATTERNS: dict[str, tuple[str, ...]] = {
    "access": ("access.yaml", "access_*.yaml"),
    "bench": ("bench.yaml",),
    "camera_path": ("*camera_path*.yaml",),
    "checks": ("checks.yaml",),
    "control": ("control.yaml",),
    "curriculum": ("*curriculum*.yaml",),
    "fins": ("fins.yaml",),
    "mapping": ("mapping.yaml",),
    "materials": ("materials.yaml",),
    "preset": tuple(f"{kind}.yaml" for kind in PRESETS),
    "published": ("published.yaml",),
    "recording": ("recording.yaml",),
    "randomisation": ("*randomisation*.yaml",),
    "scenario": ("*scenario*.yaml", "*faults*.yaml"),
    "scene": ("scene.yaml",),
    "shape": ("shape.yaml",),
    "sources": ("sources.yaml",),
    "speeds": ("speeds.yaml",),
    "study": ("*study*.yaml",),
    "thrusters": ("thrusters.yaml",),
    "topics": ("*topics*.yaml",),
    "training": ("*training*.yaml",),
    "vehicle": ("parameters.yaml",),
}
BY_FILE_NAME = {
    name: schema
    for schema, names in PATTERNS.items()
    for name in names
    if "*" not in name and schema != "access"
}


def schemas() -> dict[str, Path]:
    """Return the file of each schema by its name, for example "study"."""
    files = sorted(content("models", "schema").glob("*.schema.json"))
    return {file.name.removesuffix(".schema.json"): file for file in files}


def headed(schema: str, text: str) -> str:
    """Return the text of a YAML file after its modeline, which replaces one that it has."""
    rest = _LINE.sub("", text, count=1)
    return f"# yaml-language-server: $schema={FOLDER}/{schema}.schema.json\n{rest}"


def schema_in(text: str) -> str | None:
    """Return the name of the schema in the modeline of a YAML file; None without a modeline."""
    found = _LINE.search(text)
    return None if found is None else found[1]


def keep_schemas(*files: Path) -> None:
    """Copy the schemas that files name in the folder `.schema` beside them into that folder.

    A modeline with another path, which the user has written, is left as it is.
    """
    for file in files:
        text = file.read_text(encoding="utf-8")
        schema = schemas().get(schema_in(text) or "")
        if schema is not None and f"$schema={FOLDER}/{schema.name}\n" in text:
            (file.parent / FOLDER).mkdir(exist_ok=True)
            (file.parent / FOLDER / schema.name).write_bytes(schema.read_bytes())
