"""Fixes of a GPS, states of joints, and diagnostics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.bridge.ros2.written import Rows, plan_of, topics_of_plan, written
from uuvsim_cosim.bridge.ros2.facts import facts_of
from uuvsim_cosim.bridge.ros2.topics import Variable, omitted_topics, read_topics, topics_of
from uuvsim_cosim.errors import InputInvalid

FIX = "sensor_msgs/msg/NavSatFix"
GPS = {"gps.position": Variable("f", 3), "gps.velocity": Variable("f", 3),
       "gps.sigma": Variable("f", 3), "gps.valid": Variable("b", 0),
       "gps.t_sample": Variable("f", 0)}  # fmt: skip


def gps_rows(time: list[float], valid: list[bool], t_sample: list[float]) -> Rows:
    n = len(time)
    return Rows(time, gps__position=[[111.3, 0.0, -0.25]] * n, gps__sigma=[[1.0, 2.0, 3.0]] * n,
                gps__valid=valid, gps__t_sample=t_sample)  # fmt: skip


def test_a_fix_has_the_place_on_earth_and_the_sensors_variances_in_enu() -> None:
    plan = plan_of(gps="model:gps")
    [(at, fix)] = written(plan, FIX, gps_rows([3.1], [True], [3.0]), origin=(47.0, -122.0))
    assert at == 3_000_000_000
    assert (fix.latitude, fix.longitude) == pytest.approx((47.001, -122.0), abs=1e-5)
    assert fix.altitude == pytest.approx(0.25, abs=1e-3)
    assert np.diag(fix.position_covariance.reshape(3, 3)).tolist() == [4.0, 1.0, 9.0]
    assert (fix.status.status, fix.status.service, fix.position_covariance_type) == (0, 1, 2)
    assert fix.header.frame_id == "gps_link"


def test_under_water_there_is_a_message_without_a_fix_each_second() -> None:
    plan = plan_of(gps="model:gps")
    time = np.arange(0.0, 3.05, 0.1)
    fixed = time > 1.95  # from 2 s on
    sample = np.where(fixed, np.floor(time * 2 + 1e-9) / 2, -1.0)  # two fixes per second
    rows = gps_rows(time.tolist(), fixed.tolist(), sample.tolist())
    found = written(plan, FIX, rows, origin=(47.0, -122.0))
    assert [(at / 1e9, fix.status.status) for at, fix in found] == [
        (0.0, -1), (1.0, -1), (2.0, 0), (2.5, 0), (3.0, 0),
    ]  # fmt: skip
    assert np.isnan(found[0][1].latitude)
    assert found[0][1].position_covariance_type == 0


def test_without_a_place_on_earth_the_reason_is_given() -> None:
    facts = facts_of(plan_of(gps="model:gps"))
    assert FIX not in {t.type for t in topics_of(GPS, facts)}
    [note] = omitted_topics(GPS, facts)
    assert note.startswith(
        "gps: no sensor_msgs/msg/NavSatFix, because the place of the local frame"
    )
    assert "--origin LAT,LON" in note
    assert not omitted_topics(GPS, facts_of(plan_of(gps="model:gps"), (47.0, 8.0)))


def test_a_scene_on_earth_places_the_fix_along_its_grid() -> None:
    plan = plan_of(gps="model:gps", altimeter="model:altimeter?scene=tacoma")
    code, northing, easting = facts_of(plan)["gps"]["@place"]
    assert code == 32610
    [(_, fix)] = written(plan, FIX, gps_rows([1.0], [True], [1.0]))
    from uuvsim_cosim.scene.chart.projection import projection_of

    [(lon, lat)] = projection_of("EPSG:32610").inverse(np.array([[easting, northing + 111.3]]))
    assert (fix.latitude, fix.longitude) == (pytest.approx(lat), pytest.approx(lon))


def test_shafts_and_fins_are_joints_with_speeds_and_angles() -> None:
    plan = plan_of(a="model:thruster_t200", b="model:thruster_t200", fins="model:fins")
    topics = {t.name: t for t in topics_of_plan(plan) if t.type.endswith("JointState")}
    assert dict(topics["/thruster_states"].signals) == {"velocity.a": "a.n", "velocity.b": "b.n"}
    assert dict(topics["/joint_states"].signals) == {"position.fins": "fins.delta"}
    shafts = plan_of(a="model:thruster_t200", b="model:thruster_t200")
    block = Rows([0.0, 0.1], a__n=[1.0, 2.0], b__n=[3.0, 4.0])
    found = written(shafts, "sensor_msgs/msg/JointState", block)
    assert [(m.name, m.velocity.tolist(), m.position.size) for _, m in found] == [
        (["a", "b"], [1.0, 3.0], 0), (["a", "b"], [2.0, 4.0], 0),
    ]  # fmt: skip
    [(_, fins)] = written(plan_of(fins="model:fins"), "sensor_msgs/msg/JointState",
                          Rows([0.0], fins__delta=[[0.1, 0.2, 0.3, 0.4]]))  # fmt: skip
    assert fins.name == ["fins_1", "fins_2", "fins_3", "fins_4"]
    assert fins.position.tolist() == [0.1, 0.2, 0.3, 0.4]


def test_diagnostics_are_sent_each_second_and_when_a_state_changes() -> None:
    plan = plan_of(leak="model:leak")
    time = np.arange(0.0, 2.01, 0.1)
    wet = time > 1.25
    blocks = [
        Rows(time[part].tolist(), leak__valid=np.ones(len(time[part]), bool), leak__leak=wet[part])
        for part in (slice(0, 13), slice(13, None))
    ]
    found = written(plan, "diagnostic_msgs/msg/DiagnosticArray", *blocks)
    assert [at / 1e9 for at, _ in found] == [0.0, 1.0, 1.3, 2.0]
    states = [[(s.name, s.level, s.message) for s in m.status] for _, m in found]
    assert states[1] == [("leak", 0, "valid reading"), ("leak", 0, "no alarm")]
    assert states[2] == [("leak", 0, "valid reading"), ("leak", 2, "alarm")]


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("type: sensor_msgs/msg/NavSatFix, signals: {position: gps.position, sigma: gps.sigma, "
         "valid: gps.valid}", "needs the place of the local frame on Earth, which is not known"),
        ("type: sensor_msgs/msg/PointCloud2, signals: {range: gps.position}",
         "needs the directions of the beams"),
        ("type: sensor_msgs/msg/JointState, signals: {speed.a: gps.t_sample}",
         "expected position.NAME, velocity.NAME"),
        ("type: sensor_msgs/msg/JointState, signals: {velocity.a: gps.t_sample, "
         "position.a: gps.t_sample}", "signals of position and velocity; expected one kind"),
    ],
)  # fmt: skip
def test_a_file_of_topics_that_cannot_be_written_is_refused(
    tmp_path: Path, entry: str, expected: str
) -> None:
    file = tmp_path / "topics.yaml"
    file.write_text(f"topics:\n  - {{topic: /x, {entry}}}\n")
    with pytest.raises(InputInvalid, match=rf"topics.yaml:2: /x: .*{expected}"):
        read_topics(file, GPS, facts_of(plan_of(gps="model:gps")))
