"""Options of the MATLAB client and its token, in Octave with a double of MATLAB's string."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.bridge.in_octave import NEEDS_OCTAVE, said
from uuvsim_cosim.bridge.access.token import known_token, token_file
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
pytestmark = NEEDS_OCTAVE

STRING = """classdef string
  properties
    text = '';
  end
  methods
    function self = string(text)
      self.text = text;
    end
    function text = char(self)
      text = self.text;
    end
  end
end
"""


@pytest.fixture
def port() -> Iterator[int]:
    with (
        Conductor(System("sums", "0.1").add("sum", f"{PARTS}:Sum")) as conductor,
        TcpServer(conductor, 0) as endpoint,
    ):
        yield endpoint.port


def test_options_may_have_names_and_values_of_class_string(port: int, tmp_path: Path) -> None:
    (tmp_path / "string.m").write_text(STRING)
    name, host = "string('port')", "string('host'), string('127.0.0.1')"
    lines = said(
        f"addpath('{tmp_path}'); s = uuvsim.connect({name}, {port}, {host}); disp(s.name); "
        f"try, uuvsim.connect(string('prt'), 1), catch e, disp(e.message), end; "
        f"try, uuvsim.connect({name}, '{port}'), catch e, disp(e.message), end"
    ).splitlines()
    assert lines[0] == "octave"
    assert lines[1].startswith("uuvsim: an option of uuvsim.connect is one of host, port,")
    assert lines[2] == "uuvsim: port is a number."


def test_octave_finds_the_token_and_others_are_told_where_it_is(port: int) -> None:
    tried = f"try, uuvsim.connect('port', {port}, 'token', 'x'), catch e, disp(e.message), end"
    lines = said(f"s = uuvsim.connect('port', {port}); disp(strjoin(s.allowed)); {tried}")
    assert lines.splitlines()[0] == "manage read set step"
    where = f"Programs of the server's user find it in {token_file(port).parent}"
    assert f"the token is wrong. {where}" in lines


def test_octave_takes_a_token_that_is_given(port: int, tmp_path: Path) -> None:
    token = known_token("127.0.0.1", port)
    given = f"setenv('UUVSIM_TOKENS', '{tmp_path}');"
    asked = f"try, uuvsim.connect('port', {port}), catch e, disp(e.message), end"
    named = f"s = uuvsim.connect('port', {port}, 'token', '{token}'); disp(s.name)"
    lines = said(f"{given} {asked}; {named}").splitlines()
    assert "this co-simulation requires a token" in lines[0]
    assert lines[1] == "octave"


@pytest.mark.parametrize("mode", [0o644, 0o660])
def test_octave_takes_no_token_that_others_may_know(port: int, mode: int) -> None:
    os.chmod(token_file(port), mode)
    tried = f"try, uuvsim.connect('port', {port}), catch e, disp(e.message), end"
    assert "expected a file of your own with mode 600" in said(tried)


def test_octave_follows_no_link_to_a_token(port: int, tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    file = token_file(port)
    file.rename(kept)
    file.symlink_to(kept)
    tried = f"try, uuvsim.connect('port', {port}), catch e, disp(e.message), end"
    assert "expected a file of your own with mode 600" in said(tried)
