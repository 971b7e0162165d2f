"""A symmetry is signs of the right number, told before anything is learned."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.envs import Symmetry
from uuvsim_cosim.errors import InputInvalid


@pytest.mark.parametrize("wrong", [[1, 0], [1, np.nan], "mirror", 1.0, [[1, -1]], [[1], [1, 1]]])
def test_what_is_no_row_of_signs_is_refused(wrong: object) -> None:
    with pytest.raises(InputInvalid, match=r"symmetry 'mirror', action: .*each 1 or -1"):
        Symmetry("mirror", [1, -1], wrong)  # type: ignore[arg-type]


def test_signs_for_other_widths_are_refused_with_both_numbers() -> None:
    mirror = Symmetry("mirror", [1, -1], [-1])
    mirror.check(2, 1)
    with pytest.raises(InputInvalid, match="observation: 2 signs; expected 3"):
        mirror.check(3, 1)
    with pytest.raises(InputInvalid, match="action: 1 signs; expected 2"):
        mirror.check(2, 2)
