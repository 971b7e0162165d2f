"""Bibliography of the models: the entries of ``models/sources.yaml``, and their BibTeX text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase

from uuvsim_cosim.content import content
from uuvsim_cosim.models.declaration.files_read import shared_until_changed
from uuvsim_cosim.models.declaration.parameter_files import read_yaml

__all__ = ["Bibliography", "Entry", "bibliography", "escaped"]


@dataclass(frozen=True)
class Entry:
    """One source: its BibTeX key, type and fields, and the short forms that stand for it."""

    key: str
    type: str
    fields: Mapping[str, str]
    cited_as: tuple[tuple[str, str], ...]  # (short form, files where it counts)

    def bibtex(self, note: str = "") -> str:
        """Return the entry as BibTeX; `note` is added to its own note."""
        fields = dict(self.fields)
        notes = [text for text in (fields.pop("note", ""), note) if text]
        lines = [f"  {name} = {{{_value(name, text)}}}" for name, text in fields.items()]
        if notes:
            lines.append(f"  note = {{{escaped('. '.join(n[0].upper() + n[1:] for n in notes))}}}")
        return f"@{self.type}{{{self.key},\n" + ",\n".join(lines) + "\n}\n"


@dataclass(frozen=True)
class Bibliography:
    """Entries by key, and how a source begins that names nobody else's work."""

    entries: Mapping[str, Entry]
    own: tuple[tuple[str, str], ...]  # (beginning, meaning)

    def cited_in(self, text: str, place: str) -> Iterator[Entry]:
        """Yield the entries that a text cites; `place` is its file, relative to the repository."""
        words = " ".join(text.split())
        for entry in self.entries.values():
            if any(form in words and fnmatchcase(place, files) for form, files in entry.cited_as):
                yield entry

    def own_meaning(self, text: str) -> str | None:
        """Return what a source means that names nobody else's work; None if it is none."""
        words = " ".join(text.split())
        return next((meaning for begin, meaning in self.own if words.startswith(begin)), None)


@shared_until_changed
def bibliography() -> Bibliography:
    """Read ``models/sources.yaml``."""
    data = read_yaml(content("models", "sources.yaml"), "sources.schema.json")
    entries = {}
    for key, given in data["entries"].items():
        fields = {
            name: " and ".join(map(_author, value)) if name == "author" else str(value)
            for name, value in given.items()
            if name not in ("type", "cited_as")
        }
        forms = tuple(
            (form, "*") if isinstance(form, str) else (str(form["text"]), str(form["in"]))
            for form in given["cited_as"]
        )
        entries[str(key)] = Entry(str(key), str(given["type"]), fields, forms)
    own = tuple((str(o["begins"]), str(o["meaning"])) for o in data["own"])
    return Bibliography(entries, own)


def escaped(text: str) -> str:
    """Return a text in which LaTeX's special characters are escaped."""
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    special |= {c: f"\\{c}" for c in "&%$#_{}"}
    return "".join(special.get(c, c) for c in text)


def _author(name: str) -> str:
    """Return a person as "Family, Given", "others", or an organisation in braces."""
    return name if "," in name or name == "others" else f"{{{name}}}"


def _value(name: str, text: str) -> str:
    if name == "author":  # the braces around organisations stay
        return escaped(text).replace(r"\{", "{").replace(r"\}", "}")
    if name == "title":  # BibTeX styles would write names of vehicles in lower case
        return f"{{{escaped(text)}}}"
    if name == "doi":
        return text
    return escaped(text).replace("-", "--") if name == "pages" else escaped(text)
