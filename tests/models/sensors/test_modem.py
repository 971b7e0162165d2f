"""Modems: packets take their time, and meet each other as the geometry says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.sensors.link import link
from uuvsim_cosim.models.sensors.modem import modem

STEP = 0.05
CLEAN = {
    "bits": 100.0,
    "bit_rate": 1000.0,  # a packet of 0.1 s
    "processing": 0.0,
    "c": 1500.0,
    "loss": 0.0,
    "range_full": 1e4,
    "range_max": 2e4,
    "sigma_time": 0.0,
}


def talk(lanes: Any, steps: int, n: int = 1, options: Any = None, **inputs: Any) -> Any:
    """Step modems at the places given; node i sends (k, i, 0) at step k. Gives lanes."""
    parameters = {k: inputs.pop(k) for k in list(inputs) if k in CLEAN or k.startswith("slot")}
    m = modem(**({"interval": "0.5"} | (options or {})))
    run = lanes(m, n, parameters=CLEAN | {"half_duplex": 1.0} | parameters)
    nodes = sum(v.name.startswith("position_") for v in m.of_kind("input"))
    rows = []
    for k in range(steps):
        x = {f"x_{i}": [k, i, 0] for i in range(1, nodes + 1)}
        run.step(k * STEP, STEP, **x, **inputs)
        rows.append({name: run[name].copy() for name in _outputs(m)})
    return rows, run


def _outputs(m: Any) -> list[str]:
    return [v.name for v in m.of_kind("output")]


def test_a_packet_shows_after_its_way_its_length_and_the_processing(lanes: Any) -> None:
    rows, run = talk(lanes, 12, position_2=[300.0, 0, 0], processing=0.1)  # 0.2 + 0.1 + 0.1 s
    shown = [bool(row["valid_2"][0]) for row in rows]
    assert shown.index(True) == 8
    assert list(run["y_2"]) == [0, 1, 0]
    assert (run["from_2"], run["t_sample_2"]) == (1.0, 0.0)
    assert run["travel_time_2"] == pytest.approx([0.2], abs=1e-12)


def test_nodes_take_turns(lanes: Any) -> None:
    _, run = talk(lanes, 60, position_2=[30.0, 0, 0])
    assert run["received_2"] == 3.0  # of 0, 1, 2 s
    assert run["received_1"] == 3.0  # of 0.5, 1.5, 2.5 s
    assert run["t_sample_1"] == 2.5
    assert run["lost_1"] == run["lost_2"] == 0.0


def test_bit_rate_bounds_how_often_packets_go_out(lanes: Any) -> None:
    """A packet of 0.8 s, and a turn every 0.5 s: every other turn finds the sender busy."""
    alone: Any = {"slots": 1.0, "slot": [0, 5], "bits": 800.0}
    _, run = talk(lanes, 100, position_2=[30.0, 0, 0], **alone)
    assert run["received_2"] == 5.0  # of 0, 1, 2, 3, 4 s


def test_two_that_send_at_once_do_not_hear_each_other_unless_the_way_is_long(lanes: Any) -> None:
    both: Any = {"slots": 1.0, "slot": [0, 0]}
    _, run = talk(lanes, 40, position_2=[30.0, 0, 0], **both)
    assert run["received_1"] == run["received_2"] == 0.0
    assert run["lost_1"] > 0
    _, run = talk(lanes, 40, position_2=[300.0, 0, 0], **both)  # 0.2 s of way: after the sending
    assert run["received_1"] > 0
    assert run["lost_1"] == 0.0


def test_full_duplex_hears_while_it_sends(lanes: Any) -> None:
    m = modem(interval="0.5")
    run = lanes(m, parameters=CLEAN | {"half_duplex": 0.0, "slots": 1.0, "slot": [0, 0]})
    for k in range(40):
        run.step(k * STEP, STEP, position_2=[30.0, 0, 0])
    assert run["received_1"] == run["received_2"] == 4.0


def test_packets_that_arrive_together_are_both_lost(lanes: Any) -> None:
    at: Any = {"position_2": [0, 300.0, 0], "position_3": [300.0, 0, 0]}
    three: Any = {"options": {"nodes": 3}, "slots": 1.0}
    _, run = talk(lanes, 40, slot=[5, 0, 0], **at, **three)
    assert run["received_1"] == 0.0
    assert run["lost_1"] == 8.0  # two in each of four turns
    assert run["received_2"] > 0  # 424 m apart, they hear each other


def test_packets_sent_together_from_different_distances_arrive_one_by_one(lanes: Any) -> None:
    at: Any = {"position_2": [0, 300.0, 0], "position_3": [600.0, 0, 0]}
    _, run = talk(lanes, 40, options={"nodes": 3}, slots=1.0, slot=[5, 0, 0], **at)
    assert run["lost_1"] == 0.0
    assert run["received_1"] == 7.0  # the eighth is under way


def test_packets_sent_at_different_turns_can_collide_too(lanes: Any) -> None:
    """One from 750 m sent a turn of 0.5 s earlier meets one from nearby."""
    at: Any = {"position_2": [0, 750.0, 0], "position_3": [30.0, 0, 0]}
    late: Any = {"options": {"nodes": 3}, "slots": 2.0, "slot": [5, 0, 1]}
    _, run = talk(lanes, 30, **at, **late)
    assert run["received_1"] == 0.0
    assert run["lost_1"] >= 2.0


def test_loss_grows_with_range(lanes: Any) -> None:
    fading = {"range_full": 100.0, "range_max": 300.0, "loss": 0.1}
    for distance, kept in ((50.0, 0.9), (200.0, 0.45), (310.0, 0.0)):
        _, run = talk(lanes, 10, 3000, position_2=[distance, 0, 0], **fading)
        assert np.mean(run["received_2"]) == pytest.approx(kept, abs=0.04)


def test_who_must_not_send_stays_silent(lanes: Any) -> None:
    _, run = talk(lanes, 40, position_2=[30.0, 0, 0], send_1=0.0)
    assert run["received_2"] == 0.0
    assert run["received_1"] > 0


def test_a_beacons_travel_time_gives_its_range(lanes: Any) -> None:
    run = lanes(modem("pinger", publish_period="0.01"), 2000, parameters={"loss": 0.0})
    for k in range(45):
        run.step(k * 0.01, 0.01, position_2=[0, 450.0, 0])
    reach = 1500.0 * run["travel_time_2"]
    assert np.mean(reach) == pytest.approx(450.0, abs=0.02)
    assert np.std(reach) == pytest.approx(0.15, rel=0.06)


def test_the_pools_radio_shows_what_a_link_of_its_delay_shows(lanes: Any) -> None:
    """`link` is the special case of one sender that is always heard."""
    options: Any = {"interval": "0.1", "publish_period": "0.1", "in_flight": 6}
    radio = lanes(modem("pool_radio", **options), parameters={"slots": 1.0, "slot": [0, 5]})
    plain = lanes(link(period="0.1"), parameters={"delay": 0.4})
    for k in range(40):
        x = [k, 2 * k, -k]
        radio.step(0.1 * k, 0.1, x_1=x, position_2=[3.0, 0, 0])
        plain.step(0.1 * k, 0.1, x=x)
        if k >= 5:
            np.testing.assert_array_equal(radio["y_2"], plain["y"])
            np.testing.assert_allclose(radio["t_sample_2"], plain["t_sample"], atol=1e-12)


def test_too_many_nodes_and_packets_are_refused() -> None:
    with pytest.raises(ParameterInvalid, match="9 nodes"):
        modem(nodes=9)
    with pytest.raises(ParameterInvalid, match="0 packets"):
        modem(in_flight=0)


@pytest.mark.parametrize("seed", range(3))
def test_what_arrives_is_what_a_list_of_events_says(lanes: Any, seed: int) -> None:
    """Four nodes anywhere, turns that clash: against all packets, compared pair by pair."""
    rng, n, ticks = np.random.default_rng(seed), 4, 12
    reach, D, interval = 500.0, 0.15, 0.25
    m = modem(nodes=n, interval="0.25", publish_period="0.01", in_flight=4)
    place = rng.uniform(0.0, 400.0, (60, n, 3))  # of each lane
    slot = rng.integers(0, 3, (60, n))
    given = CLEAN | {"bits": 1000.0 * D, "range_full": 1e3, "range_max": reach, "half_duplex": 1.0}
    run = lanes(m, 60, parameters=given | {"slots": 3.0, "slot": slot.T.astype(float)})
    where = {f"position_{i + 1}": place[:, i].T for i in range(n)}
    for k in range(int(100 * (ticks * interval + 1.0))):
        quiet = {f"send_{i + 1}": float(k < 100 * (ticks - 0.5) * interval) for i in range(n)}
        run.step(0.01 * k, 0.01, **where, **quiet)
    counts = np.zeros(2)
    for lane in range(60):
        sent = [(i, k * interval) for k in range(ticks) for i in range(n) if slot[lane, i] == k % 3]
        for j in range(n):
            way = np.linalg.norm(place[lane] - place[lane, j], axis=1)
            heard = [(i, t + way[i] / 1500.0) for i, t in sent if i != j and way[i] < reach]
            own = [t for i, t in sent if i == j]
            clear = [
                (i, a)
                for i, a in heard
                if not any(abs(a - b) < D for other, b in heard if other != i)
                and not any(abs(a - t) < D for t in own)
            ]
            assert run[f"received_{j + 1}"][0, lane] == len(clear)
            assert run[f"lost_{j + 1}"][0, lane] == len(heard) - len(clear)
            counts += len(clear), len(heard)
    assert 0.2 < counts[0] / counts[1] < 0.8  # enough of both


def test_a_node_out_of_range_makes_no_room_for_packets_under_way(lanes: Any) -> None:
    """As many packets as a sender keeps are under way to node 2; node 3 hears none of them."""
    first: Any = {"slots": 1.0, "position_2": [9000.0, 0, 0]}  # 6 s of way, a turn every 0.5 s
    two, _ = talk(lanes, 300, slot=[0, 5], **first)
    three, run = talk(
        lanes, 300, options={"nodes": 3}, slot=[0, 5, 5], position_3=[5e4, 0, 0], **first
    )
    for name in ("valid_2", "t_sample_2", "received_2", "y_2"):
        np.testing.assert_array_equal([r[name] for r in three], [r[name] for r in two])
    assert run["received_2"] > 0.0
    assert run["received_3"] == 0.0
