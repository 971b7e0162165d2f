"""Conformance suite: which promises of its interface any environment keeps.

python -m uuvsim_cosim.envs.conformance uuvsim/StationKeeping-v0
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from uuvsim_cosim.envs.conformance import claims as general
from uuvsim_cosim.envs.conformance import ends
from uuvsim_cosim.envs.conformance import vector as vectors
from uuvsim_cosim.envs.conformance.subject import Kind, NotApplicable, Subject, Violation
from uuvsim_cosim.envs.conformance.subjects import subjects_of
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["CLAIMS", "Claim", "ConformanceFailed", "Outcome", "Report", "cases", "check", "examine"]

ALL: tuple[Kind, ...] = ("single", "vector", "parallel")
Verdict = Literal["holds", "fails", "not applicable"]
MARKS: dict[Verdict, str] = {"holds": "✓", "fails": "✗", "not applicable": "–"}


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


@dataclass(frozen=True)
class Claim:
    """A claim about environments of some kinds; checked only if the claims in `needs` hold."""

    function: Callable[[Subject], str]
    kinds: tuple[Kind, ...] = ALL
    needs: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The claim's name."""
        return self.function.__name__

    @property
    def sentence(self) -> str:
        """The claim in words."""
        return str(self.function.__doc__)

    def examine(self, subject: Subject, failed: Sequence[str] = ()) -> Outcome:
        """Return whether the claim holds."""
        broken = [n for n in self.needs if n in failed]
        if broken:
            sentence = f"cannot be checked while {broken[0]} fails"
            return Outcome(self.name, subject.kind, "not applicable", sentence)
        try:
            return Outcome(self.name, subject.kind, "holds", self.function(subject))
        except NotApplicable as reason:
            return Outcome(self.name, subject.kind, "not applicable", str(reason))
        except Violation as violation:
            return Outcome(self.name, subject.kind, "fails", str(violation))
        except Exception as error:
            sentence = f"{type(error).__name__}: {error}"
            return Outcome(self.name, subject.kind, "fails", sentence)


SAME = general.same_seed_same_trajectory.__name__
SEED = general.seed_reaches_observations.__name__
MODE = vectors.autoreset_declared.__name__
ROWS = vectors.row_is_single_environment.__name__

# In the order of examination: each claim comes after those that it needs.
CLAIMS: tuple[Claim, ...] = (
    Claim(general.interface, ("single", "parallel")),
    Claim(general.same_seed_same_trajectory),
    Claim(general.seed_reaches_observations, needs=(SAME,)),
    Claim(general.noise_follows_seed, ("single", "parallel"), needs=(SAME, SEED)),
    Claim(general.another_episode_without_seed, needs=(SAME,)),
    Claim(general.interleaved, needs=(SAME,)),
    Claim(general.pickling, ("single", "parallel"), needs=(SAME,)),
    Claim(general.observations_in_space),
    Claim(general.observations_kept),
    Claim(general.actions_unchanged),
    Claim(ends.exact_substeps, ("single", "parallel")),
    Claim(ends.time_limit_is_truncation, ("single", "parallel")),
    Claim(ends.failure_is_termination, ("single", "parallel")),
    Claim(vectors.autoreset_declared, ("vector",)),
    Claim(vectors.row_is_single_environment, ("vector",), needs=(SAME, MODE)),
    Claim(vectors.terminal_observation_kept, ("vector",), needs=(SAME, MODE, ROWS)),
    Claim(vectors.autoreset_obeyed, ("vector",), needs=(SAME, MODE, ROWS)),
    Claim(general.wrong_seed_refused),
    Claim(general.close_twice),
)


def examine(env: object, *, claims: Sequence[str] | None = None, **options: Any) -> Report:
    """Examine an environment and return the report; see `check`."""
    names = [c.name for c in CLAIMS]
    for name in claims or ():
        if name not in names:
            raise InputInvalid(f"no claim {name!r}", f"one of {', '.join(names)}")
    title, subjects = subjects_of(env, **options)
    outcomes: list[Outcome] = []
    for subject in subjects:
        failed: list[str] = []
        for claim in CLAIMS:
            if subject.kind in claim.kinds and (claims is None or claim.name in claims):
                outcomes.append(claim.examine(subject, failed))
                if outcomes[-1].verdict == "fails":
                    failed.append(claim.name)
    return Report(title, tuple(outcomes))


def check(env: object, **options: Any) -> Report:
    """Examine an environment; raise ConformanceFailed, with every failure, if a claim fails.

    `env` is an id registered with Gymnasium, "module:function", or a function without arguments
    that returns a new gymnasium.Env, gymnasium.vector.VectorEnv or pettingzoo.ParallelEnv. Options:

    - `vector` makes a VectorEnv of n environments, `single` one environment of a vector, and
      `failing` an environment in which a component fails;
    - `start` are options of a reset that fix the start;
    - `time` returns the time of an environment [s]; `action_step` [s] and `time_limit` [steps] are
      those of an episode;
    - `steps`, `seed` and `num_envs` are those of the examination;
    - `claims` are the names of the claims to check, by default all; with `strict`, advice on spaces
      counts as a failure.
    """
    report = examine(env, **options)
    if report.failures:
        raise ConformanceFailed(report)
    return report


@dataclass(frozen=True)
class Case:
    """One claim about one environment, as a test: call it."""

    claim: Claim
    subject: Subject

    def __call__(self) -> Outcome:
        """Raise AssertionError if the claim fails."""
        outcome = self.claim.examine(self.subject)
        if outcome.verdict == "fails":
            raise AssertionError(str(outcome))
        return outcome

    def __str__(self) -> str:
        """Return the test's id."""
        return f"{self.subject.kind}-{self.claim.name}"


def cases(env: object, **options: Any) -> list[Case]:
    """Return the claims one by one, as tests.

    >>> @pytest.mark.parametrize("case", cases("uuvsim/StationKeeping-v0"), ids=str)
    ... def test_it_conforms(case):
    ...     case()  # doctest: +SKIP
    """
    _, subjects = subjects_of(env, **options)
    return [Case(c, s) for s in subjects for c in CLAIMS if s.kind in c.kinds]


def main(arguments: Sequence[str] | None = None) -> int:
    """Examine the environments that are named; 0 if all conform."""
    import argparse

    parser = argparse.ArgumentParser(
        prog="python -m uuvsim_cosim.envs.conformance",
        description="Check which promises of its interface an environment keeps.",
    )
    parser.add_argument("env", nargs="*", help='an id of Gymnasium, or "module:function"')
    parser.add_argument("--steps", type=int, default=64, help="steps of a walk")
    parser.add_argument("--num-envs", type=int, default=3, help="rows of the vector")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--claim", action="append", help="only this claim; may be repeated")
    parser.add_argument("--strict", action="store_true", help="advice on spaces counts")
    parser.add_argument("--list", action="store_true", help="list the claims")
    given = parser.parse_args(arguments)
    if given.list or not given.env:
        width = max(len(c.name) for c in CLAIMS)
        sys.stdout.writelines(f"{c.name:{width}}  {c.sentence}\n" for c in CLAIMS)
        return 0 if given.list else 2
    failures = 0
    for env in given.env:
        try:
            report = examine(
                env,
                steps=given.steps,
                num_envs=given.num_envs,
                seed=given.seed,
                claims=given.claim,
                strict=given.strict,
            )
        except InputInvalid as error:
            sys.stderr.write(f"{error}\n")
            return 2
        sys.stdout.write(f"{report}\n")
        failures += len(report.failures)
    return 1 if failures else 0
