"""Check the JSON schemas in an editor's language server: yaml-language-server, from npm.

    python .ci/editor.py [FOLDER]

Without a FOLDER that has it in node_modules, the server is installed into a temporary folder. A
workspace is written by `uuvsim new --workspace` and a vehicle by `uuvsim models new`. In each kind
of file a misspelt key must be reported at its line, and hovering over a key must show its meaning
with unit and default or source.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from itertools import count
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PACKAGE = "yaml-language-server"

# File: text, the misspelt key, then keys with words that hovering over them must show.
CASES: dict[str, tuple[str, str, dict[str, tuple[str, ...]]]] = {
    "my_study.yaml": (
        "system: bluerov2_hold\nduration: 20 s\nseed: 4\n"
        "metrics:\n  error: rms(norm(hull.eta[1:2]))\n",
        "seed",
        {"duration": ("in s", "20 s"), "system": ("name of a shipped one",)},
    ),
    "my_training.yaml": (
        "task: source\nsettings:\n  lr: 0.001\n  gama: 0.9\nevaluate_every: 100\n",
        "gama",
        {"lr": ("Step size of Adam", "Default: 3e-4", "UUVSim paper", "No unit"),
         "evaluate_every": ("Environment steps", "Default: 6400")},
    ),
    "my_curriculum.yaml": (
        "stages:\n  - task: source\n    stepps: 10\n    promotion: {share: 0.9}\n",
        "stepps",
        {"share": ("scripted controller", "Default: 0.9", "No unit")},
    ),
    "access.yaml": (
        "users:\n  ann: {role: owner, passwort: scrypt$1}\nlisten: [127.0.0.1]\n",
        "passwort",
        {"listen": ("Addresses", "Default"), "role": ("steps",)},
    ),
    "my_scenario.yaml": (
        "events:\n  - {at: 20, untill: 60, signal: dvl.t_sample, fault: drop, value: 0.5}\n",
        "untill",
        {"at": ("in s",), "fault": ("probability",)},
    ),
    "mapping.yaml": (
        "scene: tacoma\ncell: 0.1\nsensors:\n  - {component: multibeam, perriod: 0.2}\n",
        "perriod",
        {"cell": ("in m", "Default: 0.1")},
    ),
    "imu.yaml": (
        "id: mine\nkind: imu\ndescription: my own\nparameters:\n"
        "  gyro_rnage: {value: 4, unit: rad/s, source: data sheet}\n"
        "  r_s: {value: [0, 0, 0], unit: m, source: data sheet}\n",
        "gyro_rnage",
        {"r_s": ("Position", "Unit: m"), "source": ("publication",)},
    ),
}  # fmt: skip


class Server:
    """A running language server: requests, and what it publishes of each file."""

    def __init__(self, command: list[str], folder: Path, settings: dict[str, Any]) -> None:
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.settings, self.numbers = settings, count(1)
        self.published: dict[str, list[dict[str, Any]]] = {}
        self.request(
            "initialize",
            processId=None,
            rootUri=folder.as_uri(),
            workspaceFolders=[{"uri": folder.as_uri(), "name": folder.name}],
            capabilities={
                "workspace": {"configuration": True, "workspaceFolders": True},
                "textDocument": {"hover": {"contentFormat": ["markdown"]}},
            },
        )
        self.notify("initialized")
        self.notify("workspace/didChangeConfiguration", settings={"yaml": settings})

    def send(self, message: dict[str, Any]) -> None:
        """Write one message."""
        body = json.dumps({"jsonrpc": "2.0", **message}).encode()
        assert self.process.stdin is not None
        self.process.stdin.write(b"Content-Length: %d\r\n\r\n" % len(body) + body)
        self.process.stdin.flush()

    def read(self) -> dict[str, Any]:
        """Read one message; answer requests of the server, and keep what it publishes."""
        assert self.process.stdout is not None
        size = 0
        while head := self.process.stdout.readline().strip():
            name, _, value = head.partition(b":")
            size = int(value) if name.lower() == b"content-length" else size
        if not size:
            raise RuntimeError(f"{PACKAGE} has ended")
        message: dict[str, Any] = json.loads(self.process.stdout.read(size))
        if message.get("method") == "textDocument/publishDiagnostics":
            self.published[message["params"]["uri"]] = message["params"]["diagnostics"]
        elif "method" in message and "id" in message:
            items = message.get("params", {}).get("items", ())
            found = [self.settings if item.get("section") == "yaml" else {} for item in items]
            self.send({"id": message["id"], "result": found or None})
        return message

    def notify(self, method: str, **params: Any) -> None:
        """Send a notification."""
        self.send({"method": method, "params": params})

    def request(self, method: str, **params: Any) -> Any:
        """Send a request and return its result."""
        number = next(self.numbers)
        self.send({"id": number, "method": method, "params": params})
        while True:
            message = self.read()
            if message.get("id") == number and "method" not in message:
                return message.get("result")

    def mistakes(self, file: Path) -> list[tuple[int, str]]:
        """Open a file and return (line from 1, message) of each diagnostic."""
        uri, text = file.as_uri(), file.read_text(encoding="utf-8")
        document = {"uri": uri, "languageId": "yaml", "version": 1, "text": text}
        self.notify("textDocument/didOpen", textDocument=document)
        while uri not in self.published:
            self.read()
        return [(d["range"]["start"]["line"] + 1, d["message"]) for d in self.published[uri]]

    def hover(self, file: Path, line: int, character: int) -> str:
        """Return what hovering over a place shows; line and character from 0."""
        result = self.request(
            "textDocument/hover",
            textDocument={"uri": file.as_uri()},
            position={"line": line, "character": character},
        )
        return str((result or {}).get("contents", {}).get("value", ""))


def place_of(text: str, key: str) -> tuple[int, int]:
    """Return line and character, from 0, of the first key of this name."""
    for number, line in enumerate(text.splitlines()):
        for before in ("", " ", "{", "- "):
            at = line.find(f"{before}{key}:")
            if at >= 0 and (before or at == 0):
                return number, at + len(before)
    raise ValueError(f"no key {key}")


def check(server: Server, file: Path, wrong: str, hovers: dict[str, tuple[str, ...]]) -> list[str]:
    """Return what is wrong with what the server says of a file."""
    text = file.read_text(encoding="utf-8")
    found, failures = server.mistakes(file), []
    line = place_of(text, wrong)[0] + 1
    if not any(n == line and wrong in message for n, message in found):
        failures.append(f"{file.name}:{line}: {wrong} is not reported, but {found}")
    for key, words in hovers.items():
        line, at = place_of(text, key)
        shown = (
            server.hover(file, line, at + (len(key) > 1)).replace("\\", "").replace("&nbsp;", " ")
        )
        failures += [f"{file.name}: {key} shows {shown!r}, without {w!r}" for w in words
                     if w.lower() not in shown.lower()]  # fmt: skip
    return failures


def main() -> None:
    """Install the server, write the files, and check each of them."""
    with tempfile.TemporaryDirectory() as scratch:
        top = Path(sys.argv[1] if len(sys.argv) > 1 else scratch).resolve()
        script = top / "node_modules" / PACKAGE / "bin" / PACKAGE
        if not script.is_file():
            install = ["npm", "install", "--silent", "--no-audit", "--no-fund", PACKAGE]
            try:
                subprocess.run(install, cwd=top, check=True, timeout=300)
            except (OSError, subprocess.SubprocessError):
                print(f"{PACKAGE} could not be installed: the schemas are not checked in an editor")
                return
        folder = Path(scratch).resolve() / "workspace"
        uuvsim = [sys.executable, "-m", "uuvsim_cosim"]
        for command in (["new", "--workspace", "workspace"],
                        ["models", "new", "my_rov", "--out", "workspace"]):  # fmt: skip
            subprocess.run([*uuvsim, *command, "--quiet"], cwd=scratch, check=True)
        settings = json.loads((folder / ".vscode" / "settings.json").read_text(encoding="utf-8"))
        server = Server(
            ["node", str(script), "--stdio"],
            folder,
            {
                "schemas": settings["yaml.schemas"],
                "schemaStore": {"enable": False},
                "validate": True,
                "hover": True,
            },
        )
        failures = []
        try:
            for name, (text, wrong, hovers) in CASES.items():
                (folder / name).write_text(text, encoding="utf-8")
                failures += check(server, folder / name, wrong, hovers)
            hull = folder / "my_rov" / "parameters.yaml"
            if found := server.mistakes(hull):
                failures.append(f"{hull.name}: as written, {found}")
            vehicle = folder / "my_rov" / "mine.yaml"  # by its modeline alone
            text = hull.read_text(encoding="utf-8").replace("D_q_11:", "Dq_11:", 1)
            vehicle.write_text(text, encoding="utf-8")
            words = {"m": ("Mass", "Unit: kg"), "M_A_11": ("added mass", "Unit: kg"),
                     "source": ("where the size was published",)}  # fmt: skip
            failures += check(server, vehicle, "Dq_11", words)
            shipped = sorted(
                p for d in ("models", "orchestrator") for p in (ROOT / d).rglob("*.yaml")
            )
            for file in shipped:
                failures += [f"{file}:{n}: {message}" for n, message in server.mistakes(file)]
        finally:
            server.process.kill()
    if failures:
        sys.exit("\n".join(failures))
    print(
        f"{PACKAGE}: {len(CASES) + 1} misspelt keys and their files, {len(shipped)} shipped files"
    )


if __name__ == "__main__":
    main()
