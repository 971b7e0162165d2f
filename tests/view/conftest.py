"""A made-up survey, so that the page can be tried without running a simulation."""

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.view.recorded.traces import Traces, joined

WAYPOINTS = [[0, 0, 4], [40, 0, 4], [40, 8, 4], [0, 8, 4], [0, 16, 4], [40, 16, 4], [40, 24, 4],
             [0, 24, 4]]  # fmt: skip


def made_up_survey(samples: int = 6000) -> Traces:
    """Fly along the waypoints with smooth wobbles; noise by a fixed generator."""
    random = np.random.default_rng(3)
    way = np.array(WAYPOINTS, dtype=float)
    lengths = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(way[:, :2], axis=0).T))])
    time = np.linspace(0, 420, samples)
    along = np.minimum(0.5 * time, lengths[-1])
    wanted = np.column_stack([np.interp(along, lengths, way[:, i]) for i in range(3)])

    def smooth(scale, span):
        return (
            scale
            * np.convolve(
                random.standard_normal(samples + span), np.hanning(span) / np.sqrt(span), "same"
            )[:samples]
        )

    heading = np.interp(
        along, lengths[:-1] + 1, np.pi / 180 * np.array([0, 90, 180, 90, 0, 90, 180])
    )
    true = wanted + np.column_stack([smooth(0.08, 200), smooth(0.08, 200), smooth(0.03, 150)])
    true[:, 2] = 4 - 4 * np.exp(-time / 12) + smooth(0.02, 100)
    tilt = np.column_stack([smooth(0.01, 60), smooth(0.015, 60)])
    eta = np.column_stack([true, tilt, heading + smooth(0.02, 80)])
    sigma = np.column_stack(
        [np.full(samples, 0.25), np.full(samples, 0.25), np.full(samples, 0.04)]
        + [np.full(samples, 0.008)] * 2 + [np.full(samples, 0.02)]
    ) * (1 + np.exp(-time / 20))[:, None]  # fmt: skip
    hat = eta + 0.5 * sigma * np.column_stack([smooth(1.0, 300) for _ in range(6)])
    angle = 0.7 + 0.8 * np.sin(time / 120)
    v_c = 0.25 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    vectors = {
        "hull.eta": eta, "navigation.eta": hat, "navigation.sigma": sigma, "current.v_c": v_c,
        "hull.nu": np.gradient(eta, time, axis=0),
        "guidance.eta_d": np.column_stack([wanted, 0 * tilt, heading]),
        "controller.tau_d": np.column_stack([smooth(20, 40) for _ in range(6)]),
    }  # fmt: skip
    columns = {f"{k}[{i + 1}]": v[:, i] for k, v in vectors.items() for i in range(v.shape[1])}
    for number in range(1, 9):
        columns[f"thruster_{number}.thrust"] = smooth(14, 50) + (6 if number < 5 else -4)
    columns["battery.voltage"] = 16.4 - time / 900 + smooth(0.02, 30)
    columns["wrench.current_total"] = 6 + np.abs(smooth(2, 50))
    return Traces(time, joined(columns), {"hull.eta": "m"})


@pytest.fixture(scope="session")
def survey() -> Traces:
    return made_up_survey()


@pytest.fixture
def provenance() -> dict[str, Any]:
    return {
        "system": "bluerov2_survey", "version": "0.1.0", "seed": 7, "waypoints": WAYPOINTS,
        "until": 420.0, "tick": 0.01, "real_time_factor": 62.0, "backend": "fmu",
        "changes": {"set": {"current.speed": 0.25}},
        "components": [{"path": "hull", "kind": "FMI 3.0", "source": "model:hull", "step": 0.01}],
        "notes": ["controller.tau_d: no unit declared, taken as N"],
    }  # fmt: skip
