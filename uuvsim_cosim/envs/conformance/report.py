"""Report of a conformance check: one outcome for each claim, in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from uuvsim_cosim.errors import UuvsimError

__all__ = ["ConformanceFailed", "NotApplicable", "Outcome", "Report", "Verdict", "Violation"]

Verdict = Literal["holds", "fails", "not applicable"]
MARKS: dict[Verdict, str] = {"holds": "✓", "fails": "✗", "not applicable": "–"}


class Violation(Exception):
    """A claim that does not hold; the message has what was seen and what was expected."""


class NotApplicable(Exception):
    """A claim that cannot be checked for this environment; the message has the reason."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of one claim."""

    claim: str
    kind: str  # of environment: single, vector, parallel
    verdict: Verdict
    sentence: str

    def __str__(self) -> str:
        """Return one line."""
        return f"{MARKS[self.verdict]} {self.kind:8} {self.claim}: {self.sentence}"


@dataclass(frozen=True)
class Report:
    """The outcomes of all claims, in the order in which they were checked."""

    name: str
    outcomes: tuple[Outcome, ...]

    @property
    def failures(self) -> tuple[Outcome, ...]:
        """The claims that do not hold."""
        return self.of("fails")

    def of(self, verdict: Verdict) -> tuple[Outcome, ...]:
        """Return the outcomes of one verdict."""
        return tuple(o for o in self.outcomes if o.verdict == verdict)

    def __str__(self) -> str:
        """Return one line for each claim, then the count."""
        held, failed, rest = (len(self.of(v)) for v in MARKS)
        count = f"{self.name}: {held} hold, {failed} fail, {rest} not applicable"
        return "\n".join([*map(str, self.outcomes), count])


class ConformanceFailed(UuvsimError):
    """An environment that does not keep what its interface promises; lists every failure."""

    exit_status = 1

    def __init__(self, report: Report) -> None:
        self.report = report
        lines = "\n  ".join(str(o) for o in report.failures)
        super().__init__(f"{report.name}: {len(report.failures)} claims fail:\n  {lines}")
