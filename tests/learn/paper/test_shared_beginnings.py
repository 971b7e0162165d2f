"""What two ways begin with alike is trained once, and gives what training it again would."""

import json
from pathlib import Path

import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.paper import ways
from uuvsim_cosim.learn.paper.reproduce import begun, reproduce
from uuvsim_cosim.learn.paper.ways import CAREFUL, SCENARIOS, Budget, Chain, place_of
from uuvsim_cosim.learn.training.training import Progress

EVERY = dict.fromkeys((*SCENARIOS, CAREFUL), 80)
TINY = Budget(
    "batched", "as small as can be", 8, EVERY, EVERY,
    {"hidden": 16, "batch": 16, "buffer": 1000, "shared": True}, {"horizon": 4},
)  # fmt: skip
ONE, THREE = ways.TEAMS
FROM_SCRATCH, ALL_STEPS = ways.FROM_SCRATCH[0], ways.OTHERS[0]


class Steps:
    """Counts the steps that were really trained."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, progress: Progress) -> None:
        self.count += progress.what == "step"


def run(chains: tuple[Chain, ...], folder: Path) -> int:
    """Run chains, one after the other; gives the steps trained, of 8 environments each."""
    steps = Steps()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ways, "NEEDS", {"fig8": chains})
        patch.setattr(ways, "FIGURES", ("fig8",))
        reproduce("fig8", TINY, 1, folder / "results", folder / "work", observers=(steps,),
                  episodes=3)  # fmt: skip
    return steps.count


@pytest.fixture(scope="module")
def apart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One tracker, and all steps in the target scenario, each trained alone."""
    folder = tmp_path_factory.mktemp("apart")
    assert run((ONE,), folder) == 30
    assert run((ALL_STEPS,), folder) == 40
    return folder / "results"


@pytest.mark.parametrize(
    ("before", "after", "steps"),
    [(ways.STT, ONE, 50 + 10), (FROM_SCRATCH, ALL_STEPS, 10 + 30), (THREE, ONE, 40 + 30)],
    ids=["the same scenarios", "the same scenario for fewer steps", "nothing alike"],
)
def test_what_is_alike_is_trained_once_to_the_same_bits(
    before: Chain, after: Chain, steps: int, apart: Path, tmp_path: Path
) -> None:
    assert run((before, after), tmp_path) == steps
    kept = sorted(apart.rglob(f"{after.way}-0*"))
    assert len({f.parent.name for f in kept}) == len(after.scenarios)
    for file in kept:
        other = tmp_path / "results" / file.relative_to(apart)
        if file.suffix == ".json":
            mine, its = (json.loads(f.read_text()) for f in (other, file))
            assert mine.pop("cpu") > 0 < its.pop("cpu")
            assert mine == its
        else:
            assert other.read_bytes() == file.read_bytes()


@pytest.mark.parametrize("about", ["", "[]", "{}", '{"done": [1], "curriculum": {"stages": 1}}'])
def test_what_cannot_be_read_of_another_way_is_trained(about: str, tmp_path: Path) -> None:
    other = place_of(tmp_path, TINY, ways.STT, 0)
    other.mkdir(parents=True)
    (other / "curriculum.json").write_text(about)
    assert not begun(tmp_path, TINY, ONE, 0).exists()


def test_a_copy_that_fails_leaves_nothing_and_says_of_what(tmp_path: Path) -> None:
    run((ways.STT,), tmp_path)
    work = tmp_path / "work"
    lost = place_of(work, TINY, ways.STT, 0) / "2-transition_1"
    lost.rename(tmp_path / "elsewhere")
    with pytest.raises(InputInvalid, match=r"masac-one-target-0: the start that it shares"):
        begun(work, TINY, ONE, 0)
    assert [f.name for f in (work / "batched").iterdir()] == ["stt-masac-careful-0"]
    assert not begun(work, TINY, ONE, 1).exists()  # of another seed there is nothing


def test_a_damaged_checkpoint_is_told_by_its_own_name_and_not_copied(tmp_path: Path) -> None:
    run((FROM_SCRATCH,), tmp_path)
    work = tmp_path / "work"
    damaged = place_of(work, TINY, FROM_SCRATCH, 0) / "1-target" / "checkpoint.pt"
    damaged.write_bytes(damaged.read_bytes()[:1000])
    with pytest.raises(InputInvalid, match=r"masac-target-0/1-target/checkpoint\.pt: damaged"):
        begun(work, TINY, ALL_STEPS, 0)
    assert [f.name for f in (work / "batched").iterdir()] == ["scratch-masac-target-0"]
