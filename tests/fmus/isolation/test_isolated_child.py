"""The child's side of an isolated component: states that the parent has dropped are freed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.fmus.isolation.isolated_child import Served


def test_a_state_is_kept_until_the_parent_drops_it(first_order_fmi3: Path) -> None:
    served = Served(0, -1)
    fmu = read_fmu(first_order_fmi3)
    served.call("instantiate", (instantiate_fmu, (fmu, "plant")), [])
    served.call("enter_initialization_mode", (0.0, None), [])
    served.call("exit_initialization_mode", (), [])
    first, _ = served.call("get_fmu_state", (), [])
    second, _ = served.call("get_fmu_state", (), [])
    served.call("set_fmu_state", (first,), [])
    served.call("do_step", (0.0, 0.1), [first])
    with pytest.raises(KeyError):
        served.call("set_fmu_state", (first,), [])
    served.call("set_fmu_state", (second,), [])
    kept: dict[int, Any] = served._states
    assert list(kept) == [second]
    served.free()
