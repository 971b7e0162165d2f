"""The landing page flies a vehicle: a button starts the live page of a shipped system."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "extensions"))

from live_pages import DOCS, built
from live_vehicles import vehicle_file

import uuvsim_cosim as uuv
from tests.kernels.web_assembly.test_module import mastered
from tests.view.browser import found_in_page
from uuvsim_cosim.kernels.web_assembly.output_hash import output_hash


@pytest.fixture
def landing(tmp_path: Path) -> Path:
    """Build the part of the landing page that has the vehicle."""
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    (part,) = re.findall(r"```\{live-vehicle\}.*?```", text, re.DOTALL)
    return built(tmp_path / "docs", {"landing.md": f"# Landing\n\n{part}\n"})


def test_the_vehicle_of_the_landing_page_flies_the_bits_of_the_master(landing: Path) -> None:
    script = """
    const place = document.querySelector("[data-vehicle]");
    place.querySelector("button").onclick();
    await until(() => place.dataset.state === "running");
    const page = place.querySelector("iframe").contentWindow.uuvsimPage;
    while (!page.system.steps) await wait();
    page.pause(); page.restart(); page.advance(200);
    const urls = [...document.querySelectorAll("script[src], link[rel=stylesheet]")];
    const link = place.querySelector("[role=status] a");
    return [page.system.table.name, page.system.hash, link.protocol,
      [...new Set(urls.map(e => new URL(e.src || e.href).protocol))]];
    """
    text = (landing / "landing.html").read_text(encoding="utf-8")
    name, found, own_tab, resources = found_in_page(landing, text, script)
    assert found == output_hash(*mastered(uuv.load(name), 200))
    assert own_tab == "blob:"
    assert resources == ["file:"]


def test_nothing_is_loaded_before_the_button_and_a_missing_file_is_named(landing: Path) -> None:
    text = (landing / "landing.html").read_text(encoding="utf-8")
    assert 'src="_static/live/bluerov2_hold.js' not in text
    assert len(vehicle_file("bluerov2_hold")) < 400_000
    (landing / "_static" / "live" / "bluerov2_hold.js").unlink()
    script = """
    const place = document.querySelector("[data-vehicle]");
    place.querySelector("button").onclick();
    await until(() => /cannot/.test(place.textContent));
    return place.querySelector("[role=status]").textContent;
    """
    assert "bluerov2_hold.js cannot be read." in found_in_page(landing, text, script)
