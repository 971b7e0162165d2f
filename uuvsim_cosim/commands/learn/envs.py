"""`uuvsim envs`: list the environments that ship."""

from __future__ import annotations

from importlib import import_module
from inspect import getdoc

from uuvsim_cosim.commands.shared.terminal import line, table

__all__ = ["envs_command"]


def envs_command() -> None:
    """List the Gymnasium environments that ship, with the task of each."""
    from uuvsim_cosim.envs.registration import SHIPPED

    rows = []
    for id, target in SHIPPED.items():
        module, _, name = target.partition(":")
        text = getdoc(getattr(import_module(module), name)) or ""
        rows.append((id, " ".join(text.split("\n\n")[0].split())))
    table(("id", "task"), rows, key="environments")
    line()
    line(f'gymnasium.make("uuvsim_cosim.envs:{rows[0][0]}")')
