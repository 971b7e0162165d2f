"""Reader of YAML files written by users: reports all mistakes with their lines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, final

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import line_of, parsed_yaml

__all__ = ["YamlText", "plain", "shown"]

Place = list[Any]  # keys and indices from the top, such as ["parameters", "hull.m"]


@final
class YamlText:
    """A YAML file, and the mistakes found in it so far; `what` it should be is for errors."""

    def __init__(self, path: Path, what: str = "a YAML file") -> None:
        self.path = path
        self.mistakes: list[tuple[int, str]] = []
        try:
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise InputInvalid(path, f"cannot be read ({error.strerror})", what) from None
        except UnicodeDecodeError as error:
            raise InputInvalid(f"{path}: cannot be read as YAML: {error}") from None
        self.data = parsed_yaml(path, text)

    def wrong(self, place: Place, sentence: str) -> None:
        """Note a mistake at a place."""
        name = ".".join(_named(self.data, place)) or "the file"
        self.mistakes.append((line_of(self.data, place), f"{name}: {sentence}"))

    def refuse(self) -> None:
        """Raise InputInvalid with every mistake, if there are any."""
        if self.mistakes:
            lines = [f"{self.path}:{n}: {text}" for n, text in sorted(set(self.mistakes))]
            raise InputInvalid.of(lines)

    def keys(
        self, place: Place, data: Any, known: Iterable[str], needed: Sequence[str] = ()
    ) -> bool:
        """Return whether something is a mapping; note unknown keys, and those that are missing."""
        known = list(known)
        if not isinstance(data, Mapping):
            read = "a list" if isinstance(data, list) else shown(data)
            self.wrong(place, f"{read}; expected a mapping with {', '.join(known)}")
            return False
        for key in data:
            if key not in known:
                self.wrong([*place, key], f"unknown; expected {expected_names(key, known)}")
        for key in needed:
            if key not in data:
                self.wrong(place, f"has no {key}; expected {', '.join(needed)}")
        return True


def shown(data: Any) -> str:
    """Return what was read, in few words."""
    text = "nothing" if data is None else repr(plain(data))
    return text if len(text) <= 60 else f"{text[:57]}..."


def plain(data: Any) -> Any:
    """Return the contents of a YAML file without their comments and places."""
    if isinstance(data, Mapping):
        return {str(k): plain(v) for k, v in data.items()}
    if isinstance(data, Sequence) and not isinstance(data, str):
        return [plain(v) for v in data]
    if isinstance(data, bool) or data is None:
        return data
    if isinstance(data, int):
        return int(data)
    return float(data) if isinstance(data, float) else str(data)


def _named(data: Any, place: Place) -> Iterable[str]:
    """Name the parts of a place; elements of a list are counted from 1."""
    for part in place:
        yield str(part + 1) if isinstance(data, list) and isinstance(part, int) else str(part)
        try:
            data = data[part]
        except (KeyError, TypeError, IndexError):
            data = None
