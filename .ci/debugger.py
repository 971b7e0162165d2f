"""Check that the launch configuration of a workspace stops at a breakpoint in a component.

    python .ci/debugger.py [FOLDER]

FOLDER holds debugpy; without one, pip installs it into a temporary folder. The program and its
arguments are those of `.vscode/launch.json`, as `uuvsim new --workspace` writes it.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

Message = dict[str, Any]


class Adapter:
    """A connection to debugpy by the debug adapter protocol."""

    def __init__(self, port: int, program: subprocess.Popen[bytes]) -> None:
        self.numbers = count(1)
        while True:  # debugpy listens once it has been imported
            try:
                self.socket = socket.create_connection(("127.0.0.1", port))
                break
            except ConnectionRefusedError:
                if program.poll() is not None:
                    sys.exit("the program ended before the debugger could connect")
        self.file = self.socket.makefile("rb")

    def send(self, command: str, **arguments: Any) -> None:
        """Send a request."""
        request = {"seq": next(self.numbers), "type": "request", "command": command,
                   "arguments": arguments}  # fmt: skip
        body = json.dumps(request).encode()
        self.socket.sendall(b"Content-Length: %d\r\n\r\n" % len(body) + body)

    def wait(self, wanted: Callable[[Message], bool]) -> Message:
        """Read messages until the wanted one."""
        while True:
            size = 0
            while head := self.file.readline().strip():
                if head.lower().startswith(b"content-length:"):
                    size = int(head.partition(b":")[2])
            message: Message = json.loads(self.file.read(size)) if size else {"event": "exited"}
            if message.get("event") in ("exited", "terminated"):
                sys.exit("the run ended without a stop at the breakpoint")
            if wanted(message):
                return message

    def ask(self, command: str, **arguments: Any) -> Message:
        """Send a request and return the body of its response."""
        self.send(command, **arguments)
        response = self.wait(lambda m: m["type"] == "response" and m["command"] == command)
        if not response["success"]:
            sys.exit(f"{command}: {response.get('message')}")
        return dict(response.get("body") or {})


def main() -> None:
    """Write a workspace, debug its first configuration, and look at the place of the stop."""
    with tempfile.TemporaryDirectory() as scratch:
        site = Path(sys.argv[1] if len(sys.argv) > 1 else f"{scratch}/site").resolve()
        if not (site / "debugpy").is_dir():
            pip = [sys.executable, "-m", "pip", "install", "-q", "--target", str(site), "debugpy"]
            subprocess.run(pip, check=True)
        uuvsim = [sys.executable, "-m", "uuvsim_cosim"]
        new = [*uuvsim, "new", "--workspace", "work", "--quiet"]
        subprocess.run(new, cwd=scratch, check=True)
        work = Path(scratch).resolve() / "work"
        launch = json.loads((work / ".vscode" / "launch.json").read_text(encoding="utf-8"))
        chosen = launch["configurations"][0]
        file = work / "my_controller.py"
        lines = file.read_text(encoding="utf-8").splitlines()
        line = next(n for n, text in enumerate(lines, 1) if "tau = " in text)
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        paths = [str(site), *filter(None, [os.environ.get("PYTHONPATH")])]
        with subprocess.Popen(
            [sys.executable, "-m", "debugpy", "--listen", str(port), "--wait-for-client",
             "-m", chosen["module"], *chosen["args"]],
            cwd=work,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        ) as program:  # fmt: skip
            try:
                adapter = Adapter(port, program)
                adapter.ask("initialize", adapterID="check", pathFormat="path")
                adapter.send("attach", justMyCode=chosen["justMyCode"])
                adapter.wait(lambda m: m.get("event") == "initialized")
                adapter.ask("setBreakpoints", source={"path": str(file)},
                            breakpoints=[{"line": line}])  # fmt: skip
                adapter.send("configurationDone")
                stop = adapter.wait(lambda m: m.get("event") == "stopped")["body"]
                frames = adapter.ask("stackTrace", threadId=stop["threadId"])["stackFrames"]
                place = (Path(frames[0]["source"]["path"]).name, frames[0]["line"])
                inputs = adapter.ask("evaluate", expression="sorted(u)", frameId=frames[0]["id"])
            finally:
                program.kill()
    if place != (file.name, line):
        sys.exit(f"stopped at {place}; expected {file.name}, {line}")
    print(f"debugpy: stopped at {place[0]}:{place[1]}, inputs {inputs['result']}")


if __name__ == "__main__":
    main()
