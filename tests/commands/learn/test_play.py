"""`uuvsim play` and `uuvsim evaluate`: policies, and the tasks that they were trained in."""

import pytest

from uuvsim_cosim.commands.learn.policies import acting_of
from uuvsim_cosim.errors import InputInvalid


def test_a_policy_of_another_task_is_played_only_if_asked_for() -> None:
    with pytest.raises(InputInvalid, match=r"source_sac: was trained in source, not in target"):
        acting_of(["source_sac"], "target", {}, own_task=True)
    assert acting_of(["source_sac"], "source", {}, own_task=True).name == "source"
    assert acting_of(["source_sac"], "target", {}).name == "target"


def test_the_task_of_a_policy_is_its_own_unless_one_is_named() -> None:
    assert acting_of(["source_sac"], None, {}, own_task=True).name == "source"
