"""Events across FMUs of FMI 3.0: Event Mode, early return, and one instant for all."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from pathlib import Path
from typing import Any

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten

FOREIGN = Path(__file__).parents[2] / "fmus" / "foreign"
G = 9.81
A = {"h": 1.0, "e": 0.8}
B = {"h": 3.0, "e": 0.8, "kick": 1.0}
Bounce = Callable[..., Path]


@pytest.fixture(scope="session")
def bounce(source_fmu: Any, tmp_path_factory: pytest.TempPathFactory) -> Bounce:
    """Build the bouncing ball: with a fault, and with an edited description."""
    import fmpy

    from tests.conftest import write_archive
    from uuvsim_cosim.cache import content_hash
    from uuvsim_cosim.fmus.codegen.toolchain import compile_shared, host

    folder = tmp_path_factory.mktemp("bounce")

    def build(fault: int = 0, edit: tuple[str, str] = ("", "")) -> Path:
        library = compile_shared(
            [FOREIGN / "bounce_fmi3.c"],
            name="bounce",
            include=[Path(fmpy.__file__).parent / "c-code"],
            flags=[f"-DFAULT={fault}"],
        )
        text = (FOREIGN / "bounce_fmi3.xml").read_text()
        assert edit[0] in text
        text = text.replace(*edit) if edit[0] else text
        members = {
            "modelDescription.xml": text.encode(),
            f"binaries/{host().fmi3}/bounce{host().suffix}": library.read_bytes(),
        }
        path = folder / f"bounce_{content_hash([text, str(fault)])[:8]}.fmu"
        return path if path.exists() else write_archive(path, members)

    return build


def two(a: Path, b: Path, tick: str = "0.1") -> uuv.System:
    """Two balls: the speed of b gets a kick whenever a bounces."""
    return (
        uuv.System("balls", tick=tick)
        .add("a", str(a), A)
        .add("b", str(b), B)
        .connect("a.hits", "b.hit")
    )


def closed_form(until: float, *, h: float, e: float, kicks: list[float], kick: float = 0.0):
    """Return height and speed at a time, and the instants of the bounces before it."""
    t, v, bounces = 0.0, 0.0, []
    left = [k for k in kicks if k <= until]
    while True:
        lands = t + (v + sqrt(v * v + 2 * G * h)) / G
        first = min([lands, *left[:1], until])
        s = first - t
        h, v, t = h + v * s - G * s * s / 2, v - G * s, first
        if t == lands and t <= until:
            h, v = 0.0, -e * v
            bounces.append(t)
        elif left and t == left[0]:
            v += kick
            left.pop(0)
        else:
            return h, v, bounces


def ends(system: uuv.System, until: float) -> tuple[float, float, list[Any]]:
    """Return height and speed of b at the end, and the events."""
    plan = flatten(system)
    with Master(plan, prepare(plan)) as master:
        master.initialize()
        master.run_until(until)
        return master.get("b", "h"), master.get("b", "v"), master.events


def test_a_ball_reacts_to_the_bounce_of_another_at_its_instant(bounce: Bounce) -> None:
    _, _, bounces = closed_form(2.0, **A, kicks=[])
    h, v, _ = closed_form(2.0, h=3.0, e=0.8, kick=1.0, kicks=bounces)
    system = two(bounce(), bounce())
    late = ends(system, 2.0)
    assert abs(late[0] - h) > 1e-2
    assert late[2] == []
    here = ends(system.with_events(), 2.0)
    assert here[:2] == pytest.approx((h, v), abs=1e-12)
    of_a = [e for e in here[2] if e.component == "a"]
    assert [e.time for e in of_a] == pytest.approx(bounces, abs=1e-12)
