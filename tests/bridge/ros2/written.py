"""Messages of a system without a run: facts of its components, and values as blocks."""

from __future__ import annotations

from typing import Any

import numpy as np

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.ros2.facts import Place, facts_of
from uuvsim_cosim.bridge.ros2.topic_writer import TopicWriter, typestore
from uuvsim_cosim.bridge.ros2.topics import Topic, Variable, topics_of
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan

STORE = typestore("jazzy")


def plan_of(**sources: str) -> Plan:
    """Return the plan of components by their names, without connections."""
    system = uuv.System("s", "0.1")
    for name, source in sources.items():
        system = system.add(name, source)
    return flatten(system)


def topics_of_plan(plan: Plan, origin: Place | None = None) -> list[Topic]:
    """Return the topics of all outputs."""
    kinds = {"Float64": "f", "Boolean": "b"}
    variables = {
        f"{c.path}.{v.name}": Variable(kinds.get(v.type, "i"), v.size if v.shape else 0)
        for c in plan.components
        for v in c.description.of("output")
    }
    return topics_of(variables, facts_of(plan, origin))


class Rows(dict[str, Any]):
    """A block: signals by name, and their `time`."""

    def __init__(self, time: list[float], **signals: Any) -> None:
        super().__init__({name.replace("__", "."): np.array(v) for name, v in signals.items()})
        self.time = np.array(time, float)


def written(
    plan: Plan, type_: str, *blocks: Rows, origin: Place | None = None
) -> list[tuple[int, Any]]:
    """Return the messages of the only topic of a type, with the times of their samples [ns].

    Each message is equal, byte by byte, to the one that rosbags writes.
    """
    [topic] = [t for t in topics_of_plan(plan, origin) if t.type == type_]
    writer = TopicWriter(topic, STORE, facts_of(plan, origin))
    found = []
    for block in blocks:
        stamps, rows = writer.messages(block)
        for at, row in zip(stamps.tolist(), rows, strict=True):
            message = STORE.deserialize_cdr(row.tobytes(), type_)
            assert bytes(STORE.serialize_cdr(message, type_)) == row.tobytes()
            if hasattr(message, "header"):
                stamp = message.header.stamp
                at = stamp.sec * 10**9 + stamp.nanosec
                assert message.header.frame_id == topic.frame
            found.append((at, message))
    return found
