"""Generate the parts of models/schema that come from tables of the code, and lay the files out.

    python .ci/schemas.py           # writes
    python .ci/schemas.py --check   # exit status 1 if a file would change

Generated are: the parameters of a hull (vehicle, published), the parameters that each component
reads from a preset (preset), and definitions that two schemas share. The rest is written by hand;
tests/models/schema compares it with the code that reads the files.
"""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from copy import deepcopy
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.declaration import hull_parameters as hull
from uuvsim_cosim.models.declaration.library import available, declare
from uuvsim_cosim.models.declaration.preset import Preset

FOLDER = Path(__file__).parents[1] / "models" / "schema"
WIDTH = 120
# What the parameters of presets are, by name.
WORDS = {
    "bandwidth": "bandwidth of the pulse, from which the range resolution c / 2B follows",
    "bins": "number of range bins",
    "depression": "angle of the beams below the horizontal",
    "distortion": "radial distortion of the lens: k1 and k2",
    "elevation": "width of the transmitted beam at half its power, at right angles to the fan",
    "exposure_time": "exposure time of an image",
    "focal_length": "focal length in pixels, in water",
    "frequency": "frequency of the pulse",
    "gain": "grey levels an electron",
    "lamp_angle": "half angle of a lamp's cone",
    "lamp_intensity": "intensity of each lamp in red, green and blue, in W/sr",
    "lamp_positions": "positions of the lamps from CO, in b, one after the other",
    "read_noise": "standard deviation of the noise of reading, in electrons",
    "sensitivity": "electrons per second and W/(m2 sr) of a pixel",
    "source_level": "source level, in dB re 1 uPa at 1 m",
    "noise_level": "noise at the output of a beam, in dB re 1 uPa",
    "step": "angle by which the head turns after each ping",
    "T": "time constant of both servos",
    "V_0": "volume at which the hull has its own buoyancy",
    "V_max": "largest volume",
    "V_min": "least volume",
    "V_rate": "fastest change of volume",
    "g": "acceleration of gravity",
    "m_s": "mass that moves",
    "r_V": "position of the bladder from CO, in b",
    "rho": "density of the water",
    "width": "number of pixels across the image to which the focal length belongs",
    "x_0": "place of the moving mass at which the hull has its own centre of gravity",
    "x_max": "largest distance of the moving mass from x_0",
    "x_rate": "fastest shift of the moving mass",
    "Q_nV": "loss of torque with the speed of advance",
    "Q_nn": "torque at rest: Q_nn |n| n",
    "T_n": "time constant of the shaft",
    "T_nV": "loss of thrust with the speed of advance",
    "T_nn": "thrust at rest: T_nn |n| n",
    "Theta_s": "orientation of the instrument's axes: angles phi, theta, psi from b",
    "V_air": "volume of air in the dry hull",
    "V_probe": "volume of water that wets the probe",
    "acc_bias_instability": "lowest point of the accelerometers' Allan deviation",
    "acc_bias_sigma": "stationary standard deviation of the accelerometers' slowly changing bias",
    "acc_bias_tau": "correlation time of the accelerometers' slowly changing bias",
    "acc_misalignment_sigma": "standard deviation of the accelerometers' misalignment",
    "acc_noise_density": "density of the accelerometers' white noise, in m/s2 per root of Hz",
    "acc_range": "largest acceleration that is measured, either way",
    "acc_scale_sigma": "standard deviation of the accelerometers' scale error",
    "acc_turn_on_sigma": "standard deviation of the accelerometers' bias, drawn at the start",
    "azimuth": "azimuth of each beam",
    "beam_width": "full width of the beam",
    "beams": "number of beams",
    "bias_sigma": "stationary standard deviation of the slowly changing bias",
    "bias_tau": "correlation time of the slowly changing bias",
    "bit_rate": "bit rate on the air",
    "bits": "bits of a packet, overhead included",
    "c": "speed of sound, or of light",
    "c_assumed": "speed of sound that ranges are computed with",
    "clearance": "height above the surface that an antenna needs",
    "declination": "magnetic declination of the place: magnetic north, positive east of true north",
    "dropout": "probability that a sample is lost",
    "eta_P": "shaft power over electric power",
    "fov_horizontal": "horizontal field of view",
    "fov_vertical": "vertical field of view",
    "gyro_bias_instability": "lowest point of the gyros' Allan deviation",
    "gyro_bias_sigma": "stationary standard deviation of the gyros' slowly changing bias",
    "gyro_bias_tau": "correlation time of the gyros' slowly changing bias",
    "gyro_misalignment_sigma": "standard deviation of the gyros' misalignment",
    "gyro_noise_density": "density of the gyros' white noise, in rad/s per root of Hz",
    "gyro_range": "largest rate of turn that is measured, either way",
    "gyro_scale_sigma": "standard deviation of the gyros' scale error",
    "gyro_turn_on_sigma": "standard deviation of the gyros' bias, drawn at the start",
    "hard_iron": "hard-iron error b",
    "incidence_max": "largest angle between a beam and the normal of the bottom",
    "layer": "begin and end of the water layer of water track, below the instrument",
    "loss": "probability that a packet is lost, however near",
    "n_max": "shaft speed at command 1",
    "noise_density": "density of the white noise, in the reading's unit per root of Hz",
    "p_transceiver": "position of the transceiver: N, E, D",
    "period_max": "longest time between two pings",
    "period_min": "shortest time between two pings",
    "pressure_max": "absolute pressure at which the sensor saturates",
    "processing": "time from a packet's last bit until the packet is available",
    "r_s": "position of the instrument from CO, in b",
    "range": "largest reading, either way",
    "range_full": "range up to which no more than the share `loss` of the packets is lost",
    "range_max": "greatest range",
    "range_min": "least range",
    "reacquisition": "time above the surface until the first fix",
    "salinity": "practical salinity of the water",
    "sigma_angle": "noise of both angles",
    "sigma_range": "standard deviation of the constant part of a range's noise",
    "sigma_range_relative": "noise of a range that grows with the range, as a share of it",
    "sigma_time": "noise of the travel time",
    "sigma_v": "noise of a velocity",
    "sigma_v_relative": "noise of a beam's velocity that grows with the velocity, as a share of it",
    "sigma_water": "noise of a beam's velocity in water track",
    "soft_iron": "soft-iron error A",
    "swath": "angle between the outermost beams",
    "t": "thrust deduction",
    "temperature": "temperature of the water",
    "tilt": "angle between a beam and the instrument's axis",
    "turn_on_sigma": "standard deviation of the bias that is drawn at the start",
    "turnaround": "time of each beacon between call and reply",
    "vertical": "error along D over that along N or E",
    "w": "wake fraction",
}
# Units of the parameters that only some presets and options have.
OPTIONAL = {
    "acc_bias_instability": "m/s2",
    "gyro_bias_instability": "rad/s",
    "acc_misalignment_sigma": "rad",
    "gyro_misalignment_sigma": "rad",
    "acc_scale_sigma": "1",
    "gyro_scale_sigma": "1",
    "acc_range": "m/s2",
    "gyro_range": "rad/s",
    "layer": "m",
    "period_max": "s",
    "period_min": "s",
    "sigma_water": "m/s",
    "pressure_max": "Pa",
    "beams": "1",
    "bins": "1",
    "step": "rad",
    "range_max": "m",
    "swath": "rad",
    "fov_horizontal": "rad",
    "fov_vertical": "rad",
}
# (schema, definition): the schema that the definition is copied from.
SHARED = {
    ("curriculum", "settings"): "training",
    ("curriculum", "task_options"): "training",
    ("curriculum", "task"): "training",
    ("randomisation", "distribution"): "study",
    ("randomisation", "set"): "study",
    ("randomisation", "correlation"): "study",
}


