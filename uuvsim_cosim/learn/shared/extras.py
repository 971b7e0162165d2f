"""Checks that the optional libraries of learning are installed."""

from __future__ import annotations

from uuvsim_cosim.errors import InputInvalid

__all__ = ["check_torch"]


def check_torch() -> None:
    """Raise InputInvalid where torch is not installed."""
    try:
        import torch  # noqa: F401
    except ModuleNotFoundError as error:
        raise InputInvalid(
            f"{error}; learning expects torch: pip install 'uuvsim-cosim[rl]'"
        ) from None
