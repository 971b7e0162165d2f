"""Tables use the available width; a notebook gets plain text."""

from __future__ import annotations

import pytest

from uuvsim_cosim.commands.shared.terminal import console


@pytest.mark.parametrize("kind", ["dumb", "xterm"])
def test_a_terminal_of_any_kind_is_used_to_its_width(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("JPY_PARENT_PID", raising=False)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", kind)
    monkeypatch.setenv("COLUMNS", "120")
    assert console().width == 120


def test_a_command_in_a_notebook_draws_no_bar_and_no_colour(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")  # what ipykernel sets
    monkeypatch.setenv("TERM", "xterm-color")
    monkeypatch.setenv("JPY_PARENT_PID", "1")
    assert not console(stderr=True).is_terminal
    assert console().width == 88
