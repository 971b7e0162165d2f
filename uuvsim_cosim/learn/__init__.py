"""Agents that learn in the environments, and policies that leave as components."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uuvsim_cosim.learn.curricula import CURRICULA
    from uuvsim_cosim.learn.curriculum import Curriculum, Promotion, Stage, train_curriculum
    from uuvsim_cosim.learn.policy import Policy

__all__ = ["CURRICULA", "Curriculum", "Policy", "Promotion", "Stage", "train_curriculum"]

_HOME = {
    "CURRICULA": "curricula",
    "Curriculum": "curriculum",
    "Policy": "policy",
    "Promotion": "curriculum",
    "Stage": "curriculum",
    "train_curriculum": "curriculum",
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value
