"""Tables take the width that there is."""

from __future__ import annotations

import pytest

from uuvsim_cosim.commands.shared.terminal import console


@pytest.mark.parametrize("kind", ["dumb", "xterm"])
def test_a_terminal_of_any_kind_is_used_to_its_width(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", kind)
    monkeypatch.setenv("COLUMNS", "120")
    assert console().width == 120
