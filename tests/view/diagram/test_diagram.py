import re
import textwrap
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import pytest

from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.view.diagram.diagram import diagram
from uuvsim_cosim.view.diagram.graph import boxes_and_nets
from uuvsim_cosim.view.diagram.layout import laid_out
from uuvsim_cosim.view.diagram.route import routed

COMPONENTS = """
class Controller:
    inputs = {"eta": (6, "1")}
    outputs = {"tau_d": (6, "N")}
    def step(self, t, dt, u):
        return {"tau_d": u["eta"]}

class Allocation:
    inputs = {"tau_d": (6, "N")}
    outputs = {"u": (3, "1")}
    def step(self, t, dt, u):
        return {"u": u["tau_d"][:3]}

class Thruster:
    inputs = {"u": "1"}
    outputs = {"thrust": "N"}
    def step(self, t, dt, u):
        return {"thrust": u["u"]}

class Hull:
    inputs = {"thrust": (3, "N")}
    outputs = {"eta": (6, "1")}
    def step(self, t, dt, u):
        return {"eta": [u["thrust"][0]] * 6}
"""


@pytest.fixture
def system(tmp_path: Path) -> System:
    (tmp_path / "parts.py").write_text(textwrap.dedent(COMPONENTS))
    s = System("tank <1>", tick="0.02", description="four parts & a loop", base=tmp_path)
    s = s.add("controller", "parts.py:Controller").add("allocation", "parts.py:Allocation")
    for i in (1, 2, 3):
        s = s.add(f"thruster_{i}", "parts.py:Thruster").connect(
            f"allocation.u[{i}]", f"thruster_{i}.u"
        )
    s = s.add("hull", "parts.py:Hull", rate="0.04")
    for i in (1, 2, 3):
        s = s.connect(f"thruster_{i}.thrust", f"hull.thrust[{i}]")
    s = s.connect("hull.eta", "controller.eta").connect("controller.tau_d", "allocation.tau_d")
    return s.group(["controller", "allocation"])


def texts(svg: str) -> list[str]:
    return [e.text or "" for e in ElementTree.fromstring(svg).iter() if e.tag.endswith("text")]


def test_a_diagram_is_one_file_that_loads_nothing(system: System) -> None:
    svg = diagram(system)
    ElementTree.fromstring(svg)
    assert not re.search(r"href|url\(|<script|<image", svg)
    assert svg == diagram(system)


def test_equal_components_are_drawn_as_one_stack(system: System) -> None:
    boxes, _ = boxes_and_nets(system)
    assert list(boxes) == ["controller", "allocation", "thruster_1 … thruster_3", "hull"]
    assert boxes["thruster_1 … thruster_3"].count == 3


def test_names_steps_bundles_and_units_can_be_read(system: System) -> None:
    shown = texts(diagram(system))
    assert "tank <1>" in shown
    assert {"controller", "parts.py:Controller", "20 ms", "40 ms"} <= set(shown)
    assert "tau_d [6]  N" in shown


def test_loop_delays_and_groups_stand_in_the_caption(system: System) -> None:
    shown = "\n".join(texts(diagram(system)))
    assert "80 ms: controller → allocation → thruster_1 … thruster_3 → hull" in shown
    assert "Shaded: controller, allocation step in this order (gauss-seidel)" in shown


def test_the_flow_runs_from_left_to_right_and_feedback_around(system: System) -> None:
    boxes, nets = boxes_and_nets(system)
    layout = laid_out(boxes, nets)
    columns = [layout.boxes[k].column for k in boxes]
    assert columns == [0, 1, 2, 3]
    routes = routed(layout, boxes, nets)
    feedback = next(p for n, p in routes.lines if nets[n].source == ("hull", "eta"))
    assert max(y for _, y in feedback) > max(p.y + p.height for p in layout.boxes.values())


def test_no_line_crosses_a_box(system: System) -> None:
    boxes, nets = boxes_and_nets(system)
    layout = laid_out(boxes, nets)
    routes = routed(layout, boxes, nets)
    for place in layout.boxes.values():
        x0 = routes.columns[place.column]
        x1, y0, y1 = x0 + place.width, place.y, place.y + place.height
        for _, points in routes.lines:
            for (ax, ay), (bx, by) in pairwise(points):
                inside_x = max(ax, bx) > x0 + 0.1 and min(ax, bx) < x1 - 0.1
                inside_y = max(ay, by) > y0 + 0.1 and min(ay, by) < y1 - 0.1
                assert not (inside_x and inside_y)


def test_a_long_line_passes_between_the_boxes_of_a_column(system: System) -> None:
    s = system.add("logger", "parts.py:Controller").connect("allocation.u[1]", "logger.eta[1]")
    s = s.add("last", "parts.py:Hull").connect("controller.tau_d[1]", "last.thrust[1]")
    test_no_line_crosses_a_box(s)


def test_boxes_of_a_column_do_not_overlap(system: System) -> None:
    boxes, nets = boxes_and_nets(system.add("alone", "parts.py:Hull"))
    layout = laid_out(boxes, nets)
    for cells in layout.columns:
        places = [layout.boxes[k] for k, n in cells if n < 0]
        for a, b in pairwise(places):
            assert b.y >= a.y + a.height


def test_an_empty_system_can_be_drawn() -> None:
    assert "no components" in texts(diagram(System("empty")))[-1]
