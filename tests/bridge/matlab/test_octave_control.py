"""A controller designed on what is served, put in the loop from MATLAB's language in lockstep."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.bridge.in_octave import NEEDS_OCTAVE, said
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.fmus.export.fmu_file import FmiVersion, build_many
from uuvsim_cosim.orchestrator.shipped.shipped import bluerov2_hold
from uuvsim_cosim.orchestrator.system.system import System

pytestmark = NEEDS_OCTAVE
CURRENT, STATION = [0.3, 0.2, 0.0], [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]


@pytest.fixture(scope="module")
def held() -> System:
    """Return bluerov2_hold with its own controller, which is told a station instead of a path."""
    return bluerov2_hold().remove("guidance")


@pytest.fixture(scope="module")
def port(held: System) -> Iterator[int]:
    """Serve it without a controller."""
    with Conductor(held.remove("controller")) as conductor, TcpServer(conductor, 0) as endpoint:
        yield endpoint.port


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Build the controller as FMI 2.0 and 3.0."""
    folder = tmp_path_factory.mktemp("fmus")
    versions: tuple[FmiVersion, ...] = (2, 3)
    return [build_many(["controller"], fmi=v, target_dir=folder / str(v))[0] for v in versions]


@pytest.fixture(scope="module")
def figures(port: int) -> dict[str, float]:
    """Return the figures that matlab/tests/control.m prints."""
    return {k: float(v) for k, v in re.findall(r"(\w+) (\S+)", said(f"control({port})"))}


def test_the_design_holds_the_station_better_than_the_baseline(
    held: System, figures: dict[str, float]
) -> None:
    me = Client("test", "local")
    with Conductor(held) as conductor:
        conductor.set(me, {"hull.v_c": np.array(CURRENT), "controller.eta_d": np.array(STATION)})
        path = conductor.run(me, 60.0, None, ["hull.eta"])["hull.eta"]
    distance = np.linalg.norm(path[:, :3] - STATION[:3], axis=1)
    assert figures["rms"] < 0.5 * np.sqrt(np.mean(distance**2))
    assert figures["max"] < 0.5 * distance.max()
    assert figures["final"] < 1e-4


def test_the_linear_model_explains_what_it_was_made_of(figures: dict[str, float]) -> None:
    assert figures["residual"] < 0.01
    assert figures["poles"] < 1.0


def test_the_code_for_simulink_is_the_law_to_the_last_bit(figures: dict[str, float]) -> None:
    assert figures["code"] == 0.0


def test_the_gain_is_that_of_the_closed_form_and_of_the_recursion() -> None:
    assert "gains ok" in said("gains()")


def test_the_ports_of_an_fmu_are_read_with_their_start_values(fmus: list[Path]) -> None:
    for file, expected in zip(fmus, ("2.0 0.02 6", "3.0 0.02 1"), strict=True):
        words = said(
            f"p = uuvsim.read_fmu('{file}'); q = uuvsim.group_elements(p.inputs); "
            "printf('%s %g %d', p.version, p.step, numel(p.outputs)); "
            "for v = q, printf(' %s %d', v.name, numel(v.start)); end"
        )
        assert words == f"{expected} eta_d 6 nu_d 6 eta 6 nu 6"


def test_what_is_no_fmu_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "a.fmu").write_text("no archive")
    for name, expected in (("a.fmu", "expected an FMU"), ("b.fmu", "no such file")):
        words = said(f"try, uuvsim.read_fmu('{tmp_path / name}'), catch e, disp(e.message), end")
        assert expected in words


def test_models_and_the_block_do_what_they_should_with_a_double_of_simulink(
    port: int, fmus: list[Path]
) -> None:
    words = said(f"models('{fmus[0]}', '{fmus[1]}', {port})")
    assert "FAILED" not in words, words
    assert words.count("\nok ") + words.startswith("ok ") == 10, words


def test_what_needs_simulink_says_so_without_it() -> None:
    for call in ("uuvsim.build_simulink('a.fmu')", "build_controller(struct())"):
        words = said(f"try, {call}, catch e, disp(e.message), end")
        assert "Simulink is not installed" in words, words
