"""Record what must not change: `python -m tests.freeze.record [PART …]`; without parts, all.

Record again only when a change is meant, one part at a time, and say in the commit why the values
changed. `names` and `commands` come from imports, `recordings`, `training`, `transcripts` and
`descriptions` from runs that take about forty processor seconds together.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.freeze import descriptions, interface, transcripts, values
from tests.freeze.canary import canary, training_canary
from tests.freeze.differences import write


def _names(_: Path) -> None:
    write("names", interface.names())
    write("signatures", interface.signatures())
    write("content", interface.content())
    write("matlab", interface.matlab())


def _commands(_: Path) -> None:
    write("commands", interface.commands())
    write("entry_points", interface.entry_points())


def _recordings(folder: Path) -> None:
    write("recordings", {"canary": canary(), "systems": values.recordings(folder)})


def _training(folder: Path) -> None:
    both = {"decides": {**canary()["decides"], **training_canary()}}
    write("training", {"canary": both, "training": values.training(folder)})


def _transcripts(folder: Path) -> None:
    answers, wording = transcripts.messages(transcripts.transcripts(folder))
    write("transcripts", answers)
    write("messages", wording)


def _descriptions(folder: Path) -> None:
    found = {name: (text, files) for name, text, files in descriptions.archives(folder)}
    write("descriptions", {"canary": canary(), "archives": descriptions.summary(found)})
    write(
        "sources",
        {"canary": canary(), "tokens": descriptions.tokens(descriptions.sources())},
    )
    descriptions.write_texts(found)


PARTS: dict[str, Callable[[Path], Any]] = {
    "names": _names,
    "commands": _commands,
    "recordings": _recordings,
    "training": _training,
    "transcripts": _transcripts,
    "descriptions": _descriptions,
}


def main(parts: list[str]) -> None:
    """Record some parts, or all."""
    unknown = [p for p in parts if p not in PARTS]
    if unknown:
        sys.exit(f"{', '.join(unknown)}: no such part; expected some of {', '.join(PARTS)}")
    for part in parts or PARTS:
        with tempfile.TemporaryDirectory() as folder:
            PARTS[part](Path(folder))
        print(f"{part} recorded")


if __name__ == "__main__":
    main(sys.argv[1:])
