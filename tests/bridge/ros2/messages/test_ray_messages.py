"""Clouds of points, scans, depth images and DVL pings, from the readings along rays."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bridge.ros2.written import STORE, Rows, plan_of, topics_of_plan, written
from uuvsim_cosim.models.sensors.multibeam_and_camera import beams_of

CLOUD = "sensor_msgs/msg/PointCloud2"
HASH = "RIHS01_77604ba1b113d1a39148d095ac2cb21540de83cff2bbc5443e06e25208afd421"
RANGES_HASH = "RIHS01_f440f02f1adc9535848643a389997562f2672f1a74214c17970e1cf2a832343c"


def points(message: object) -> np.ndarray:
    data = np.asarray(message.data).view("<f4")  # type: ignore[attr-defined]
    return data.reshape(message.height, message.width, 3)  # type: ignore[attr-defined]


def test_a_fan_over_a_flat_bottom_is_a_cloud_at_one_depth_port_first() -> None:
    plan = plan_of(sonar="model:multibeam?beams=5")
    d = beams_of("multibeam", beams=5).directions
    ranges = 4.0 / d[:, 2]
    ranges[1] = 0.0  # no echo
    block = Rows([0.5], sonar__range=[ranges], sonar__valid=[True], sonar__t_sample=[0.4])
    [(at, cloud)] = written(plan, CLOUD, block)
    assert at == 400_000_000
    assert (cloud.header.frame_id, cloud.height, cloud.width) == ("sonar_link", 1, 5)
    assert [(f.name, f.offset, f.datatype) for f in cloud.fields] == [
        ("x", 0, 7), ("y", 4, 7), ("z", 8, 7),
    ]  # fmt: skip
    [row] = points(cloud)
    assert np.isnan(row[1]).all()
    rest = row[[0, 2, 3, 4]]
    assert rest[:, 2] == pytest.approx(-4.0)  # z is up
    assert rest[:, 0] == pytest.approx(0.0)
    assert np.all(np.diff(rest[:, 1]) < 0)  # y is to port
    assert (cloud.is_dense, cloud.point_step, cloud.row_step) == (False, 12, 60)


def test_a_scan_has_the_same_points_as_the_cloud() -> None:
    plan = plan_of(sonar="model:multibeam?beams=7")
    readings = np.linspace(3.0, 9.0, 7)
    block = Rows([0.0], sonar__range=[readings], sonar__valid=[True], sonar__t_sample=[0.0])
    [(_, cloud)] = written(plan, CLOUD, block)
    [(_, scan)] = written(plan, "sensor_msgs/msg/LaserScan", block)
    angles = scan.angle_min + scan.angle_increment * np.arange(7)
    assert angles[-1] == pytest.approx(scan.angle_max)
    assert scan.angle_min == pytest.approx(-scan.angle_max)
    # x of the scan's frame is -z of the link, y of it is -y of the link
    flat = np.stack([0 * angles, -np.sin(angles), -np.cos(angles)], axis=1) * readings[:, None]
    assert points(cloud)[0] == pytest.approx(flat, abs=1e-5)
    assert (scan.range_min, scan.range_max) == pytest.approx((0.5, 175.0))
    assert scan.header.frame_id == "sonar_scan"


def test_a_depth_image_and_its_camera_make_the_points_of_the_cloud() -> None:
    plan = plan_of(camera="model:depth_camera?columns=4&rows=3")
    depths = np.linspace(1.0, 2.0, 12)
    block = Rows([0.2], camera__image=[depths], camera__valid=[True], camera__t_sample=[0.2])
    [(_, image)] = written(plan, "sensor_msgs/msg/Image", block)
    [(_, info)] = written(plan, "sensor_msgs/msg/CameraInfo", block)
    [(_, cloud)] = written(plan, CLOUD, block)
    assert (image.encoding, image.height, image.width, image.step) == ("32FC1", 3, 4, 16)
    assert np.asarray(image.data).view("<f4") == pytest.approx(depths)
    assert image.header.frame_id == info.header.frame_id == "camera_optical"
    fx, _, cx, _, fy, cy, *_ = info.k
    v, u = np.divmod(np.arange(12), 4)
    optical = np.stack([(u - cx) / fx * depths, (v - cy) / fy * depths, depths], axis=1)
    # the optical frame is half a turn about x from the link
    assert points(cloud).reshape(12, 3) == pytest.approx(optical * [1, -1, -1], rel=1e-6)
    assert info.p.reshape(3, 4)[:, :3] == pytest.approx(info.k.reshape(3, 3))


def test_an_image_of_ranges_is_a_cloud_and_no_depth_image() -> None:
    plan = plan_of(camera="model:depth_camera?columns=4&rows=3&reading=range")
    types = {t.type for t in topics_of_plan(plan)}
    assert CLOUD in types
    assert "sensor_msgs/msg/Image" not in types
    block = Rows([0.2], camera__image=[np.full(12, 2.0)], camera__valid=[True],
                 camera__t_sample=[0.2])  # fmt: skip
    [(_, cloud)] = written(plan, CLOUD, block)
    assert np.linalg.norm(points(cloud), axis=-1) == pytest.approx(2.0)


def test_ranges_of_a_sonar_have_the_beams_and_flags_of_those_without_an_echo() -> None:
    plan = plan_of(sonar="model:multibeam?beams=5")
    readings = np.array([3.0, 0.0, 4.0, 5.0, 6.0])
    block = Rows([0.5], sonar__range=[readings], sonar__valid=[True], sonar__t_sample=[0.4])
    [(at, ping)] = written(plan, "marine_acoustic_msgs/msg/SonarRanges", block)
    assert (at, ping.header.frame_id) == (400_000_000, "sonar_sonar")
    beams = np.array([[v.x, v.y, v.z] for v in ping.beam_unit_vec])
    assert np.array_equal(beams, beams_of("multibeam", beams=5).directions)
    assert [flag.flag for flag in ping.flags] == [0, 1, 0, 0, 0]
    assert ping.ranges == pytest.approx([3.0, np.nan, 4.0, 5.0, 6.0], nan_ok=True)
    assert ping.transmit_delays.tolist() == [0.0] * 5
    assert len(ping.intensities) == 0
    info = ping.ping_info
    assert (info.frequency, info.sound_speed) == (0.0, 0.0)  # which means that they are not known
    assert len(info.tx_beamwidths) == len(info.rx_beamwidths) == 0


def dvl_rows(velocity: np.ndarray, d: np.ndarray, valid: list[int]) -> Rows:
    return Rows(
        [0.2], dvl__velocity=[velocity], dvl__altitude=[8.0], dvl__range=[np.full(4, 9.0)],
        dvl__beam_velocity=[d @ velocity], dvl__beam_valid=[valid], dvl__valid=[True],
        dvl__t_sample=[0.2],
    )  # fmt: skip


def test_a_dvl_ping_has_the_velocity_and_the_beams_in_the_dvls_axes() -> None:
    plan = plan_of(dvl="model:dvl")
    tilt, velocity = np.radians(22.5), np.array([1.0, -0.2, 0.1])
    a = np.radians([45, 135, 225, 315])
    d = np.stack([np.sin(tilt) * np.cos(a), np.sin(tilt) * np.sin(a), np.cos(tilt) + 0 * a], axis=1)
    [(_, ping)] = written(plan, "marine_acoustic_msgs/msg/Dvl", dvl_rows(velocity, d, [1, 1, 1, 1]))
    given = np.array([[u.x, u.y, u.z] for u in ping.beam_unit_vec])
    assert given == pytest.approx(d)
    assert given @ [ping.velocity.x, ping.velocity.y, ping.velocity.z] == pytest.approx(
        ping.beam_velocity
    )
    assert (ping.velocity_mode, ping.dvl_type, ping.num_good_beams) == (1, 0, 4)
    assert ping.course_gnd == pytest.approx(np.arctan2(-0.2, 1.0))
    assert ping.speed_gnd == pytest.approx(np.hypot(1.0, 0.2))
    assert ping.header.frame_id == "dvl_sonar"


def test_a_pings_covariance_is_the_closed_form_of_four_beams_and_grows_with_three() -> None:
    system_plan = plan_of(dvl="model:dvl")
    d = np.zeros((4, 3))
    still = dvl_rows(np.zeros(3), d, [1, 1, 1, 1])
    lame = dvl_rows(np.zeros(3), d, [1, 0, 1, 1])
    [(_, four)] = written(system_plan, "marine_acoustic_msgs/msg/Dvl", still)
    [(_, three)] = written(system_plan, "marine_acoustic_msgs/msg/Dvl", lame)
    tilt, sigma = np.radians(22.5), 0.004
    closed = [sigma**2 / (2 * np.sin(tilt) ** 2)] * 2 + [sigma**2 / (4 * np.cos(tilt) ** 2)]
    assert np.diag(four.velocity_covar.reshape(3, 3)) == pytest.approx(closed, rel=1e-6)
    assert np.all(
        np.diag(three.velocity_covar.reshape(3, 3)) > np.diag(four.velocity_covar.reshape(3, 3))
    )
    assert three.num_good_beams == 3
    assert np.isnan(three.range).tolist() == [False, True, False, False]


def test_the_type_of_a_ping_is_that_of_marine_acoustic_msgs() -> None:
    name = "marine_acoustic_msgs/msg/Dvl"
    fields = [field for field, _ in STORE.fielddefs[name][1]]
    assert fields == [
        "header", "velocity_mode", "dvl_type", "velocity", "velocity_covar", "altitude",
        "course_gnd", "speed_gnd", "num_good_beams", "sound_speed", "beam_ranges_valid",
        "beam_velocities_valid", "beam_unit_vec", "range", "range_covar", "beam_quality",
        "beam_velocity", "beam_velocity_covar",
    ]  # fmt: skip
    assert STORE.hash_rihs01(name) == HASH


def test_the_type_of_ranges_is_that_of_marine_acoustic_msgs() -> None:
    name = "marine_acoustic_msgs/msg/SonarRanges"
    fields = [field for field, _ in STORE.fielddefs[name][1]]
    assert fields == [
        "header", "ping_info", "flags", "transmit_delays", "intensities", "beam_unit_vec", "ranges",
    ]  # fmt: skip
    assert STORE.hash_rihs01(name) == RANGES_HASH


def test_without_known_rays_the_readings_stay_numbers() -> None:
    from uuvsim_cosim.bridge.ros2.topics import Variable, topics_of

    [topic] = topics_of({"sonar.range": Variable("f", 512)}, {"sonar": {}})
    assert (topic.name, topic.type) == ("/sonar/range", "std_msgs/msg/Float64MultiArray")
