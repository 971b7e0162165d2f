"""Each page on connecting works by copy and paste: its blocks run in order against `uuvsim serve`.

In a page, a ``bash`` block runs line by line: `uuvsim serve …` starts a server that the blocks
after it are about, a line that ends with & goes on beside them. ``python`` blocks run in the
page's namespace, ``matlab`` blocks in one GNU Octave, but for lines that say MATLAB only. Ports
are other ones, so that a server of yours is not disturbed. ``text`` after ``<!-- output -->`` is
compared as in the tutorials; files are saved as there.
"""

from __future__ import annotations

import contextlib
import re
import shlex
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "bridge"))

from in_octave import OCTAVE, PACKAGE
from test_tutorials import BLOCK, DOCS, Block, assert_shown, command, executed

PAGES = sorted(p.stem for p in DOCS.glob("connect_*.md"))
PORTS = {"7470": "--port", "7448": "--tcp-port", "7449": "--http-port"}
END = "end of block"


class Place:
    """Where a page's blocks run: a folder, ports of its own, and what runs beside them."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.folder = folder
        self.namespace: dict[str, Any] = {"__name__": "__main__"}
        self.ports = {default: free_port() for default in PORTS}
        self.remote = free_port()
        self._stack = stack
        self._server: subprocess.Popen[str] | None = None
        self._octave: subprocess.Popen[str] | None = None

    def bash(self, line: str) -> str:
        line = line.partition("  #")[0].strip()
        if line.startswith("uuvsim serve"):
            self.serve(line)
            return ""
        if line.endswith("&"):
            self._beside(self._started(command(line.removesuffix("&").strip())))
            return ""
        line = self.elsewhere(line)
        arguments = shlex.split(line) if line.startswith("curl ") else command(line)
        done = subprocess.run(arguments, capture_output=True, text=True, check=False, timeout=200)
        assert done.returncode == 0, f"{line}: {done.stdout}{done.stderr}"
        assert '"ok": false' not in done.stdout, f"{line}: {done.stdout}"
        return done.stdout + done.stderr

    def serve(self, line: str) -> None:
        if self._server is not None:
            self._server.terminate()
            self._server.wait(timeout=30)
            self.ports = {default: free_port() for default in PORTS}
        ports = [x for default, name in PORTS.items() for x in (name, self.ports[default])]
        self._server = self._started([*command(self.elsewhere(line)), *ports, "--no-record"])
        assert self._server.stdout is not None
        said = []
        for words in self._server.stdout:
            said.append(words)
            if words.startswith(("paused", "streams")):
                return
        pytest.fail(f"{line}: {''.join(said)}")

    def matlab(self, text: str) -> str:
        assert OCTAVE is not None
        if self._octave is None:
            folders = ", ".join(f"'{DOCS.parent / 'matlab' / n}'" for n in ("", "examples"))
            plain = [
                OCTAVE,
                "--norc",
                "--no-history",
                "--quiet",
                "--no-window-system",
                "--no-line-editing",
            ]
            self._octave = self._started(plain, stdin=subprocess.PIPE)
            text = f"addpath({folders}); set(0, 'defaultfigurevisible', 'off');\n{text}"
        kept = [line for line in text.splitlines() if "MATLAB only" not in line]
        process = self._octave
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(self.elsewhere("\n".join(kept)) + f"\ndisp('{END}');fflush(stdout);\n")
        process.stdin.flush()
        said = ""
        for words in process.stdout:
            if words.strip() == END:
                return said
            said += words
        pytest.fail(f"Octave ended:\n{said}")

    def elsewhere(self, text: str) -> str:
        """Give the text with the ports that are used here."""
        for default, port in self.ports.items():
            text = text.replace(default, port)
        zenoh, tcp = self.ports["7470"], self.ports["7448"]
        for pattern, there in (
            (r"\b(uuv\.connect|connect_async)\((?!port)", rf"\1(port={zenoh}, "),
            (r"\buuvsim\.connect\(\)", f"uuvsim.connect('port', {tcp})"),
            (r"\buuvsim\.connect\((?!'port'|'host')", f"uuvsim.connect('port', {tcp}, "),
            (r'\(Hold, "hold"\)', f'(Hold, "hold", port={self.remote})'),
            (r"remote:hold\b", f"remote:hold@127.0.0.1:{self.remote}"),
        ):
            text = re.sub(pattern, there, text)
        return text

    def _beside(self, process: subprocess.Popen[str]) -> None:
        """Wait until a component that was started is there."""
        while process.poll() is None:
            with contextlib.suppress(ConnectionRefusedError):
                socket.create_connection(("127.0.0.1", int(self.remote))).close()
                return
        pytest.fail(f"it ended: {process.communicate()[0]}")

    def _started(self, arguments: list[str], **more: Any) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **more
        )
        self._stack.callback(ended, process)
        return process


def ended(process: subprocess.Popen[str]) -> None:
    process.terminate()
    process.communicate(timeout=30)


def free_port() -> str:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return str(s.getsockname()[1])


def blocks(page: str) -> Iterator[Block]:
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    for found in BLOCK.finditer(text):
        line = text.count("\n", 0, found.start("language")) + 1
        yield Block(found["language"], found["text"], found["note"] or "", line)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Place]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    with ExitStack() as stack:
        yield Place(tmp_path, stack)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_a_page_works_by_copy_and_paste(page: str, place: Place) -> None:
    output = ""
    for block in blocks(page):
        where = f"{page}.md:{block.line}"
        if block.note.startswith("file: "):
            name = block.note.removeprefix("file: ")
            Path(name).write_text(place.elsewhere(block.text), encoding="utf-8")
        elif block.note == "output":
            assert_shown(block.text, output, where)
        elif block.language == "bash":
            output = "".join(place.bash(x) for x in block.text.splitlines() if x.strip())
        elif block.language == "python":
            text = place.elsewhere(block.text)
            output = executed(Block("python", text, "", block.line), page, place.namespace)
        elif block.language == "matlab":
            if not PACKAGE:
                pytest.skip("GNU Octave is not installed: MATLAB blocks were not run")
            output = place.matlab(block.text)
        else:
            assert block.language in ("text", "json", "yaml"), f"{where}: {block.language}"


def test_each_page_has_blocks_that_run() -> None:
    for page in PAGES:
        assert any(b.language in ("bash", "python", "matlab") for b in blocks(page)), page
