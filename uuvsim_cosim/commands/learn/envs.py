"""`uuvsim envs`: list the environments that ship."""

from __future__ import annotations

from uuvsim_cosim.commands.shared.terminal import line, table

__all__ = ["envs_command"]


def envs_command() -> None:
    """List the Gymnasium environments that ship, with the task of each."""
    from uuvsim_cosim.commands.shared.listings import listed_environments

    rows = listed_environments("")
    table(("id", "task"), rows, key="environments")
    line()
    line(f'gymnasium.make("uuvsim_cosim.envs:{rows[0][0]}")')
