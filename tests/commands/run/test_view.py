"""`--view`: the page of a run is announced where it is served."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.commands.run.view import Watched
from uuvsim_cosim.errors import InputInvalid


def test_the_page_of_a_run_is_announced_with_its_address(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("viser")
    watched = Watched("tank", None, asked=True)
    try:
        with watched:
            said = " ".join(capsys.readouterr().out.split())
    finally:
        watched.close()
    assert re.search(r"tank, live: http://localhost:\d+ in a browser", said)


def test_the_page_ends_with_the_replay(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    served: list[Any] = []
    monkeypatch.setattr("uuvsim_cosim.view.scene3d.scene_of_run.placed", lambda folder: folder)
    monkeypatch.setattr(
        "uuvsim_cosim.commands.run.view.serve", lambda server, *_, **__: served.append(server)
    )
    watched = Watched("tank", None, asked=True)
    try:
        watched.replay(tmp_path)
        assert not served[0].get_event_loop().is_running()
    finally:
        watched.close()


def test_a_port_without_a_page_is_refused() -> None:
    with pytest.raises(InputInvalid, match=r"--port 8080: .* expected --view"):
        Watched("tank", 8080, asked=False)
