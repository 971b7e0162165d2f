"""A model against a reference trajectory: the greatest deviation of each column.

The file has `#` lines, then a header: t_s, N_m E_m D_m phi_rad theta_rad psi_rad, u_mps v_mps
w_mps p_rps q_rps r_rps, and optionally X_N Y_N Z_N K_Nm M_Nm N_Nm, the generalised force about
CO. The first row is the initial state. Between rows the force is interpolated by `Signal`; with a
`#` line that contains "zero-order hold" (or "zoh"), it is held. The file may also have a current in
n: vc_N_mps vc_E_mps vc_D_mps, held from row to row. With a `#` line that contains "no surface", the
hull is submerged at any depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.checks.compiled_run import rows_of
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import vehicle_folder
from uuvsim_cosim.models.guidance.sampled_signal import Signal

__all__ = ["Deviation", "Reference", "check", "deviations", "group_of", "read_reference"]

Array = NDArray[np.float64]
ETA = ("N_m", "E_m", "D_m", "phi_rad", "theta_rad", "psi_rad")
NU = ("u_mps", "v_mps", "w_mps", "p_rps", "q_rps", "r_rps")
TAU = ("X_N", "Y_N", "Z_N", "K_Nm", "M_Nm", "N_Nm")
CURRENT = ("vc_N_mps", "vc_E_mps", "vc_D_mps")
ANGLES = ("phi_rad", "theta_rad", "psi_rad")


@dataclass(frozen=True)
class Deviation:
    """The greatest deviation of one column, the time [s] at which it is, and the column's size."""

    column: str
    max: float
    t: float
    size: float = 0.0

    @property
    def relative(self) -> float:
        """Return the deviation over the greatest value of its column, 0 where that is 0 as well."""
        return self.max / self.size if self.size else 0.0 if self.max == 0 else float("inf")


@dataclass(frozen=True)
class Reference:
    """A trajectory from elsewhere: times (n,), eta, nu and tau (n, 6), current v_c (n, 3)."""

    t: Array
    eta: Array
    nu: Array
    tau: Array
    v_c: Array
    held: bool
    surface: bool
    notes: tuple[str, ...] = ()


def check(model_id: str, reference_csv: str | Path, h: float = 1e-3) -> list[Deviation]:
    """Return the deviations of a model, such as ``bluerov2_heavy@wu_2018``, from a file."""
    reference = read_reference(Path(reference_csv))
    return deviations(model_id, reference, h)


def deviations(model_id: str, reference: Reference, h: float = 1e-3) -> list[Deviation]:
    """Return the deviations of a hull from a trajectory that is read, by steps of at most h [s].

    Raises ParameterInvalid for a model that is no vehicle.
    """
    vehicle_folder(model_id)  # raises with near names
    model = declare(model_id, **({} if reference.surface else {"surface": False}))
    signals = [Signal(reference.t, column, reference.held) for column in reference.tau.T]
    signals += [Signal(reference.t, column, True) for column in reference.v_c.T]
    result = rows_of(
        model,
        reference.t,
        h,
        lambda t: np.column_stack([signal.at(t) for signal in signals]),
        {"eta_0": reference.eta[0], "nu_0": reference.nu[0]},
    )
    found = []
    for columns, ours, theirs in (
        (ETA, result["eta"], reference.eta),
        (NU, result["nu"], reference.nu),
    ):
        difference = ours - theirs
        for i, name in enumerate(columns):
            column = difference[:, i]
            if name in ANGLES:
                column = np.remainder(column + np.pi, 2 * np.pi) - np.pi
            worst = int(np.argmax(np.abs(column)))
            size = float(np.max(np.abs(theirs[:, i])))
            at = float(reference.t[worst])
            found.append(Deviation(name, float(abs(column[worst])), at, size))
    return found


def group_of(path: Path) -> str:
    """Return whose numbers a file says it holds (`group:` in its `#` lines), else published."""
    notes = " ".join(read_reference(path).notes)
    word = notes.partition("group:")[2].split()
    return word[0].strip(";,.") if word else "published"


def read_reference(path: Path) -> Reference:
    """Read a reference trajectory; raises InputInvalid that names the line."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputInvalid(f"{path}: cannot be read: {error}") from None
    notes = " ".join(line for line in lines if line.startswith("#")).lower()
    body = [(n, x) for n, x in enumerate(lines, 1) if x.strip() and not x.startswith("#")]
    if not body:
        raise InputInvalid(path, "no header", f"t_s,{','.join(ETA + NU)}")
    at, header = body[0]
    names = [name.strip() for name in header.split(",")]
    wanted = ("t_s", *ETA, *NU)
    lacking = [name for name in wanted if name not in names]
    unknown = [name for name in names if name not in (*wanted, *TAU, *CURRENT)]
    if lacking or unknown or len(set(names)) != len(names):
        raise InputInvalid(
            f"{path}:{at}",
            f"columns {', '.join(names)}",
            f"{', '.join(wanted)} and optionally {', '.join((*TAU, *CURRENT))}, each once",
        )
    rows = []
    for line, text in body[1:]:
        parts = text.split(",")
        if len(parts) != len(names):
            raise InputInvalid(f"{path}:{line}", f"{len(parts)} values", len(names))
        row = []
        for name, part in zip(names, parts, strict=True):
            try:
                number = float(part)
            except ValueError:
                number = float("nan")
            if not np.isfinite(number):
                raise InputInvalid(f"{path}:{line}", f"{name} = {part.strip()!r}", "a number")
            row.append(number)
        rows.append(row)
    table = np.array(rows)
    if len(table) < 2 or not np.all(np.diff(table[:, names.index("t_s")]) > 0):
        raise InputInvalid(path, "t_s", "two or more rows at rising times")

    def columns(of: Sequence[str]) -> Array:
        zero = np.zeros(len(table))
        return np.column_stack([table[:, names.index(c)] if c in names else zero for c in of])

    return Reference(
        columns(["t_s"])[:, 0],
        columns(ETA),
        columns(NU),
        columns(TAU),
        columns(CURRENT),
        held="zero-order hold" in notes or "zoh" in notes,
        surface="no surface" not in notes,
        notes=tuple(line.lstrip("# ").rstrip() for line in lines if line.startswith("#")),
    )
