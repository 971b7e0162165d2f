"""Citations of a system: each source once, with the components that use it, as BibTeX."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from uuvsim_cosim._version import __version__
from uuvsim_cosim.models.citing.bibliography import Entry, bibliography
from uuvsim_cosim.models.citing.component_sources import Cited, sources_of
from uuvsim_cosim.models.declaration.library import IN_PROCESS

__all__ = ["Citations", "citations"]

OWN = (
    "@misc{uuvsim_cosim,\n"
    "  author = {{The uuvsim-cosim maintainers}},\n"
    "  title = {{uuvsim-cosim: unmanned underwater vehicles as a co-simulation of exchangeable "
    "FMI components}},\n"
    f"  howpublished = {{Software, version {__version__}}},\n"
    "  year = {2026},\n"  # that of `date-released` in CITATION.cff
    "  note = {The simulation}\n}\n"
)
Uses = Mapping[str, tuple[str, ...]]  # component: parameter sets, presets and equations


@dataclass(frozen=True)
class Citations:
    """The entries that a system cites with their uses, and what has no entry."""

    entries: tuple[tuple[Entry, Uses], ...]
    own: tuple[tuple[str, Uses], ...]  # (meaning of a source that is nobody else's, uses)
    unresolved: tuple[tuple[str, Uses], ...]  # (text of a source, uses)

    def bibtex(self, title: str) -> str:
        """Return a BibTeX file: comments, the entry of this software, an entry for each source."""
        head = [f"Sources of {title}, by uuvsim-cosim {__version__}."]
        if self.own:
            head += ["", "Numbers that are nobody else's have no entry:"]
            head += [f"  {meaning}: {_used(uses)}" for meaning, uses in self.own]
        if self.unresolved:
            head += ["", "Sources that could not be resolved to an entry:"]
            head += [f"  {text}: {_used(uses)}" for text, uses in self.unresolved]
        # BibTeX ignores text between entries, but begins an entry at each @.
        comments = "".join(f"% {line}".rstrip().replace("@", "(at)") + "\n" for line in head)
        entries = (entry.bibtex(f"Used by {_used(uses)}") for entry, uses in self.entries)
        return "\n".join([comments, OWN, *entries])


def citations(components: Mapping[str, str], drawn: Iterable[Cited] = ()) -> Citations:
    """Collect the sources of components, ``{path: source}`` as in a system.

    `drawn` are the sources of parameters that a study draws. A component that is no declaration,
    such as an FMU, states no sources and is unresolved.
    """
    known = bibliography()
    found: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    own: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    unresolved: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    stated: dict[str, Iterable[Cited]] = {}
    for path, source in components.items():
        if source.startswith("function:"):  # a sum of signals
            continue
        if not source.startswith("model:") and source not in IN_PROCESS.values():
            nothing = f"{source} states no sources"
            stated[path] = [Cited(nothing, source, "the whole component")]
        else:
            stated[path] = sources_of(source)
    stated |= {"draws of the study": drawn}
    for path, texts in stated.items():
        for cited in texts:
            keys = [entry.key for entry in known.cited_in(cited.text, cited.place)]
            for key in keys:
                found[key][path].append(cited.what)
            if keys or cited.is_equations:
                continue
            meaning = known.own_meaning(cited.text)
            (own[meaning] if meaning else unresolved[" ".join(cited.text.split())])[path].append(
                cited.what
            )
    return Citations(
        tuple((entry, _unique(found[key])) for key, entry in known.entries.items() if key in found),
        tuple((meaning, _unique(uses)) for meaning, uses in own.items()),
        tuple((text, _unique(uses)) for text, uses in unresolved.items()),
    )


def _unique(uses: Mapping[str, Iterable[str]]) -> Uses:
    return {path: tuple(dict.fromkeys(whats)) for path, whats in uses.items()}


def _used(uses: Uses) -> str:
    """Return the uses as text; components that use the same are named together."""
    together: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for path, whats in uses.items():
        together[whats].append(path)
    return "; ".join(
        f"{', '.join(_ranges(paths))} ({_listed(whats)})" for whats, paths in together.items()
    )


def _listed(whats: Iterable[str]) -> str:
    modules = [what for what in whats if what.endswith(".py")]
    parts = [what for what in whats if not what.endswith(".py")]
    return ", ".join([*parts, f"equations in {', '.join(modules)}"] if modules else parts)


def _ranges(paths: list[str]) -> list[str]:
    """Return names in which consecutive numbers are joined: ``thruster_1 to thruster_8``."""
    shown: list[list[str]] = []
    for path in paths:
        last = re.fullmatch(r"(.*?)(\d+)", shown[-1][-1]) if shown else None
        if last and path == f"{last[1]}{int(last[2]) + 1}":
            shown[-1].append(path)
        else:
            shown.append([path])
    return [p[0] if len(p) == 1 else f"{p[0]} to {p[-1]}" for p in shown]
