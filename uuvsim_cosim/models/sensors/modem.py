"""Acoustic modems on a shared medium: packets with travel time, loss and collisions.

Node i may send in its slot at a tick of `send`: `x_i` as it is then. A packet lasts D = bits /
bit_rate on the air, begins to arrive at node j after d_ij / c, and is shown, with the time it was
sent, when it has arrived in whole and `processing` has passed. It is lost

* by chance, with probability 1 - (1 - loss)(1 - s), where s goes smoothly from 0 at `range_full`
  to 1 at `range_max`; beyond that nothing is heard and nothing disturbs;
* where another packet arrives at j within the same D, and so is that one (collision);
* where j sends within the same D (half duplex).

`travel_time` is that of the packet, for ranges from clocks that agree: a beacon's. A radio is the
same with c = 3e8 m/s. What `link` says of one sender, a delay and a loss is the special case.
"""

from __future__ import annotations

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.sensors.packets import arrive, medium_of, send

__all__ = ["modem"]

LEAST = {"bit_rate": 1e-3, "c": 1.0}  # what is divided by


def modem(
    id: str = "m64",
    nodes: int | str = 2,
    size: int | str = 3,
    unit: str = "m",
    interval: str = "0.5",
    publish_period: str = "0.05",
    in_flight: int | str = 2,
) -> Model:
    """Declare modems of a preset at `nodes` places, which exchange `size` numbers.

    They may send every `interval` seconds, each with at most `in_flight` packets under way.
    `unit` is one for all numbers, or one for each, with commas between.
    """
    n, k, width = int(nodes), int(in_flight), int(size)
    if not (2 <= n <= 8 and 1 <= k <= 16 and 1 <= width <= 64):
        raise ParameterInvalid(
            "modem",
            f"{n} nodes, {k} packets in flight, {width} numbers",
            "2 to 8 nodes, 1 to 16 packets and 1 to 64 numbers",
        )
    units = tuple(unit.split(",")) if "," in unit else (unit,) * width
    p = preset("sensors", id, "modem")
    m = Model("modem", "Modems that share one medium: delay, loss, half duplex, collisions")
    places = [
        m.input(f"position_{i}", 3, unit="m", description=f"of node {i} in NED")
        for i in range(1, n + 1)
    ]
    wanted = [
        m.input(f"x_{i}", width, unit=units, description=f"what node {i} sends")
        for i in range(1, n + 1)
    ]
    asked = [
        m.input(f"send_{i}", unit="1", start=True, type="Boolean", description="it may send")
        for i in range(1, n + 1)
    ]
    words = {
        "bits": ("1", "of a packet, overhead included"),
        "bit_rate": ("1/s", "on the air"),
        "processing": ("s", "from a packet's last bit until it shows"),
        "c": ("m/s", "speed of sound, or of light"),
        "loss": ("1", "probability that a packet is lost, however near"),
        "range_full": ("m", "up to which no more are lost"),
        "range_max": ("m", "beyond which none is heard"),
        "sigma_time": ("s", "noise of travel_time"),
    }
    bits, rate, processing, c, loss, full, far, sigma = (
        m.parameter(name, p.number(name, u), unit=u, min=LEAST.get(name, 0.0), description=text)
        for name, (u, text) in words.items()
    )
    half = m.parameter(
        "half_duplex", True, unit="1", type="Boolean", description="deaf while it sends"
    )
    slots = m.parameter("slots", n, unit="1", min=1, description="that take turns")
    slot = m.parameter("slot", range(n), unit="1", min=0, description="that each node sends in")
    turns, publish = m.clock("send", interval), m.clock("publish", publish_period)
    medium = medium_of(m, n, k, width, units, m.derived("D", bits / rate))
    send(m, turns, medium, places, wanted, asked, (slots, slot), (c, loss, full, far, half > 0.5))
    arrive(m, publish, medium, width, units, processing, sigma)
    p.complete()
    return m
