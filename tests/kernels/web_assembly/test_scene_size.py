"""Systems whose scenes are too large for a page are refused with an estimate."""

from __future__ import annotations

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import SystemInvalid
from uuvsim_cosim.kernels.web_assembly import scene_size
from uuvsim_cosim.kernels.web_assembly.module import web_assembly
from uuvsim_cosim.kernels.web_assembly.scene_size import scene_bytes


def test_the_estimate_is_close_to_what_a_scene_adds_to_the_module() -> None:
    tank = uuv.System("tank").add("hull", "model:sphere")
    source = "model:altimeter?scene=hills"
    sizes = [
        web_assembly(tank.add("sonar", s)).module.stat().st_size
        for s in (source, "model:altimeter")
    ]
    estimate, words = scene_bytes(source)
    assert estimate == pytest.approx(sizes[0] - sizes[1], rel=0.3)
    assert "10,201 nodes" in words


def test_scenes_that_are_too_large_are_refused_with_the_estimate_and_what_is_right(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(scene_size, "MOST_BYTES", 1e6)
    with pytest.raises(SystemInvalid) as caught:
        web_assembly(uuv.load("seabed_mapping"))
    text = str(caught.value)
    assert "model:dvl?scene=tacoma: the scene tacoma of 91,204 nodes" in text
    assert "takes about 0.486 MB" in text
    assert (
        "expected at most 1 MB for all scenes of a page: a terrain of 1.4 times the spacing" in text
    )
    assert "--resolution METRES" in text
