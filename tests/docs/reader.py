"""A reader of a page: pastes its blocks, in order, into terminals of an empty folder.

- A `bash` block runs in bash and ends at its first error; its variables are there for the next one.
  `uuvsim serve …` and `uuvsim view …` run in a terminal of their own until the next server or the
  end of the page; a line that ends with `&` runs beside the others.
- A `python` block runs in the page's one Python, where a warning is an error. A `matlab` block runs
  in the page's one GNU Octave, except for lines that say "MATLAB only". Ports are replaced: no
  running server is disturbed.
- Python has the core's libraries and those of the extras that the page names, see `extras`.
- A page with the comment `<!-- checkout -->` has its blocks run in the root of a checkout.

A comment on the line before a block says what the block is:

- `<!-- file: NAME -->`: a file to save.
- `<!-- output -->`: output of the block before it. Numbers are not compared. A line that ends with
  `…` is a beginning, and lines may be left out.
- `<!-- status: 2 -->`: commands that end with this exit status.
- `<!-- source: FILE -->`: lines of a file of the project.
- `<!-- part of a file -->`: lines of a user's file.
- `<!-- not run: REASON -->`: a block that no test runs.
- `<!-- shorter: A -> B; C -> D -->`: a block that computes for long; the test replaces A by B and C
  by D.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
import shutil
import socket
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from extras import write_site

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BLOCK = re.compile(
    r"(?:^<!-- (?P<note>[^\n]*) -->\n)?^```(?P<language>[\w{}-]*)[^\n]*\n(?P<text>.*?)^```$",
    re.M | re.S,
)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
SCRIPTS = Path(sysconfig.get_path("scripts"))
PORTS = {"7470": "--port", "7448": "--tcp-port", "7449": "--http-port"}
CHECKOUT = "benchmarks docs fmus matlab models orchestrator tests uuvsim_cosim pyproject.toml"
SERVES = re.compile(r"uuvsim (serve|view)\b|uuvsim .* --view\b")
END = "end of block"
# Runs blocks that come as lines of JSON, in `__main__`, as an interpreter does.
PYTHON = f"""
for _block in map(__import__("json").loads, __import__("sys").stdin):
    exec(compile(*_block, "exec"))
    print({END!r}, flush=True)
"""
# `.ci/wheel` runs the README's run command, `.ci/run` its test command.
NOT_RUN = ("not run", "part of a file", "run command", "test command")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: its language, its text, the comment before it, and its line."""

    language: str
    text: str
    note: str
    line: int


