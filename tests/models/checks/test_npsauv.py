"""NPS AUV beside what `models check npsauv` compares: astern, at rest, and files with mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.checks.npsauv import control, force_of_hull, mss_force
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.vehicles.closed_forms import total_mass

L, RHO = 5.3, 1025.0
NU = np.array([1.2, -0.3, 0.4, 0.1, -0.2, 0.3])


def test_astern_it_is_damped_where_the_printed_products_drive_it() -> None:
    model = declare("npsauv", surface=False)
    astern = np.array([-1.0, 0.2, 0, 0, 0, 0])
    assert force_of_hull(model, total_mass(model), astern)[1] < 0 < mss_force(astern)[1]


def test_at_its_steady_speed_the_propeller_adds_nothing_to_the_planes() -> None:
    steady = np.array([1.5, 0.1, 0.05, 0.02, 0.03, -0.01])
    fast = control(steady, [0.0, 0.0, 0.0, 0.0, 1.5 / 0.012 * 30 / np.pi])
    np.testing.assert_allclose(fast, [0.5 * RHO * L**2 * 0.00385 * 2.25, 0, 0, 0, 0, 0], atol=1e-6)


def test_without_flow_the_planes_as_printed_are_finite() -> None:
    act = [0.2, 0.2, 0.2, 0.2, 1500.0]
    assert np.all(np.isfinite(control(np.zeros(6), act)))
    assert np.all(np.isfinite(control(-NU, [*act[:4], -1500.0])))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('of: [u, u, "rudders"]', 'of: [u, "rudders"]', "two velocities"),
        ('of: [u, r, "rudders"]', 'of: [u, r, "ruders"]', "rudders, stern planes"),
        (
            'unit: "N.s2/m2", source: "Healey and Lienard (1993): Ydr',
            'unit: N, source: "Ydr',
            "Ydr",
        ),
    ],
)
def test_a_mistake_in_a_control_derivative_is_named_with_its_line(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    for name in ("parameters", "fins", "control"):
        text = content("models", "vehicles", "npsauv", f"{name}.yaml").read_text()
        (tmp_path / f"{name}.yaml").write_text(text.replace(old, new))
    with pytest.raises(InputInvalid, match=rf"control\.yaml:\d+: .*{message}"):
        declare("fins", vehicle=str(tmp_path), form="derivatives")


def test_a_vehicle_without_control_derivatives_is_refused_by_name() -> None:
    with pytest.raises(InputInvalid, match=r"remus100.*control\.yaml"):
        declare("fins", vehicle="remus100", form="derivatives")
