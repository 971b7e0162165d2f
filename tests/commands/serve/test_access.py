"""`uuvsim access` and `uuvsim serve --access`: from nothing to a guarded co-simulation."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from tests.conftest import Start
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd

PARTS = Path(__file__).parents[2] / "bridge" / "parts.py"
ANY = ("--port", "0", "--tcp-port", "0", "--http-port", "0", "--no-record", "--paused")


def test_a_password_a_ca_and_a_file_guard_what_is_served(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    start: Start,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_ssd(uuv.System("sums", "0.1").add("sum", f"{PARTS}:Sum"), tmp_path / "sums.ssd")
    assert status_of(["access", "certificates", "pki", "--host", "127.0.0.1"]) == 0
    assert "pki/server-key.pem" in capsys.readouterr().out.replace("\\", "/")
    command = [sys.executable, "-m", "uuvsim_cosim", "access", "password"]
    said = subprocess.run(command, input="deep six\n", text=True, capture_output=True, check=True)
    (tmp_path / "access.yaml").write_text(
        f"users:\n  ann: {{role: controller, password: {said.stdout.strip()}}}\n"
        "tls: {certificate: pki/server.pem, key: pki/server-key.pem}\n"
    )
    command = [sys.executable, "-m", "uuvsim_cosim", "serve", "sums.ssd", *ANY]
    command += ["--access", "access.yaml", "--host", "127.0.0.1"]
    serving = start(command, stdout=subprocess.PIPE)
    assert serving.stdout is not None
    lines = [serving.stdout.readline() for _ in range(5)]
    assert lines[0] == "sums is served to ann (controller), others: nothing:\n"
    assert "https://127.0.0.1" in lines[3]
    port = int(re.findall(r"port=(\d+)", lines[1])[0])
    enter = {"port": port, "ca": "pki/ca.pem"}
    with pytest.raises(InputInvalid, match="requires a login"):
        uuv.connect(**enter)
    with uuv.connect(**enter, user="ann", password="deep six") as client:
        client.step(5, {"sum.a": 1.0})
        assert client.get("sum.s") == pytest.approx(0.5)
    serving.send_signal(signal.SIGINT)
    serving.communicate()
    assert serving.returncode == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--access", "none.yaml"], "none.yaml: cannot be read"),
        (["--host", "0.0.0.0"], "--anyone to admit everybody"),
        (["--anyone", "--access", "x"], "expected one"),
        (["--anyone", "--host", "203.0.113.7"], "cannot listen at 203.0.113.7"),
        (["--anyone", "--host", "203.0.113.7", "--port", "17471"], "203.0.113.7"),
    ],
)
def test_transports_that_cannot_be_opened_are_named(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_ssd(uuv.System("sums", "0.1").add("sum", f"{PARTS}:Sum"), tmp_path / "sums.ssd")
    assert status_of(["serve", str(tmp_path / "sums.ssd"), *ANY, *arguments]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
