"""Images and detections of a sonar as messages, from arrays that the tests make."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.bridge.ros2.written import STORE, Rows
from uuvsim_cosim.bridge.ros2.robot import _AHEAD
from uuvsim_cosim.bridge.ros2.topic_writer import TopicWriter
from uuvsim_cosim.bridge.ros2.topics import Topic, Variable, read_topics, topics_of, topics_text
from uuvsim_cosim.errors import InputInvalid

PACKAGE = "marine_acoustic_msgs/msg"
BEARINGS = np.radians([-30.0, -10.0, 10.0, 30.0])
RANGES = np.array([2.5, 3.0, 3.5])
FACTS = {
    "sonar": {
        "@bearings": BEARINGS, "@ranges": RANGES, "@scale": np.ones(4),
        "@beams": np.stack([np.cos(BEARINGS), np.sin(BEARINGS), 0 * BEARINGS], axis=1),
        "@directions": np.stack([np.cos(BEARINGS), np.sin(BEARINGS), 0 * BEARINGS], axis=1),
        "frequency": np.array(900e3), "sound_speed": np.array(1480.0),
    }
}  # fmt: skip
VARIABLES = {
    "sonar.magnitude": Variable("f", 12), "sonar.range": Variable("f", 4),
    "sonar.valid": Variable("b", 0), "sonar.t_sample": Variable("f", 0),
}  # fmt: skip
IMAGE = np.arange(12.0).reshape(4, 3) + 0.5  # beams, bins


def topic(kind: str) -> Topic:
    [found] = [t for t in topics_of(VARIABLES, FACTS) if t.type == f"{PACKAGE}/{kind}"]
    return found


def message(
    kind: str, image: np.ndarray = IMAGE, ranges: tuple[float, ...] = (0, 3, 0, 2.5)
) -> Any:
    block = Rows(
        [0.5], sonar__magnitude=[image.ravel()], sonar__range=[ranges], sonar__valid=[True],
        sonar__t_sample=[0.4],
    )  # fmt: skip
    _, [row] = TopicWriter(topic(kind), STORE, FACTS).messages(block)
    found = STORE.deserialize_cdr(row.tobytes(), f"{PACKAGE}/{kind}")
    assert bytes(STORE.serialize_cdr(found, f"{PACKAGE}/{kind}")) == row.tobytes()
    stamp = found.header.stamp
    assert (stamp.sec, stamp.nanosec, found.header.frame_id) == (0, 400_000_000, "sonar_sonar")
    assert found.ping_info.frequency == 900e3
    assert found.ping_info.sound_speed == 1480.0
    return found


@pytest.mark.parametrize("kind", ["ProjectedSonarImage", "RawSonarImage"])
def test_an_image_has_its_pixels_by_range_and_then_by_beam(kind: str) -> None:
    image = message(kind).image
    assert (image.dtype, image.beam_count, image.is_bigendian) == (8, 4, False)
    pixels = np.asarray(image.data).view("<f4").reshape(3, 4)
    assert np.array_equal(pixels.T, IMAGE.astype("f4"))


def test_a_projected_image_has_the_directions_and_ranges_of_its_axes() -> None:
    found = message("ProjectedSonarImage")
    beams = np.array([[v.x, v.y, v.z] for v in found.beam_directions])
    assert np.arctan2(beams[:, 1], beams[:, 2]) == pytest.approx(BEARINGS)
    assert beams[:, 0].tolist() == [0.0] * 4
    assert np.linalg.norm(beams, axis=1) == pytest.approx(1.0)
    assert found.ranges.tolist() == RANGES.tolist()


def test_the_frame_of_an_image_is_the_one_that_the_messages_demand() -> None:
    x, y, z, w = _AHEAD
    a = np.array([x, y, z])
    turn = 2.0 * np.outer(a, a) - np.eye(3)  # w = 0: half a turn about a
    assert w == 0.0
    up, starboard, ahead = turn.T  # in x ahead, y to port, z up
    assert up == pytest.approx([0, 0, 1])
    assert starboard == pytest.approx([0, -1, 0])
    assert ahead == pytest.approx([1, 0, 0])


def test_a_raw_image_has_the_times_of_its_samples() -> None:
    found = message("RawSonarImage")
    times = (found.sample0 + np.arange(found.samples_per_beam)) / found.sample_rate
    assert times * 1480.0 / 2.0 == pytest.approx(RANGES)
    assert found.rx_angles == pytest.approx(BEARINGS)
    assert found.tx_angles.tolist() == found.tx_delays.tolist() == [0.0] * 4


def test_detections_have_travel_times_and_levels_of_the_strongest_echoes() -> None:
    found = message("SonarDetections")
    assert [flag.flag for flag in found.flags] == [1, 0, 1, 0]
    expected = [np.nan, 2 * 3.0 / 1480.0, np.nan, 2 * 2.5 / 1480.0]
    assert found.two_way_travel_times == pytest.approx(expected, nan_ok=True)
    assert found.intensities == pytest.approx([np.nan, 5.5, np.nan, 11.5], nan_ok=True)
    assert found.rx_angles == pytest.approx(BEARINGS)


FIELDS = {
    "ProjectedSonarImage": ["header", "ping_info", "beam_directions", "ranges", "image"],
    "RawSonarImage": [
        "header", "ping_info", "sample_rate", "samples_per_beam", "sample0", "tx_delays",
        "tx_angles", "rx_angles", "image",
    ],
    "SonarDetections": [
        "header", "ping_info", "flags", "two_way_travel_times", "tx_delays", "intensities",
        "tx_angles", "rx_angles",
    ],
    "SonarImageData": ["is_bigendian", "dtype", "beam_count", "data"],
}  # fmt: skip
HASHES = {
    "ProjectedSonarImage": "e9d0b934ee8332c9f79e04c361de0793c165b2dee14f2c0d25c3227cd50d46f1",
    "RawSonarImage": "668954b8ea9854ec5c25c3ebdbdd9d53452169c7e1e365cad5baf0dc56ac9607",
    "SonarDetections": "2be9466b1dff9d71d6c8e21379e805805a5d315d899023961f183bc32182e60d",
    "SonarImageData": "50fb28a428282c0c372a897399651836892fa13d8d56cb67bfeffac8803e58f7",
}


@pytest.mark.parametrize("kind", FIELDS)
def test_the_types_are_those_of_marine_acoustic_msgs(kind: str) -> None:
    assert [field for field, _ in STORE.fielddefs[f"{PACKAGE}/{kind}"][1]] == FIELDS[kind]
    assert STORE.hash_rihs01(f"{PACKAGE}/{kind}") == f"RIHS01_{HASHES[kind]}"


def test_a_scanning_sonar_has_the_angle_of_each_ping() -> None:
    facts = {"sonar": FACTS["sonar"] | {"@bearings": np.zeros(1), "@beams": np.eye(3)[:1],
                                        "@scale": np.ones(1)}}  # fmt: skip
    del facts["sonar"]["@directions"]
    variables = VARIABLES | {
        "sonar.magnitude": Variable("f", 3), "sonar.range": Variable("f", 1),
        "sonar.bearing": Variable("f", 0),
    }  # fmt: skip
    topics = {t.type.rpartition("/")[2]: t for t in topics_of(variables, facts)}
    assert "PointCloud2" not in topics
    block = Rows(
        [0.1, 0.2], sonar__magnitude=IMAGE[:2], sonar__range=[[3.0], [0.0]],
        sonar__bearing=[-0.4, 0.3], sonar__valid=[True, True], sonar__t_sample=[0.1, 0.2],
    )  # fmt: skip
    for kind in ("RawSonarImage", "SonarDetections", "ProjectedSonarImage"):
        topic_ = topics[kind]
        _, rows = TopicWriter(topic_, STORE, facts).messages(block)
        found = [STORE.deserialize_cdr(row.tobytes(), topic_.type) for row in rows]
        if kind == "ProjectedSonarImage":
            angles = [np.arctan2(m.beam_directions[0].y, m.beam_directions[0].z) for m in found]
        else:
            angles = [m.rx_angles[0] for m in found]
        assert angles == pytest.approx([-0.4, 0.3])


def test_the_strongest_echoes_are_a_cloud_of_points_too() -> None:
    [cloud] = [t for t in topics_of(VARIABLES, FACTS) if t.type == "sensor_msgs/msg/PointCloud2"]
    block = Rows([0.5], sonar__range=[[0, 3, 0, 2.5]], sonar__valid=[True], sonar__t_sample=[0.4])
    _, [row] = TopicWriter(cloud, STORE, FACTS).messages(block)
    found = STORE.deserialize_cdr(row.tobytes(), cloud.type)
    points = np.asarray(found.data).view("<f4").reshape(4, 3)
    assert np.isnan(points[0]).all()
    assert points[3] == pytest.approx(
        [2.5 * np.cos(BEARINGS[3]), -2.5 * np.sin(BEARINGS[3]), 0.0], abs=1e-6
    )


def test_without_known_axes_the_magnitudes_stay_numbers() -> None:
    types = {t.type for t in topics_of(VARIABLES, {"sonar": {}})}
    assert "std_msgs/msg/Float64MultiArray" in types
    assert not any(t.startswith(PACKAGE) for t in types)


def test_a_file_of_topics_with_an_image_of_another_size_is_refused(tmp_path: Any) -> None:
    file = tmp_path / "topics.yaml"
    file.write_text(topics_text([topic("RawSonarImage")]))
    assert read_topics(file, VARIABLES, FACTS) == [topic("RawSonarImage")]
    wrong = VARIABLES | {"sonar.magnitude": Variable("f", 11)}
    with pytest.raises(InputInvalid, match=r"sonar\.magnitude has 11 elements; expected 12"):
        read_topics(file, wrong, FACTS)
