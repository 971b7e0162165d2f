"""Runner of a policy with a memory: n histories of K returns, observations and actions.

The network and the history are those of the vehicle's runner, runner_sequence.py.
"""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.policies.policy import Policy
from uuvsim_cosim.learn.policies.runner_sequence import Remembering

__all__ = ["SequenceRunner", "begin"]


def begin(policy: object) -> None:
    """Clear the memory of a policy that has one, at the start of episodes."""
    if isinstance(policy, SequenceRunner):
        policy.begin()


@final
class SequenceRunner:
    """Acts as a policy of one observation does, and remembers; `begin` before new episodes.

    The return to go falls by `reward` an action, since observations do not tell it. Raises
    InputInvalid for a policy that is no decision transformer, or not all of one.
    """

    def __init__(self, policy: Policy) -> None:
        seen, acts = len(policy.observation), len(policy.action)
        try:
            if policy.kind != "sequence":
                raise ValueError(f"kind {policy.kind!r}")
            self._acts = Remembering(policy.tensors, policy.settings)
            if self._acts.widths[1:] != (seen, acts):
                raise ValueError(f"{self._acts.widths[1:]} numbers for {(seen, acts)}")
            if not np.all(np.isfinite(self._acts(np.zeros((1, seen))))):  # its tensors fit
                raise ValueError("an action that is no number")
        except (KeyError, ValueError, TypeError, IndexError, ZeroDivisionError) as error:
            raise InputInvalid(
                f"policy of {policy.task}",
                error,
                "a decision transformer, with its settings and tensors",
            ) from None
        self.policy = policy
        self.begin()

    def begin(self) -> None:
        """Forget: the next observations are first ones."""
        self._acts.begin()

    def __call__(self, observation: NDArray[np.generic]) -> NDArray[np.float64]:
        """Act on observations (n, width), one action after those before."""
        o = np.asarray(observation, np.float32)
        seen, before = len(self.policy.observation), self._acts.history
        if o.ndim != 2 or o.shape[1] != seen:
            raise InputInvalid(
                f"policy of {self.policy.task}", f"observations of shape {o.shape}", f"(n, {seen})"
            )
        if before and len(before[0]) != len(o):
            raise InputInvalid(
                f"policy of {self.policy.task}",
                f"{len(o)} episodes after {len(before[0])}",
                "as many, or begin()",
            )
        return np.asarray(self._acts(o), np.float64)