def laid_out(value: Any, used: int = 0, indent: int = 0) -> str:
    """Return JSON whose objects and lists stand on one line each where they fit."""
    text = json.dumps(value, ensure_ascii=False)
    if used + len(text) <= WIDTH or not isinstance(value, dict | list) or not value:
        return text
    begin, end = "{}" if isinstance(value, dict) else "[]"
    inner = " " * (indent + 2)
    if isinstance(value, dict):
        rows = []
        for key, entry in value.items():
            head = f"{inner}{json.dumps(key, ensure_ascii=False)}: "
            rows.append(head + laid_out(entry, len(head) + 1, indent + 2))
    else:
        rows = [inner + laid_out(entry, indent + 3, indent + 2) for entry in value]
    return f"{begin}\n" + ",\n".join(rows) + f"\n{' ' * indent}{end}"


def of_unit(unit: str) -> str:
    """Return the end of a description, about the unit."""
    return "No unit." if unit == "1" else f"Unit: {unit}, or one that can be converted to it."


def hull_parameters() -> dict[str, dict[str, dict[str, str]]]:
    """Return `properties` and `patternProperties` of a hull's parameters, by name."""
    properties = {
        name: f"{m.words[0].upper()}{m.words[1:]}. {of_unit(m.unit)}"
        + (f" At least {m.min:g}." if m.min is not None else "")
        for name, m in hull._SCALARS.items()
    }
    patterns: dict[str, str] = {}
    blocks = ("[1-3][1-3]", "[1-3][4-6]", "[4-6][1-3]", "[4-6][4-6]")
    rows = "Row and column are numbered from 1: X Y Z K M N."
    for kind, (units, words) in hull._MATRICES.items():
        for block, unit in zip(blocks, units, strict=True):
            text = f"Element of the matrix of {words}, about CO. {rows} {of_unit(unit)}"
            patterns[f"^{kind}_{block}$"] = text
    for kind, point in (("I_b", "CO"), ("I_g", "CG")):
        text = f"Element of the inertia tensor about {point}. Indices rise. {of_unit('kg.m2')}"
        patterns[f"^{kind}_(1[1-3]|2[23]|33)$"] = text
    by_unit: dict[tuple[str, str], list[str]] = {}
    for forces in ("XYZ", "KMN"):
        for a, b in combinations_with_replacement(hull.VELOCITIES, 2):
            product = hull.product_of(f"{forces[0]}_{a}{b}")
            assert product is not None
            by_unit.setdefault((forces, product.unit), []).append(a + b)
    for (forces, unit), pairs in by_unit.items():
        text = f"SNAME's product of two velocities; it adds to the force. {of_unit(unit)}"
        patterns[f"^[{forces}]_({'|'.join(pairs)})$"] = text
    return {
        "properties": {name: {"description": text} for name, text in properties.items()},
        "patternProperties": {name: {"description": text} for name, text in patterns.items()},
    }


