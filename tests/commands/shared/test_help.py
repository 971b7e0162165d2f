"""Groups of options in `--help`."""

from typing import Any

import pytest

from tests.conftest import Uuvsim
from uuvsim_cosim.cli import command_tree
from uuvsim_cosim.commands.shared.common_options import GROUPS, walk

COMMANDS = dict(walk(command_tree()))
MOST = 10


def options_of(command: Any) -> list[Any]:
    return [p for p in command.params if p.opts[0].startswith("--") and not p.hidden]


@pytest.mark.parametrize("path", [p for p, c in COMMANDS.items() if len(options_of(c)) > MOST])
def test_every_option_of_a_command_with_many_options_is_in_a_group(path: str) -> None:
    alone = [p.opts[0] for p in options_of(COMMANDS[path]) if p.rich_help_panel is None]
    assert alone == []


@pytest.mark.parametrize("path", GROUPS)
def test_a_group_names_options_of_its_command_once(path: str) -> None:
    named = [option for options in GROUPS[path].values() for option in options]
    assert len(named) == len(set(named))
    assert set(named) <= {p.opts[0] for p in options_of(COMMANDS[path])}


def test_the_help_of_run_shows_its_groups_in_order(uuvsim: Uuvsim) -> None:
    status, out, _ = uuvsim("run", "--help")
    assert status == 0
    headings = [line.split()[1] for line in out.splitlines() if line.startswith("╭─")]
    expected = ["Arguments", "Options", "System", "Time", "Inputs", "Output", "One"]
    assert headings == expected
