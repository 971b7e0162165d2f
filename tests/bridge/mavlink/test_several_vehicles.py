"""Several vehicles of one system are several systems of MAVLink."""

from __future__ import annotations

import numpy as np

import uuvsim_cosim as uuv
from tests.bridge.mavlink.ground import ME, Ground, mav, piloted
from uuvsim_cosim.bridge.mavlink.link import DEFAULT, Address
from uuvsim_cosim.bridge.mavlink.server import MavlinkServer
from uuvsim_cosim.bridge.mavlink.vehicle import vehicles_of
from uuvsim_cosim.bridge.server.conductor import Conductor

_GUIDED = 4


def test_each_vehicle_has_its_system_id_its_port_and_its_pilot() -> None:
    both = uuv.System("both", "0.01").add("a", piloted()).add("b", piloted())
    with (
        Conductor(both) as conductor,
        MavlinkServer(conductor, "tcpin:127.0.0.1:0") as server,
    ):
        ends = enumerate(server.ends, start=1)
        first, second = (Ground(conductor, end.link.port, vehicle=i) for i, end in ends)
        conductor.ask("run", ME, None, 5.0, ())
        assert [g.wait("HEARTBEAT").get_srcSystem() for g in (first, second)] == [1, 2]
        second.link.mav.command_long_send(1, 1, mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, *[0] * 6)
        second.arm(_GUIDED)
        second.link.mav.set_position_target_local_ned_send(
            0, 2, 1, 1, 0xDF8, 1.0, 0.0, 2.0, 0, 0, 0, 0, 0, 0, 0, 0
        )
        second.wait("LOCAL_POSITION_NED", lambda m: m.x > 0.9)
        eta = conductor.get(ME, ["a.hull.eta", "b.hull.eta"])
        assert np.abs(eta["a.hull.eta"][:2]).max() < 0.05
        assert eta["b.hull.eta"][0] > 0.8
        assert not server.ends[0].services.armed
        assert server.ends[1].services.armed
        for ground in (first, second):
            ground.link.close()


def test_the_default_address_is_that_of_ground_stations_and_ten_higher_for_the_next() -> None:
    addresses = [str(Address.of(DEFAULT).instance(k)) for k in range(3)]
    assert addresses == [f"udpout:127.0.0.1:{port}" for port in (14550, 14560, 14570)]


def test_a_vehicle_beside_a_nested_one_has_its_own_components() -> None:
    with Conductor("pool_tracking") as conductor:
        found = {vehicle.prefix: vehicle.components for vehicle in vehicles_of(conductor)}
    assert set(found) == {"", "quarry."}
    for prefix, components in found.items():
        assert {path.rpartition(".")[0] for path in components.values()} == {prefix.rstrip(".")}
