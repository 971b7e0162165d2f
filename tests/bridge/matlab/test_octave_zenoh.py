"""The MEX client on Zenoh, compiled with a zenoh-pico that UUVSIM_ZENOH_PICO names, in Octave.

zenoh-pico is not part of this repository; docs/connections/connect_matlab.md says how it is built,
and that these tests run only where it is named.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from tests.bridge.in_octave import NEEDS_OCTAVE, octave, said

ZENOH_PICO = os.environ.get("UUVSIM_ZENOH_PICO")
pytestmark = [
    *NEEDS_OCTAVE,
    pytest.mark.skipif(
        ZENOH_PICO is None,
        reason="UUVSIM_ZENOH_PICO names no installed zenoh-pico; the MEX client was neither "
        "compiled nor run (docs/connections/connect_matlab.md)",
    ),
]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile the client."""
    folder = tmp_path_factory.mktemp("mex")
    words = said(f"build_zenoh('{ZENOH_PICO}', '{folder}')")
    assert "warning" not in words, words
    return folder


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """Serve one hull."""
    hull = uuv.System("hull_alone", "0.01").add("hull", "model:bluerov2_heavy")
    with uuv.Bridge(hull, port=0, anyone=True) as bridge:  # it cannot show a token
        yield bridge.port


def test_the_zenoh_clients_own_suite_passes_in_octave(compiled: Path, port: int) -> None:
    words = said(f"addpath('{compiled}'); zenoh_suite({port})")
    assert "FAILED" not in words, words
    assert "8 of 8 passed" in words, words


def test_it_holds_the_barrier_with_python(compiled: Path, port: int) -> None:
    count = 100
    with uuv.connect(port=port) as owner:
        owner.reset()
    with (
        uuv.connect(port=port, lockstep=True, lag=60) as peer,
        octave(
            f"addpath('{compiled}'); z = uuvsim.Zenoh('port', {port}, 'lockstep', true, "
            f"'lag', 60, 'timeout', 60); for k = 1:{count}, "
            "nu = z.step(1, {'hull.tau', [0 0 0 0 0 1]}, {'hull.nu'}); end; "
            "printf('%d %.17g', z.tick, nu(6)); z.close();"
        ) as process,
    ):
        while len(peer.describe()["clients"]) < 2:
            assert process.poll() is None, process.communicate()[0]
        for _ in range(count):
            nu = peer.step(1, {}, ["hull.nu"])["hull.nu"]
        words, _ = process.communicate()
    assert words.split() == [str(count), f"{nu[5]:.17g}"], words


def test_a_path_without_zenoh_pico_is_refused_in_words(tmp_path: Path) -> None:
    words = said(f"try, build_zenoh('{tmp_path}'), catch e, disp(e.message), end")
    assert "libzenohpico.a" in words
