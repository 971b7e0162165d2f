"""What a notebook shows: diagram of a system, report and metrics of a run, figures of a model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.diagram.diagram import diagram

mpl.use("Agg")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> uuv.Run:
    return uuv.run("bluerov2_hold", until=1, out=tmp_path_factory.mktemp("runs") / "hold")


def test_a_system_is_shown_as_its_block_diagram() -> None:
    system = uuv.load("bluerov2_hold")
    assert system._repr_svg_() == diagram(system)


def test_a_run_is_shown_as_its_report(run: uuv.Run) -> None:
    page = run._repr_html_()
    assert page.startswith("<iframe srcdoc=")
    assert (run.folder / "report.html").is_file()
    assert "&quot;" in page  # the page is an attribute's value
    assert page.count("<iframe") == 1


def test_metrics_are_a_mapping_with_units(run: uuv.Run) -> None:
    metrics = run.metrics
    assert set(metrics) == set(metrics.units) == set(metrics.labels)  # type: ignore[attr-defined]
    assert metrics.units["cross_track_rms"] == "m"  # type: ignore[attr-defined]
    assert metrics["cross_track_rms"] >= 0
    assert "<table>" in metrics._repr_html_()  # type: ignore[attr-defined]
    with pytest.raises(InputInvalid, match="cross_track_rms"):
        metrics["cross_trck_rms"]


def test_a_vehicle_is_shown_with_its_balance_and_its_variables() -> None:
    text = uuv.declare("bluerov2_heavy")._repr_html_()
    assert "<td>mass</td><td>13.5 kg</td>" in text
    assert "<code>nu_0[6]</code>" in text
    assert "buoyancy" not in uuv.declare("battery")._repr_html_()


def test_figures_are_those_of_the_models_own_numbers() -> None:
    assert "<td>mass</td><td>11.5 kg</td>" in uuv.declare("bluerov2_heavy@wu_2018")._repr_html_()
    own = uuv.declare("bluerov2_heavy")
    own.variables["m"] = replace(own.variables["m"], start=np.array([20.0]))
    assert "<td>mass</td>" not in own._repr_html_()


def test_texts_are_not_plotted_and_a_label_of_ones_own_is_used() -> None:
    time = np.array([0.0, 1.0])
    values = {"a.text": np.array(["x", "y"], object), "a.y": time}
    signals = uuv.Signals(time, np.arange(2), values, {"a.text": "", "a.y": "m"})
    with pytest.raises(InputInvalid, match=r"a\.text.*is a text.*a signal of numbers"):
        uuv.plot(signals, "a.text")
    assert uuv.plot(signals, "a.y", label="mine").get_lines()[0].get_label() == "mine"


def test_signals_of_one_unit_share_one_axes(run: uuv.Run) -> None:
    signals = run.signals()
    axes = uuv.plot(run, "hull.eta[3]", "hull.eta[1]")
    assert axes.get_ylabel() == "[m]"
    assert axes.get_xlabel() == "time [s]"
    lines = axes.get_lines()
    assert [line.get_label() for line in lines] == ["hull.eta[3]", "hull.eta[1]"]
    assert np.array_equal(lines[0].get_ydata(), signals["hull.eta"][:, 2])
    assert np.array_equal(lines[0].get_xdata(), signals.time)


def test_each_unit_has_its_own_axes(run: uuv.Run) -> None:
    axes = uuv.plot(run.folder, "hull.eta", "thruster_1.thrust")
    assert [a.get_ylabel() for a in axes] == ["[m]", "[rad]", "[N]"]


def test_a_range_of_elements_includes_the_last(run: uuv.Run) -> None:
    axes = uuv.plot(run, "hull.eta[1:3]")
    assert [line.get_label() for line in axes.get_lines()] == [f"hull.eta[{i}]" for i in (1, 2, 3)]


def test_wrong_names_and_mixed_units_are_refused(run: uuv.Run, tmp_path: Path) -> None:
    from matplotlib import pyplot as plt

    with pytest.raises(InputInvalid, match=r"hull\.eta"):
        uuv.plot(run, "hull.etta")
    with pytest.raises(InputInvalid, match=r"hull\.eta\[1\] to hull\.eta\[6\]"):
        uuv.plot(run, "hull.eta[7]")
    with pytest.raises(InputInvalid, match="is a scalar"):
        uuv.plot(run, "thruster_1.thrust[1]")
    with pytest.raises(InputInvalid, match="units m, rad"):
        uuv.plot(run, "hull.eta", ax=plt.subplots()[1])
    with pytest.raises(InputInvalid, match="no signal is named"):
        uuv.plot(run)
