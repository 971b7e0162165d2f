"""The freeze: names, commands, values, wire formats and model descriptions stay as recorded.

`python -m tests.freeze.record PART` records what is meant to change.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from tests.freeze import descriptions, interface, transcripts, values
from tests.freeze.canary import canary, training_canary, unlike
from tests.freeze.differences import check, differences, read

pytestmark = pytest.mark.slow

Judge = Callable[[Any, Any, dict[str, Any], str, Callable[[Any], Any]], None]


@pytest.fixture
def judge(record_property: Callable[[str, object], None]) -> Judge:
    """Compare values, or only their form if they differ and so does this machine's canary."""

    def compare(
        recorded: Any, now: Any, decides: dict[str, Any], what: str, form: Callable[[Any], Any]
    ) -> None:
        other = unlike(recorded["canary"]["decides"], decides)
        before = recorded[what]
        found = list(differences(before, now, what))
        if not (found and other):
            check(before, now, what)
            return
        check(form(before), form(now), what)
        record_property(
            "not compared",
            f"{len(found)} values differ from the record and are NOT judged, because this machine "
            f"computes other values: {'; '.join(other)}. Names, types and shapes were compared",
        )

    return compare


def test_documented_names_can_be_imported_and_called_as_before() -> None:
    recorded = read("names")
    check(recorded, interface.now(recorded), "names")


def test_each_import_in_the_pages_works() -> None:
    broken = []
    for module, name in sorted(interface.documented()):
        try:
            getattr(import_module(module), name)
        except (ImportError, AttributeError) as error:
            broken.append(f"from {module} import {name}: {error}")
    assert not broken, broken


def test_commands_have_the_same_options() -> None:
    check(read("commands"), interface.commands(), "commands")


def test_entry_points_and_the_content_of_the_wheel_are_the_same() -> None:
    check(read("entry_points"), interface.entry_points(), "entry points")


def test_systems_models_and_environments_have_the_same_names() -> None:
    check(read("content"), interface.content(), "content")


def test_the_functions_of_the_matlab_client_are_called_as_before() -> None:
    check(read("matlab"), interface.matlab(), "matlab")


@pytest.fixture(scope="module")
def recorded_now(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return values.recordings(tmp_path_factory.mktemp("recordings"))


def test_recordings_have_the_same_bits(recorded_now: dict[str, Any], judge: Judge) -> None:
    judge(read("recordings"), recorded_now, canary()["decides"], "systems", values.without_values)


@pytest.mark.parametrize("name", values.SYSTEMS)
def test_fmus_native_components_and_the_kernel_agree_to_the_last_bit(
    name: str, recorded_now: dict[str, Any]
) -> None:
    by_fmu = recorded_now[name]["FMUs"]
    for way in ("native", "kernel"):
        if recorded_now[name][way] != values.AS_FMU:
            check(by_fmu, recorded_now[name][way], f"{name}, {way} against FMUs")


def test_a_training_has_the_same_bits(tmp_path: Path, judge: Judge) -> None:
    decides = {**canary()["decides"], **training_canary()}
    judge(read("training"), values.training(tmp_path), decides, "training", values.without_values)


@pytest.fixture(scope="module")
def spoken(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, list[str]]:
    return transcripts.messages(transcripts.transcripts(tmp_path_factory.mktemp("transcripts")))


@pytest.mark.parametrize("transport", ["TCP", "HTTP", "Zenoh"])
def test_answers_of_each_transport_are_the_same(
    transport: str, spoken: tuple[dict[str, Any], list[str]]
) -> None:
    check(by_request(read("transcripts")[transport]), by_request(spoken[0][transport]), transport)


def by_request(record: list[dict[str, Any]]) -> dict[str, Any]:
    """Return answers by their number and request, so that a difference names it."""
    return {f"{i} {r['request'][0]} {r['request'][1]}": r["answer"] for i, r in enumerate(record)}


def test_refusals_and_descriptions_have_the_same_wording(
    spoken: tuple[Any, list[str]],
) -> None:
    check(read("messages"), spoken[1], "messages of the transports")


def test_model_descriptions_and_archives_are_the_same(tmp_path: Path, judge: Judge) -> None:
    found = {name: (text, files) for name, text, files in descriptions.archives(tmp_path)}
    texts = descriptions.read_texts()
    changed = {name: text for name, (text, _) in found.items() if name in texts}
    shown = [descriptions.first_difference(n, t, texts) for n, t in changed.items()]
    numbers = all(
        descriptions.structure(t) == descriptions.structure(texts[n]) for n, t in changed.items()
    )
    machine = unlike(read("descriptions")["canary"]["decides"], canary()["decides"])
    assert not any(shown) or (numbers and machine), "\n".join(filter(None, shown))[:4000]
    now = descriptions.summary(found)
    judge(
        read("descriptions"),
        now,
        canary()["decides"],
        "archives",
        descriptions.without_values,
    )


def test_the_equations_of_presets_and_options_are_the_same(judge: Judge) -> None:
    recorded = read("sources")
    now = descriptions.tokens(recorded["tokens"])
    judge(recorded, now, canary()["decides"], "tokens", sorted)
