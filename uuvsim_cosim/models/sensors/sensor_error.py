"""The error of a sensor: white noise, a bias that wanders (Gauss-Markov), a turn-on bias.

With sample period T, in the exact discretisation, so that statistics do not depend on T:

    e_k     = b_on + b_k + N / sqrt(T) w_k          N: noise density
    b_{k+1} = phi b_k + sigma sqrt(1 - phi²) v_k    phi = exp(-T / tau)

b_on (deviation `turn_on_sigma`) and b_0 (deviation sigma) are drawn at the first tick.
A random-walk density B [unit/s/sqrt(Hz)] of the same process is  sigma = B sqrt(tau / 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.preset import Preset

__all__ = ["ErrorParameters", "random_walk_sigma", "sensor_error", "uniform"]


@dataclass(frozen=True)
class ErrorParameters:
    """Figures of one error; the unit is that of the reading."""

    noise_density: float  # [unit/sqrt(Hz)]
    bias_sigma: float  # stationary deviation of the wandering bias [unit]
    bias_tau: float  # its correlation time [s]
    turn_on_sigma: float  # deviation of the constant drawn at start [unit]

    @classmethod
    def of(cls, p: Preset, unit: str, noise_unit: str | None = None) -> ErrorParameters:
        """Read the figures of a preset; the noise is per sqrt(Hz), in `unit` unless stated."""
        return cls(
            p.number("noise_density", noise_unit or unit),
            p.number("bias_sigma", unit),
            p.number("bias_tau", "s"),
            p.number("turn_on_sigma", unit),
        )


def random_walk_sigma(density: float, tau: float) -> float:
    """Return the stationary deviation of a Gauss-Markov bias driven with this density."""
    return float(density * (tau / 2.0) ** 0.5)


def sensor_error(
    m: Model,
    clock: Clock,
    name: str,
    p: ErrorParameters,
    size: int,
    unit: str,
    wander: Clock | None = None,
) -> ca.SX:
    """Declare an error of `size` independent axes; return its value at a tick of the clock.

    If the clock `wander` is given, the bias changes at its ticks. It is slower than `clock` and
    declared before it, so that a fast sensor need not draw a bias for every reading.
    """
    drawn = clock if wander is None else wander
    T, T_w = float(clock.period), float(drawn.period)
    prefix = f"{name}_" if name else ""
    N = m.parameter(
        f"{prefix}noise_density",
        p.noise_density,
        unit="1",
        min=0,
        description=f"white noise [{unit}/sqrt(Hz)]",
    )
    sigma = m.parameter(
        f"{prefix}bias_sigma",
        p.bias_sigma,
        unit=unit,
        min=0,
        description="stationary deviation of the wandering bias",
    )
    tau = m.parameter(
        f"{prefix}bias_tau", p.bias_tau, unit="s", min=1e-6, description="its correlation time"
    )
    turn_on = m.parameter(
        f"{prefix}turn_on_sigma",
        p.turn_on_sigma,
        unit=unit,
        min=0,
        description="deviation of the bias drawn at start",
    )
    phi = m.derived(f"{prefix}phi", ca.exp(-T_w / tau))
    drive = m.derived(f"{prefix}drive", sigma * ca.sqrt(1.0 - ca.exp(-2.0 * T_w / tau)))
    white = m.derived(f"{prefix}white", N / T**0.5)

    shape: tuple[int, ...] = () if size == 1 else (size,)
    started = m.discrete(f"{prefix}started", unit="1", description="0 before the first sample")
    bias = m.discrete(f"{prefix}bias", 0.0, shape, unit=unit)
    constant = m.discrete(f"{prefix}bias_on", 0.0, shape, unit=unit)
    w = m.normal(drawn, 2 * size)
    running = started > 0.5
    constant_new = ca.if_else(running, constant, turn_on * w[:size])
    v = w[size:]
    bias_new = ca.if_else(running, phi * bias + drive * v, sigma * v)
    m.update(drawn, started, 1.0)
    m.update(drawn, constant, constant_new)
    m.update(drawn, bias, bias_new)
    noise = white * m.normal(clock, size)
    if wander is None:
        return constant_new + bias_new + noise
    return constant + bias + noise


def uniform(m: Model, clock: Clock, size: int = 1) -> ca.SX:
    """Return `size` draws, uniform on (0, 1]:  exp(-(w_1² + w_2²) / 2)  of two standard normals."""
    w = m.normal(clock, 2 * size)
    return ca.exp(-0.5 * (w[:size] ** 2 + w[size:] ** 2))
