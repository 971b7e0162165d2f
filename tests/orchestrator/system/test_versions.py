"""Versions of a mapping share their items; edits of a system check only the part they touch."""

from __future__ import annotations

import random
import threading
from dataclasses import replace

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import SystemInvalid
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.orchestrator.system.versions import Versions


def test_an_older_version_does_not_see_what_was_added_later() -> None:
    old = Versions({"a": 1})
    new = old.extended({"b": 2})
    other = old.extended({"c": 3, "b": 4})
    assert dict(old) == {"a": 1}
    assert dict(new) == {"a": 1, "b": 2}
    assert dict(other) == {"a": 1, "c": 3, "b": 4}
    assert "b" not in old
    assert other.index("b") == 2
    with pytest.raises(KeyError):
        old.index("b")


def test_threads_that_extend_one_version_get_a_version_each() -> None:
    first = Versions({i: i for i in range(100)})
    found: list[Versions[int, int]] = []

    def extend(n: int) -> None:
        version = first
        for i in range(200):
            version = version.extended({1000 * n + i: i})
        found.append(version)

    threads = [threading.Thread(target=extend, args=(n,)) for n in range(1, 9)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for version in found:
        n = max(version) // 1000
        assert list(version) == [*range(100), *(1000 * n + i for i in range(200))]


def same(system: System) -> None:
    """Compare a system that was edited with the same system, checked as a whole."""
    whole = replace(system)
    assert whole == system
    assert whole.checked.wires == system.checked.wires
    assert whole.checked.notes == system.checked.notes
    assert list(whole.checked.descriptions.items()) == list(system.checked.descriptions.items())
    assert set(whole.checked.fed) == set(system.checked.fed)


@pytest.mark.parametrize("name", ["bluerov2_survey", "target_tracking"])
def test_a_system_built_by_edits_is_the_system_checked_as_a_whole(name: str) -> None:
    shipped = uuv.load(name)
    built = System(shipped.name, tick=shipped.tick, base=shipped.base)
    for e in shipped.elements:
        source = e.source
        assert isinstance(source, str | System)
        built = built.add(e.name, source, rate=e.rate)
        same(built)
    for c in shipped.connections:
        built = built.connect(
            c.source, c.target, factor=c.factor, offset=c.offset, convert=c.convert
        )
    same(built)
    for e in shipped.elements:
        for key, value in e.start.items():
            built = built.set(f"{e.name}.{key}", value)
    same(built)
    assert built.checked.wires == shipped.checked.wires
    assert {e.name: dict(e.start) for e in built.elements} == {
        e.name: dict(e.start) for e in shipped.elements
    }


def test_elements_of_a_connector_become_one_connection_in_any_order(vehicle: System) -> None:
    cut = vehicle.disconnect("guidance.eta")
    order = random.Random(3).sample(range(1, 7), 6)
    for i in order:
        cut = cut.connect(f"hull.eta[{i}]", f"guidance.eta[{i}]")
        same(cut)
    assert ("hull.eta", "guidance.eta") in {(c.source, c.target) for c in cut.connections}


@pytest.mark.parametrize(
    ("edit", "read"),
    [
        (lambda s: s.connect("hull.eta", "guidance.eta"), "2 sources"),
        (lambda s: s.connect("hull.eta[2]", "guidance.eta[2]"), "2 sources"),
        (lambda s: s.add("a[1]", "fake:filter"), "not a name"),
        (lambda s: s.add("a", "no_such_model"), "there is no model"),
        (lambda s: s.add("a", "fake:filter", rate="0.015"), "does not divide"),
        (lambda s: s.set("hull.mass", "3 m"), "unit"),
        (lambda s: s.connect("a.y", "b.u", factor=float("nan")), "factor nan; expected a finite"),
        (lambda s: s.connect("a.y", "b.u", offset="abc"), "offset 'abc'; expected a finite"),
        (lambda s: s.set("hull.eta", 3), "without a settable start value"),
    ],
)
def test_a_wrong_edit_is_refused_with_all_its_problems(
    vehicle: System, edit: object, read: str
) -> None:
    assert callable(edit)
    with pytest.raises(SystemInvalid, match=read):
        edit(vehicle)
