"""Each shipped system has a file of its ROS 2 topics: those that `--ros2` publishes without one.

``python -m tests.bridge.ros2.test_shipped_topics`` writes the files again.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from uuvsim_cosim.bridge.ros2.facts import facts_of
from uuvsim_cosim.bridge.ros2.topics import read_topics, topics_of, topics_text, variables_of
from uuvsim_cosim.orchestrator.plan.flatten import plan_to_inspect
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.running.library import available, load

FOLDER = Path(__file__).parents[3] / "orchestrator" / "systems"


def text_of(plan: Plan) -> str:
    text = topics_text(topics_of(variables_of(plan), facts_of(plan)))
    schema = "# yaml-language-server: $schema=../../../models/schema/topics.schema.json"
    return schema + text[text.index("\n") :]


@pytest.mark.parametrize("name", available())
def test_the_file_of_a_shipped_system_has_the_topics_of_its_signals(name: str) -> None:
    plan, file = plan_to_inspect(load(name))[0], FOLDER / name / "topics.yaml"
    assert file.read_text(encoding="utf-8") == text_of(plan), __doc__
    variables, facts = variables_of(plan), facts_of(plan)
    assert list(read_topics(file, variables, facts)) == topics_of(variables, facts)


if __name__ == "__main__":
    for name in available():
        text = text_of(plan_to_inspect(load(name))[0])
        (FOLDER / name / "topics.yaml").write_text(text, encoding="utf-8", newline="\n")
