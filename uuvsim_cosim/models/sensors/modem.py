"""Acoustic modems on a shared medium: packets with travel time, loss and collisions.

Node i may send its present `x_i` in its slot at a tick of `send`. A packet has the duration
D = bits / bit_rate and starts to arrive at node j after d_ij / c. It appears at the output, with
the time at which it was sent, `processing` seconds after its last bit. It is lost

* at random, with probability 1 - (1 - loss)(1 - s), where s rises smoothly from 0 at `range_full`
  to 1 at `range_max`; beyond `range_max`, a packet is neither received nor does it interfere;
* if another packet arrives at j within the same D; that packet is lost too (collision);
* if j sends within the same D (half duplex).

`travel_time` is that of the packet; with synchronised clocks, as for a beacon, it gives a range. A
radio is the same model with c = 3e8 m/s. `link` is the special case of one sender with a delay and
a loss.

The fate of a packet is computed when it is sent: the arrival time of its first bit at each node,
and whether it overlaps there with another packet or with a transmission of the receiver. Two
packets overlap if their first bits are less than D apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import norm, smoothstep
from uuvsim_cosim.models.declaration.sampled import BEFORE_FIRST
from uuvsim_cosim.models.sensors.sensor_error import uniform

__all__ = ["modem"]

LEAST = {"bit_rate": 1e-3, "c": 1.0}  # what is divided by
LATE = 1e-6  # s: instants nearer than this are one
GOOD, SPOILED = 1.0, 2.0


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
        p.parameter(m, name, u, text, min=LEAST.get(name, 0.0)) for name, (u, text) in words.items()
    )
    half = m.parameter(
        "half_duplex", True, unit="1", type="Boolean", description="deaf while it sends"
    )
    slots = m.parameter("slots", n, unit="1", min=1, description="that take turns")
    slot = m.parameter("slot", range(n), unit="1", min=0, description="that each node sends in")
    turns, publish = m.clock("send", interval), m.clock("publish", publish_period)
    duration = m.derived("D", bits / rate)
    paths = [(i, a, j) for i in range(n) for a in range(k) for j in range(n) if i != j]
    packets = [(i, a) for i in range(n) for a in range(k)]
    status = m.discrete("status", 0.0, len(paths), unit="1", description="of each path")
    arrival = m.discrete("arrival", 0.0, len(paths), unit="s", description="of its first bit")
    payload = {
        (i, a): m.discrete(f"payload_{i + 1}_{a + 1}", 0.0, width, unit=units) for i, a in packets
    }
    sent = m.discrete("sent", -1e9, len(packets), unit="s", description="of each packet")
    medium = _Medium(
        n,
        k,
        duration,
        {path: status[at] for at, path in enumerate(paths)},
        {path: arrival[at] for at, path in enumerate(paths)},
        payload,
        {packet: sent[at] for at, packet in enumerate(packets)},
    )
    _send(m, turns, medium, places, wanted, asked, (slots, slot), (c, loss, full, far, half > 0.5))
    _arrive(m, publish, medium, units, processing, sigma)
    p.complete()
    return m


@dataclass(frozen=True)
class _Medium:
    """The symbols that sending and arriving share; a path is (sender, packet, receiver)."""

    nodes: int
    packets: int  # that each sender can have under way
    duration: ca.SX
    status: dict[tuple[int, int, int], ca.SX]  # of a path: 0 nothing, 1 will arrive, 2 will not
    arrival: dict[tuple[int, int, int], ca.SX]  # when its first bit is there
    payload: dict[tuple[int, int], ca.SX]
    sent: dict[tuple[int, int], ca.SX]


def _send(
    m: Model,
    clock: Clock,
    medium: _Medium,
    places: list[ca.SX],
    wanted: list[ca.SX],
    asked: list[ca.SX],
    turn: tuple[ca.SX, ca.SX],
    physics: tuple[ca.SX, ...],
) -> None:
    """Put packets on the air at a tick, and settle which of them will arrive."""
    n, D = medium.nodes, medium.duration
    slots, slot = turn
    c, loss, full, far, half = physics
    tick = m.discrete("tick", unit="1", description="ticks of `send` so far")
    m.update(clock, tick, tick + 1.0)
    now = tick - slots * ca.floor((tick + 0.5) / slots)
    sends = []
    for i in range(n):
        idle = m.t >= medium.sent[i, 0] + D - LATE
        oldest = [medium.status[i, medium.packets - 1, j] for j in range(n) if j != i]
        room = ca.sum1(ca.vertcat(*oldest)) < 0.5
        mine = ca.logic_and(asked[i] > 0.5, ca.fabs(now - slot[i]) < 0.5)
        sends.append(ca.logic_and(mine, ca.logic_and(idle, room)))

    pairs = [(i, j) for i in range(n) for j in range(n) if i != j]
    chance = uniform(m, clock, n * (n - 1))
    start, audible, begun = {}, {}, {}
    for at, (i, j) in enumerate(pairs):
        d = norm(places[i] - places[j])
        fading = smoothstep((d - full) / ca.if_else(far > full, far - full, 1e-9))
        kept = chance[at] > 1.0 - (1.0 - loss) * (1.0 - fading)
        start[i, j] = m.t + d / c
        audible[i, j] = ca.logic_and(sends[i], d < far)
        begun[i, j] = ca.if_else(kept, GOOD, SPOILED)

    def meets(a: ca.SX, b: ca.SX) -> ca.SX:
        return ca.fabs(a - b) < D - LATE

    spoiled = {pair: ca.SX(0) for pair in pairs}  # of the new packets
    old = dict(medium.status)
    for i, j in pairs:
        own = [meets(start[i, j], medium.sent[j, b]) for b in range(medium.packets)]
        own.append(ca.logic_and(sends[j], meets(start[i, j], m.t)))
        for overlap in own:
            spoiled[i, j] = ca.logic_or(spoiled[i, j], ca.logic_and(half, overlap))
        for other in range(n):
            if other in (i, j):
                continue
            met = ca.logic_and(audible[other, j], meets(start[i, j], start[other, j]))
            spoiled[i, j] = ca.logic_or(spoiled[i, j], met)
            for b in range(medium.packets):
                path = (other, b, j)
                here = ca.logic_and(
                    medium.status[path] > 0.5, meets(start[i, j], medium.arrival[path])
                )
                spoiled[i, j] = ca.logic_or(spoiled[i, j], here)
                hit = ca.logic_and(audible[i, j], here)
                old[path] = ca.if_else(hit, SPOILED, old[path])
    for path, status in medium.status.items():  # what is arriving where one begins to send
        j = path[2]
        deaf = ca.logic_and(ca.logic_and(half, sends[j]), meets(medium.arrival[path], m.t))
        old[path] = ca.if_else(ca.logic_and(deaf, status > 0.5), SPOILED, old[path])

    statuses: list[ca.SX] = []
    arrivals: list[ca.SX] = []
    for i, a, j in medium.status:
        new = ca.if_else(audible[i, j], ca.if_else(spoiled[i, j], SPOILED, begun[i, j]), 0.0)
        before = (i, a - 1, j)
        moved = old[before] if a else new
        statuses.append(ca.if_else(sends[i], moved, old[i, a, j]))
        moved = medium.arrival[before] if a else start[i, j]
        arrivals.append(ca.if_else(sends[i], moved, medium.arrival[i, a, j]))
    m.update(clock, m.variables["status"].symbol, ca.vertcat(*statuses))
    m.update(clock, m.variables["arrival"].symbol, ca.vertcat(*arrivals))
    sent = []
    for i, a in medium.sent:
        moved = medium.sent[i, a - 1] if a else m.t
        sent.append(ca.if_else(sends[i], moved, medium.sent[i, a]))
        moved = medium.payload[i, a - 1] if a else wanted[i]
        m.update(clock, medium.payload[i, a], ca.if_else(sends[i], moved, medium.payload[i, a]))
    m.update(clock, m.variables["sent"].symbol, ca.vertcat(*sent))


def _arrive(
    m: Model,
    clock: Clock,
    medium: _Medium,
    units: tuple[str, ...],
    processing: ca.SX,
    sigma: ca.SX,
) -> None:
    """Output the packets that have arrived at a tick, and declare the outputs."""
    w = m.normal(clock, medium.nodes)
    status = dict(medium.status)
    for j in range(medium.nodes):
        held = {
            "y": m.discrete(f"y_{j + 1}_held", 0.0, len(units), unit=units),
            "from": m.discrete(f"from_{j + 1}_held", unit="1"),
            "t_sample": m.discrete(f"t_sample_{j + 1}_held", BEFORE_FIRST, unit="s"),
            "travel_time": m.discrete(f"travel_time_{j + 1}_held", unit="s"),
            "received": m.discrete(f"received_{j + 1}_held", unit="1"),
            "lost": m.discrete(f"lost_{j + 1}_held", unit="1"),
        }
        new = dict(held)
        for a in reversed(range(medium.packets)):
            for i in (i for i in range(medium.nodes) if i != j):
                path = (i, a, j)
                over = medium.arrival[path] + medium.duration + processing
                there = ca.logic_and(medium.status[path] > 0.5, m.t >= over - LATE)
                good = ca.logic_and(there, medium.status[path] < 0.5 * (GOOD + SPOILED))
                travel = medium.arrival[path] - medium.sent[i, a] + sigma * w[j]
                shown = {
                    "y": medium.payload[i, a],
                    "from": ca.SX(i + 1.0),
                    "t_sample": medium.sent[i, a],
                    "travel_time": travel,
                }
                for name, value in shown.items():
                    new[name] = ca.if_else(good, value, new[name])
                new["received"] += ca.if_else(good, 1.0, 0.0)
                new["lost"] += ca.if_else(there, 1.0, 0.0) - ca.if_else(good, 1.0, 0.0)
                status[path] = ca.if_else(there, 0.0, status[path])
        for name, state in held.items():
            m.update(clock, state, new[name])
        texts = {
            "y": (units, "what has arrived last"),
            "from": ("1", "node it is from; 0: nothing yet"),
            "t_sample": ("s", "when it was sent; -1: nothing yet"),
            "travel_time": ("s", "of it, from first bit to first bit"),
            "received": ("1", "packets so far"),
            "lost": ("1", "packets that were heard but could not be read, so far"),
        }
        for name, (unit, text) in texts.items():
            m.output(
                f"{name}_{j + 1}", held[name], unit=unit, discrete=True,
                description=f"{text} (node {j + 1})",
            )  # fmt: skip
        m.output(
            f"valid_{j + 1}", held["received"] > 0.5, unit="1", type="Boolean",
            description=f"node {j + 1} has received something",
        )  # fmt: skip
    m.update(clock, m.variables["status"].symbol, ca.vertcat(*status.values()))