def preset_parameters() -> list[dict[str, Any]]:
    """Return `if kind, then parameters` for each kind of preset whose components refuse others."""
    read: dict[str, dict[str, str]] = {}  # by kind and name: unit
    closed: set[str] = set()
    vector, complete = Preset.vector, Preset.complete

    def noted_vector(self: Preset, name: str, unit: Any, size: int | None = None) -> list[float]:
        units = unit if isinstance(unit, str) else ", ".join(dict.fromkeys(unit))
        read.setdefault(self.path.stem, {})[name] = units
        return vector(self, name, unit, size)

    def noted_complete(self: Preset, optional: Any = ()) -> None:
        complete(self, optional)
        closed.add(self.path.stem)
        for name in sorted(self.asked):
            read.setdefault(self.path.stem, {}).setdefault(name, "")

    Preset.vector, Preset.complete = noted_vector, noted_complete  # type: ignore[method-assign]
    try:
        for name in available():
            with suppress(UuvsimError):  # some need an option
                declare(name)
    finally:
        Preset.vector, Preset.complete = vector, complete  # type: ignore[method-assign]
    rules = []
    for kind in sorted(closed - {"controller"}):  # the controllers share a kind
        properties = {}
        for name, unit in sorted(read[kind].items()):
            text = WORDS[name]
            end = of_unit(unit or OPTIONAL[name])
            if name.endswith("noise_density") and unit == "1":
                end = 'Write "1" as its unit.'
            properties[name] = {"description": f"{text[0].upper()}{text[1:]}. {end}"}
        rules.append({
            "if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]},
            "then": {"properties": {
                "parameters": {"properties": properties, "additionalProperties": False},
            }},
        })  # fmt: skip
    return rules


def generated() -> dict[str, str]:
    """Return the text of each schema, by the name of its file."""
    schemas = {
        path.name.removesuffix(".schema.json"): json.loads(path.read_text(encoding="utf-8"))
        for path in sorted(FOLDER.glob("*.schema.json"))
    }
    names = hull_parameters()
    for schema, place, quantity in (
        ("vehicle", schemas["vehicle"]["$defs"]["set"]["properties"]["parameters"], "quantity"),
        ("published", schemas["published"]["properties"]["parameters"], "quantities"),
    ):
        assert quantity in schemas[schema]["$defs"]
        for group, entries in names.items():
            place[group] = {k: {"$ref": f"#/$defs/{quantity}", **v} for k, v in entries.items()}
        place["additionalProperties"] = False
    schemas["preset"]["allOf"] = preset_parameters()
    for (schema, name), source in SHARED.items():
        schemas[schema]["$defs"][name] = deepcopy(schemas[source]["$defs"][name])
    del schemas["randomisation"]["$defs"]["distribution"]["properties"]["grid"]
    return {f"{name}.schema.json": laid_out(schema) + "\n" for name, schema in schemas.items()}


def main() -> None:
    """Write the files that would change, or name them."""
    changed = [
        name
        for name, text in generated().items()
        if (FOLDER / name).read_text(encoding="utf-8") != text
    ]
    if "--check" in sys.argv:
        sys.exit(f"not as generated: {', '.join(changed)}" if changed else 0)
    for name, text in generated().items():
        (FOLDER / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
