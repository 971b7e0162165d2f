"""A recording as rosbag2 (MCAP), with the topics, types and frames that ROS expects."""

from __future__ import annotations

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Literal

import numpy as np

from uuvsim_cosim.bridge.ros2.facts import Facts, Place, facts_of
from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.bridge.ros2.robot import STRING, Robot, mounted, robots_of, text_message
from uuvsim_cosim.bridge.ros2.topic_writer import TRANSFORMS, TopicWriter, typestore
from uuvsim_cosim.bridge.ros2.topics import (
    LATCHED,
    QosProfile,
    Topic,
    Variable,
    omitted_topics,
    read_topics,
    topics_of,
)
from uuvsim_cosim.errors import InputInvalid, RecordingError, UuvsimError
from uuvsim_cosim.notebook_bar import Progress
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals

if TYPE_CHECKING:
    from rosbags.interfaces import Qos
    from rosbags.typesys.store import Typestore

    from uuvsim_cosim.orchestrator.recording.signals import Signals

__all__ = ["recorded_topics", "write_bag"]


def write_bag(
    run: Path | str,
    target: Path,
    topics: Path | None = None,
    distribution: str = "jazzy",
    progress: Progress | None = None,
    origin: Place | None = None,
) -> tuple[list[Topic], list[str]]:
    """Write a recording as rosbag2; return its topics and what was assumed or left out.

    A `target` that ends with ``.mcap`` is one file, any other a new folder with the file and its
    ``metadata.yaml``. `topics` is a file of topics; without it, they follow from the signals. Time
    0 of the run is time 0 of the bag. Sensors have a message for each sample, whose header has the
    sample's time; the bag has the time at which the system had it.
    `origin` is the place of the origin of `n`, which positions on Earth need.
    Raises InputInvalid without rosbags, if the target exists, and for mistakes in `topics`.
    """
    store = typestore(distribution)
    signals = read_signals(run)
    variables, left = _variables(signals)
    facts, robots, notes = _of_system(Path(run), origin)
    if topics is None:
        chosen = topics_of(variables, facts)
        notes += [f"{name}: a text has no topic" for name in left]
        notes += omitted_topics(variables, facts)
    else:
        chosen = read_topics(topics, variables, facts)
    latched = [(robot.topic, STRING, text_message(store, robot.urdf)) for robot in robots]
    if len(static := mounted(store, chosen, robots)):
        latched.append(("/tf_static", TRANSFORMS, static))
    writers = [TopicWriter(topic, store, facts) for topic in chosen]
    if target.exists():
        raise InputInvalid(target, "exists", "a name that does not exist yet")
    try:
        with TemporaryDirectory(dir=target.absolute().parent, prefix=f".{target.name}-") as folder:
            bag = Path(folder) / target.stem
            version: Literal[8, 9] = 8 if distribution == "humble" else 9
            _write(bag, version, store, writers, latched, signals, progress)
            shutil.move(bag / f"{bag.name}.mcap" if target.suffix == ".mcap" else bag, target)
    except OSError as error:
        raise RecordingError(
            target, f"cannot be written ({error.strerror or error})", "a folder that can be written"
        ) from error
    notes += [f"{writer.topic.name}: no message" for writer in writers if not writer.count]
    return chosen, notes


def recorded_topics(run: Path | str, origin: Place | None = None) -> list[Topic]:
    """Return the topics that follow from the signals of a recording."""
    facts, _, _ = _of_system(Path(run), origin)
    return topics_of(_variables(read_signals(run))[0], facts)


def _write(
    bag: Path,
    version: Literal[8, 9],
    store: Typestore,
    writers: list[TopicWriter],
    latched: list[tuple[str, str, Array]],
    signals: Signals,
    progress: Progress | None,
) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    out = Writer(bag, version=version, storage_plugin=StoragePlugin.MCAP)
    out.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with out:
        connections = {  # vehicles share /tf
            (name, type_): out.add_connection(name, type_, typestore=store,
                                              offered_qos_profiles=_offered(qos))
            for name, type_, qos in dict.fromkeys((w.topic.name, w.topic.type, w.topic.qos)
                                                  for w in writers)
        }  # fmt: skip
        for name, type_, message in latched:
            connection = out.add_connection(name, type_, typestore=store,
                                            offered_qos_profiles=_offered(LATCHED))  # fmt: skip
            out.write(connection, 0, message.tobytes())  # time 0: before all others
        for block in signals.blocks(progress):
            times, owners, messages = [], [], []
            for writer in writers:
                stamps, rows = writer.messages(block)
                times.append(stamps)
                owners += [(writer.topic.name, writer.topic.type)] * len(rows)
                messages += list(rows)
            at = np.concatenate(times)
            for i in np.argsort(at, kind="stable"):
                out.write(connections[owners[i]], int(at[i]), messages[i].tobytes())


def _offered(qos: QosProfile) -> list[Qos]:
    """Return the QoS of a topic as a recording states it; nothing of the default."""
    if qos == QosProfile():
        return []
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    forever = QosTime(2147483647, 4294967295)
    reliability = QosReliability.BEST_EFFORT if qos.best_effort else QosReliability.RELIABLE
    durability = QosDurability.TRANSIENT_LOCAL if qos.transient_local else QosDurability.VOLATILE
    return [Qos(QosHistory.KEEP_LAST, qos.depth or 42, reliability, durability, forever, forever,
                QosLiveliness.AUTOMATIC, forever, avoid_ros_namespace_conventions=False)
    ]  # fmt: skip


def _variables(signals: Signals) -> tuple[dict[str, Variable], list[str]]:
    """Return the kind and size of each signal of numbers, and the names of the others."""
    first = next(signals.blocks(), signals)
    kinds = {
        name: Variable(v.dtype.kind, v.shape[1] if v.ndim > 1 else 0) for name, v in first.items()
    }
    texts = [name for name, v in kinds.items() if v.kind == "O"]
    return {name: v for name, v in kinds.items() if v.kind != "O"}, texts


def _of_system(run: Path, origin: Place | None) -> tuple[Facts, list[Robot], list[str]]:
    """Return facts and vehicles of the system beside the recording, and notes."""
    file = (run if run.is_dir() else run.parent) / "system.ssd"
    lacking = "covariances and limits of sensors are 0, clouds of points and frames are left out"
    if not file.is_file():
        return {}, [], [f"no system.ssd beside the recording: {lacking}"]
    from uuvsim_cosim.orchestrator.plan.flatten import flatten
    from uuvsim_cosim.orchestrator.running.library import load

    try:
        plan = flatten(load(file).with_mismatches("warn"), loops="delay")
    except (UuvsimError, OSError) as error:
        return {}, [], [f"{file}: cannot be read ({error}): {lacking}"]
    facts = facts_of(plan, origin)
    return facts, robots_of(plan, facts), []
