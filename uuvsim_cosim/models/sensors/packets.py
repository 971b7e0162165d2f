"""Packets on an acoustic medium: transmission, collisions at each receiver, and arrival.

All is settled when a packet is sent: when its first bit is where, and whether it overlaps there
with another, or with the receiver's own sending. Packets last D each, so that two overlap where
their first bits are less than D apart. The equations of loss and delay are those of `modem`.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.safe_math import norm, smoothstep
from uuvsim_cosim.models.declaration.sampled import BEFORE_FIRST
from uuvsim_cosim.models.sensors.sensor_error import uniform

__all__ = ["Medium", "arrive", "medium_of", "send"]

LATE = 1e-6  # s: instants nearer than this are one
GOOD, SPOILED = 1.0, 2.0


@dataclass(frozen=True)
class Medium:
    """The symbols that sending and arriving share; a path is (sender, packet, receiver)."""

    nodes: int
    packets: int  # that each sender can have under way
    duration: ca.SX
    status: dict[tuple[int, int, int], ca.SX]  # of a path: 0 nothing, 1 will arrive, 2 will not
    arrival: dict[tuple[int, int, int], ca.SX]  # when its first bit is there
    payload: dict[tuple[int, int], ca.SX]
    sent: dict[tuple[int, int], ca.SX]

    def pairs(self) -> list[tuple[int, int]]:
        """List sender and receiver of every direction."""
        return [(i, j) for i in range(self.nodes) for j in range(self.nodes) if i != j]


def medium_of(
    m: Model, n: int, k: int, width: int, units: tuple[str, ...], duration: ca.SX
) -> Medium:
    """Declare the states of `n` nodes with `k` packets each of `width` numbers."""
    paths = [(i, a, j) for i in range(n) for a in range(k) for j in range(n) if i != j]
    packets = [(i, a) for i in range(n) for a in range(k)]
    status = m.discrete("status", 0.0, len(paths), unit="1", description="of each path")
    arrival = m.discrete("arrival", 0.0, len(paths), unit="s", description="of its first bit")
    payload = {
        (i, a): m.discrete(f"payload_{i + 1}_{a + 1}", 0.0, width, unit=units) for i, a in packets
    }
    sent = m.discrete("sent", -1e9, len(packets), unit="s", description="of each packet")
    return Medium(
        n,
        k,
        duration,
        {path: status[at] for at, path in enumerate(paths)},
        {path: arrival[at] for at, path in enumerate(paths)},
        payload,
        {packet: sent[at] for at, packet in enumerate(packets)},
    )


def send(
    m: Model,
    clock: Clock,
    medium: Medium,
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

    chance = uniform(m, clock, n * (n - 1))
    start, audible, begun = {}, {}, {}
    for at, (i, j) in enumerate(medium.pairs()):
        d = norm(places[i] - places[j])
        fading = smoothstep((d - full) / ca.if_else(far > full, far - full, 1e-9))
        kept = chance[at] > 1.0 - (1.0 - loss) * (1.0 - fading)
        start[i, j] = m.t + d / c
        audible[i, j] = ca.logic_and(sends[i], d < far)
        begun[i, j] = ca.if_else(kept, GOOD, SPOILED)

    def meets(a: ca.SX, b: ca.SX) -> ca.SX:
        return ca.fabs(a - b) < D - LATE

    spoiled = {pair: ca.SX(0) for pair in medium.pairs()}  # of the new packets
    old = dict(medium.status)
    for i, j in medium.pairs():
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


def arrive(
    m: Model,
    clock: Clock,
    medium: Medium,
    width: int,
    units: tuple[str, ...],
    processing: ca.SX,
    sigma: ca.SX,
) -> None:
    """Show what has arrived at a tick, and declare the outputs."""
    w = m.normal(clock, medium.nodes)
    status = dict(medium.status)
    for j in range(medium.nodes):
        held = {
            "y": m.discrete(f"y_{j + 1}_held", 0.0, width, unit=units),
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