def blocks(page: Path) -> list[Block]:
    """Return the fenced blocks of a page in order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(
            found["language"],
            found["text"],
            found["note"] or "",
            text.count("\n", 0, found.start("language")) + 1,
        )
        for found in BLOCK.finditer(text)
    ]


def plain(line: str) -> str:
    """Return a line without its numbers, units of size and spacing."""
    return " ".join(re.sub(r"\b[kM]?B\b", "B", NUMBER.sub("#", line)).split())


def assert_shown(expected: str, output: str, place: str) -> None:
    """Check that the lines shown appear in the output, in this order."""
    there = iter([plain(line) for line in output.splitlines()])
    for line in expected.splitlines():
        start, cut, _ = line.partition("…") if line.endswith("…") else (line, "", "")
        wanted = plain(start)
        if wanted and not any(x.startswith(wanted) if cut else x == wanted for x in there):
            pytest.fail(f"{place}: {line!r} is not (or not there) in the output:\n{output}")


def free_port() -> str:
    """Return a port that is opened minutes later; nobody gets it as any free one meanwhile."""
    while True:
        port = random.randrange(20_000, 32_000)  # below those that Linux chooses
        with socket.socket() as s, contextlib.suppress(OSError):
            s.bind(("127.0.0.1", port))
            return str(port)


class Reader:
    """Runs the blocks of one page in the current folder; see the module."""

    def __init__(self, page: Path) -> None:
        self.page = page
        self.output = ""
        self._ports = {default: free_port() for default in PORTS}
        self._remote = free_port()
        self._server: subprocess.Popen[str] | None = None
        self._octave: subprocess.Popen[str] | None = None
        self._python: subprocess.Popen[str] | None = None
        self._stack = ExitStack()
        text = page.read_text(encoding="utf-8")
        site = self._stack.enter_context(tempfile.TemporaryDirectory())
        write_site(Path(site), text)
        self._environment = {
            **os.environ,
            "PATH": f"{SCRIPTS}{os.pathsep}{os.environ.get('PATH', '')}",
            "BROWSER": "true",
            "MPLBACKEND": "Agg",
            "PYTHONUNBUFFERED": "1",
            "PYTHONPATH": f"{site}{os.pathsep}{os.environ.get('PYTHONPATH', '')}".rstrip(
                os.pathsep
            ),
        }
        if "<!-- checkout -->" in text:
            for name in CHECKOUT.split():
                os.symlink(ROOT / name, name)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with self._stack:
            if self._python is not None and error[0] is None:  # its end is the reader's, too
                said, _ = self._python.communicate()
                assert self._python.returncode == 0, f"{self.page.name}: at the end: {said}"

    def reads(self, block: Block) -> None:
        """Do what the page asks for with one block."""
        place = f"{self.page.name}:{block.line}"
        key, _, value = block.note.partition(": ")
        text = block.text
        if key in NOT_RUN:
            return
        if key == "shorter":
            for change in value.split("; "):
                long, short = change.split(" -> ")
                assert long in text, f"{place}: {long!r} is not in the block"
                text = text.replace(long, short)
        if key == "source":
            source = (ROOT / value).read_text(encoding="utf-8")
            assert text in source, f"{place}: this is not the text of {value}"
        elif key == "file":
            Path(value).parent.mkdir(parents=True, exist_ok=True)
            Path(value).write_text(self._elsewhere(text), encoding="utf-8")
        elif key == "output":
            assert_shown(text, self.output, place)
        elif block.language in ("bash", "sh", "console"):
            status = int(value) if key == "status" else 0
            commands = [*lines(text)]
            assert "pip install" not in text, f"{place}: a test installs nothing: mark it not run"
            if any(serves(line) or line.endswith("&") for line in commands):
                self.output = "".join(self._bash(line, status, place) for line in commands)
            else:  # as it is pasted, with here-documents
                self.output = self._bash(text, status, place)
        elif block.language == "python":
            self.output = self._in_python(text, block.line, place)
        elif block.language == "matlab":
            self.output = self._in_octave(text, place)
        else:
            assert block.language in ("text", "{toctree}", "{gallery}", "{live-vehicle}"), (
                f"{place}: nothing says what a block of language {block.language!r} is for"
            )

    def _bash(self, line: str, status: int, place: str) -> str:
        if serves(line):
            self._serve(line, place)
            return ""
        if line.endswith("&"):
            self._beside(self._started(["bash", "-c", f"exec {line.removesuffix('&')}"]), place)
            return ""
        with tempfile.NamedTemporaryFile() as left:  # the variables that the block leaves
            script = f"trap 'env -0 > {left.name}' EXIT\n{self._elsewhere(line)}"
            done = subprocess.run(
                ["bash", "-aeuo", "pipefail", "-c", script],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                check=False,
                env=self._environment,
            )
            variables = left.read().decode().split("\0")
        said = done.stdout + done.stderr
        assert done.returncode == status, f"{place}: {line}: {done.returncode}\n{said}"
        self._environment |= dict(x.split("=", 1) for x in variables if "=" in x)
        assert status or '"ok": false' not in said, f"{place}: {line}: {said}"
        return said

    def _in_python(self, text: str, line: int, place: str) -> str:
        if self._python is None:
            arguments = [sys.executable, "-W", "error", "-c", PYTHON]
            self._python = self._started(arguments, stdin=subprocess.PIPE)
        # Blank lines before the code, so that a traceback names the page's line.
        code = "\n" * line + self._elsewhere(text)
        return said_by(self._python, json.dumps([code, self.page.name]), place)

    def _serve(self, line: str, place: str) -> None:
        if self._server is not None:
            self._server.terminate()
            self._server.wait()
            self._ports = {default: free_port() for default in PORTS}
        line = self._elsewhere(line.partition("  #")[0])
        if "uuvsim serve" in line:
            ports = [x for default, name in PORTS.items() for x in (name, self._ports[default])]
            line = f"{line} {' '.join(ports)} --no-record"
        else:
            line = f"{line} --port {free_port()}"
        self._server = self._started(["bash", "-c", f"exec {line}"])
        assert self._server.stdout is not None
        said = []
        for words in self._server.stdout:
            said.append(words)
            if words.startswith(("paused", "streams")) or "http://" in words:
                return
        pytest.fail(f"{place}: {line}: {''.join(said)}")

    def _in_octave(self, text: str, place: str) -> str:
        octave = shutil.which("octave-cli") or shutil.which("octave")
        if octave is None:
            pytest.skip("GNU Octave is not installed: MATLAB blocks were not run")
        if self._octave is None:
            folders = ", ".join(f"'{ROOT / 'matlab' / n}'" for n in ("", "examples"))
            options = "--norc --no-history --quiet --no-window-system --no-line-editing"
            self._octave = self._started([octave, *options.split()], stdin=subprocess.PIPE)
            text = f"addpath({folders}); set(0, 'defaultfigurevisible', 'off');\n{text}"
        kept = [line for line in text.splitlines() if "MATLAB only" not in line]
        code = self._elsewhere("\n".join(kept))
        said = said_by(self._octave, f"{code}\ndisp('{END}');fflush(stdout);", place)
        assert not re.search(r"^error: ", said, re.M), f"{place}: {said}"
        return said

    def _elsewhere(self, text: str) -> str:
        """Return the text with the ports that this test uses."""
        for default, port in self._ports.items():
            text = text.replace(default, port)
        zenoh, tcp = self._ports["7470"], self._ports["7448"]
        for pattern, there in (
            (r"\b(uuv\.connect|connect_async)\((?!port)", rf"\1(port={zenoh}, "),
            (r"\buuvsim\.connect\(\)", f"uuvsim.connect('port', {tcp})"),
            (r"\buuvsim\.connect\((?!'port'|'host')", f"uuvsim.connect('port', {tcp}, "),
            (r"\buuvsim access token\b", f"uuvsim access token --port {self._ports['7449']}"),
            (r'\(Hold, "hold"\)', f'(Hold, "hold", port={self._remote})'),
            (r"remote:hold\b", f"remote:hold@127.0.0.1:{self._remote}"),
        ):
            text = re.sub(pattern, there, text)
        return text

    def _beside(self, process: subprocess.Popen[str], place: str) -> None:
        """Wait until a remote component that was started accepts connections."""
        while process.poll() is None:
            with contextlib.suppress(ConnectionRefusedError):
                socket.create_connection(("127.0.0.1", int(self._remote))).close()
                return
        pytest.fail(f"{place}: it ended: {process.communicate()[0]}")

    def _started(self, arguments: list[str], **more: Any) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            arguments,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=self._environment,
            **more,
        )
        self._stack.callback(_ended, process)
        return process


def said_by(interpreter: subprocess.Popen[str], block: str, place: str) -> str:
    """Let a page's interpreter run a block; return what it prints."""
    assert interpreter.stdin is not None
    assert interpreter.stdout is not None
    interpreter.stdin.write(f"{block}\n")
    interpreter.stdin.flush()
    said = ""
    for words in interpreter.stdout:
        if words.strip() == END:
            return said
        said += words
    pytest.fail(f"{place}: the interpreter ended:\n{said}")


def serves(line: str) -> bool:
    """Return whether a command serves until it is interrupted; its comment does not count."""
    return SERVES.search(line.partition("  #")[0]) is not None


def lines(text: str) -> Iterator[str]:
    """Return the commands of a block; a backslash at the end of a line continues it."""
    for line in text.replace("\\\n", " ").splitlines():
        command = line.strip().removeprefix("$ ")
        if command and not command.startswith("#"):
            yield command


def _ended(process: subprocess.Popen[str]) -> None:
    process.terminate()
    process.communicate()
