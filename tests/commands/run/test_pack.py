"""`uuvsim pack`: what it refuses."""

from __future__ import annotations

from pathlib import Path

from tests.conftest import Uuvsim


def test_another_ending_than_ssp_is_refused_before_anything_is_built(uuvsim: Uuvsim) -> None:
    status, _, said = uuvsim("pack", "bluerov2_hold", "-o", "x.zip")
    assert status == 2
    assert "x.zip: ending '.zip' was read; expected .ssp" in said
    assert not Path("x.zip").exists()
