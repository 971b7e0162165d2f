"""Rollout of a kernel as a differentiable function of torch tensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.kernels.codegen.program import Program
from uuvsim_cosim.kernels.derivatives.rollout import Rollout, run, vjp

if TYPE_CHECKING:
    import torch

__all__ = ["rollout"]

_Names = tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]  # of start, inputs, outputs


def rollout(
    kernel: Program,
    start: Mapping[str, object],
    outputs: Sequence[str],
    *,
    steps: int,
    inputs: Mapping[str, object] | None = None,
    **more: Any,
) -> dict[str, torch.Tensor]:
    """Return the `outputs` of a `kernel` at the end of each of its `steps`, as torch tensors.

    They are by name, (steps, n_envs, …), float64. `start` are values of parameters and unconnected
    inputs by name, of the variable's shape or one row for each environment; `inputs` are values of
    unconnected inputs that change, (steps, …). Both are tensors of any device and real type, which
    gradients have as well; `more` is n_envs, seeds, threads. Adjoints are compiled only if a
    tensor requires a gradient. Raises InputInvalid for a shape that does not fit, and if torch is
    not installed (extra `rl`).

    Example:

    >>> import torch
    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.kernels import rollout
    >>> kernel = uuv.fuse(uuv.System("tank").add("hull", "model:sphere"))
    >>> tau = torch.tensor([10.0, 0, 0, 0, 0, 0], requires_grad=True)  # N, N.m
    >>> eta = rollout(kernel, {"hull.tau": tau}, ["hull.eta"], steps=100)["hull.eta"]
    >>> eta[-1, 0, 0].backward()  # position N after a second [m]
    >>> f"{tau.grad[0]:.4f} m/N"
    '0.0096 m/N'
    """
    through, torch = _through()
    sequences = {} if inputs is None else dict(inputs)
    names = (tuple(start), tuple(sequences), tuple(outputs))
    tensors = [torch.as_tensor(v) for v in (*start.values(), *sequences.values())]
    found = through.apply(kernel, names, {"steps": steps, **more}, *tensors)
    return dict(zip(outputs, found, strict=True))


@lru_cache
def _through() -> tuple[Any, Any]:
    """Return autograd's function, and torch; at the first call, as its import takes seconds."""
    try:
        import torch
        from torch.autograd.function import once_differentiable
    except ImportError as error:
        raise InputInvalid(
            "derivatives in torch need it", "`pip install 'uuvsim-cosim[rl]'`"
        ) from error

    class Through(torch.autograd.Function):  # type: ignore[misc, unused-ignore]
        """Values forward by the kernel, gradients backward by its adjoints."""

        @staticmethod
        def forward(
            ctx: Any,
            kernel: Program,
            names: _Names,
            options: dict[str, Any],
            *tensors: torch.Tensor,
        ) -> tuple[torch.Tensor, ...]:
            of_start, of_inputs, outputs = names
            arrays = [t.detach().cpu().numpy().astype(np.float64) for t in tensors]
            start = dict(zip(of_start, arrays[: len(of_start)], strict=True))
            inputs = dict(zip(of_inputs, arrays[len(of_start) :], strict=True))
            made = Rollout(kernel, start, outputs, inputs=inputs, **options)
            if any(ctx.needs_input_grad):
                values, ctx.pull = vjp(made)
            else:
                values = run(made)
            ctx.names, ctx.kinds = names, [(t.dtype, t.device) for t in tensors]
            return tuple(torch.from_numpy(values[name]) for name in outputs)

        @staticmethod
        @once_differentiable
        def backward(ctx: Any, *gradients: torch.Tensor | None) -> tuple[object, ...]:
            of_start, of_inputs, outputs = ctx.names
            given = {
                name: g.detach().cpu().numpy()
                for name, g in zip(outputs, gradients, strict=True)
                if g is not None
            }
            found = ctx.pull(given)
            back = [
                torch.from_numpy(found[name]).to(dtype=dtype, device=device)
                if name in found
                else None
                for name, (dtype, device) in zip((*of_start, *of_inputs), ctx.kinds, strict=True)
            ]
            return (None, None, None, *back)

    return Through, torch
