"""What a system cites, as BibTeX that a strict parser reads."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from uuvsim_cosim import __version__
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.models.citing.citations import citations

REQUIRED = {
    "article": {"author", "title", "journal", "year"},
    "book": {"author", "title", "year"},
    "inproceedings": {"author", "title", "booktitle", "year"},
    "incollection": {"author", "title", "booktitle", "publisher", "year"},
    "mastersthesis": {"author", "title", "school", "year"},
    "techreport": {"author", "title", "institution", "year"},
    "manual": {"title"},
    "misc": {"title"},
}


def parsed(text: str) -> dict[str, dict[str, str]]:
    """Read BibTeX; text between entries is a comment and holds no @, braces are balanced."""
    entries: dict[str, dict[str, str]] = {}
    at = 0
    while (begin := text.find("@", at)) >= 0:
        assert all(not part or part[0] == "%" for part in text[at:begin].split("\n"))
        head = re.match(r"@([a-z]+)\{([a-z][a-z0-9_]*),\n", text[begin:])
        assert head is not None, text[begin : begin + 80]
        assert head[2] not in entries
        at = begin + head.end()
        fields: dict[str, str] = {}
        while not text.startswith("}\n", at):
            field = re.match(r"  ([a-z]+) = \{", text[at:])
            assert field is not None, text[at : at + 80]
            end, depth = at + field.end(), 1
            while depth:
                escape = text[end] == "\\" and text[end + 1] in "{}"
                depth += 0 if escape else (text[end] == "{") - (text[end] == "}")
                end += 1 + escape
            value = text[at + field.end() : end - 1]
            assert "\n" not in value
            assert value.strip()
            assert not re.search(r"(?<!\\)[&%$#_]", value) or field[1] == "doi"
            fields[field[1]] = value
            assert text[end] in ",\n"
            at = end + (2 if text[end] == "," else 1)
        assert REQUIRED[head[1]] <= set(fields), head[2]
        entries[head[2]] = fields
        at += 2
    assert all(not part or part[0] == "%" for part in text[at:].split("\n"))
    return entries


def test_the_survey_cites_its_hull_its_equations_and_this_software(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert status_of(["cite", "bluerov2_survey"]) == 0
    entries = parsed(capsys.readouterr().out)
    assert entries["von_benzon_2022"]["doi"] == "10.3390/jmse10121898"
    note = entries["von_benzon_2022"]["note"]
    assert r"controller, hull (bluerov2\_heavy@von\_benzon\_2022)" in note
    assert r"thruster\_1 to thruster\_8" in note
    assert "hull/coriolis.py" in entries["fossen_2021"]["note"]
    assert __version__ in entries["uuvsim_cosim"]["howpublished"]
    released = (Path(__file__).parents[3] / "CITATION.cff").read_text(encoding="utf-8")
    assert f"date-released: {entries['uuvsim_cosim']['year']}-" in released
    assert "wu_2018" not in entries


def test_another_parameter_set_cites_other_sources() -> None:
    entries = parsed(citations({"hull": "model:bluerov2_heavy@wu_2018"}).bibtex("it"))
    assert {"wu_2018", "diff_uv", "fossen_2021"} <= set(entries)
    assert "von_benzon_2022" not in entries


def test_options_choose_what_is_cited() -> None:
    scene = parsed(citations({"dvl": "model:dvl@a50?scene=tacoma"}).bibtex("it"))
    assert {"noaa_us5wa22m", "a50_documentation"} <= set(scene)
    assert "noaa_us5wa22m" not in parsed(citations({"dvl": "model:dvl@a50"}).bibtex("it"))


def test_a_component_in_process_is_cited_and_a_sum_has_no_sources() -> None:
    source = "uuvsim_cosim.models.control.mpc_in_process:IpoptMPC"
    found = citations({"mpc": source, "sum": "function:sum?inputs=2"})
    assert {"rawlings_2017", "von_benzon_2022"} <= {entry.key for entry, _ in found.entries}
    assert not found.unresolved


def test_what_cannot_be_resolved_is_a_comment(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    shipped = Path(__file__).parents[3] / "models" / "vehicles" / "sphere" / "parameters.yaml"
    text = shipped.read_text(encoding="utf-8")
    ours = "my own tank test @TUHH 2024"
    changed = text.replace('"solid and uniform: 2/5 m r^2"', f'"{ours}"')
    assert changed != text
    (folder / "parameters.yaml").write_text(changed, encoding="utf-8")
    found = citations({"hull": f"model:vehicle?id={folder}", "bow": "bow.fmu"})
    assert [text for text, _ in found.unresolved] == [ours, "bow.fmu states no sources"]
    written = found.bibtex("it")
    assert "% " in written
    assert "my own tank test (at)TUHH 2024" in written
    assert "lamb_1932" in parsed(written)


def test_each_line_of_a_comment_begins_with_a_percent_sign(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    shipped = Path(__file__).parents[3] / "models" / "vehicles" / "sphere" / "parameters.yaml"
    text = shipped.read_text(encoding="utf-8")
    changed = re.sub(r"citation: .*", "citation: |\n      A tank test\n      of two days", text)
    assert changed != text
    (folder / "parameters.yaml").write_text(changed, encoding="utf-8")
    found = citations({"hull": f"model:vehicle?id={folder}"})
    assert any("A tank test of two days" in source for source, _ in found.unresolved)
    assert parsed(found.bibtex("it"))


def test_a_run_is_cited_into_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import uuvsim_cosim as uuv
    from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd

    run = tmp_path / "run"
    run.mkdir()
    system = uuv.System("s", "0.01").add("hull", "model:sphere")
    write_ssd(system, run / "system.ssd")
    out = tmp_path / "sources.bib"
    assert status_of(["cite", str(run), "-o", str(out), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    entries = parsed(out.read_text(encoding="utf-8"))
    assert [e["key"] for e in shown["entries"]] == [k for k in entries if k != "uuvsim_cosim"]
    assert shown["entries"][0]["used_by"]["hull"]
    assert shown["unresolved"] == []


@pytest.fixture
def edited(tmp_path: Path) -> Path:
    """Write a study of an edited system that keeps the name of the shipped one."""
    import uuvsim_cosim as uuv
    from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd

    boat = uuv.System("bluerov2_hold", "0.01").add("hull", "model:bluerov2_heavy@wu_2018")
    write_ssd(boat, tmp_path / "my.ssd")
    file = tmp_path / "my study.yaml"
    file.write_text(
        "system: my.ssd\nduration: 0.1 s\nmetrics: {depth: 'final(hull.eta[3])'}\n"
        "sets: [{set: published, vehicle: bluerov2_heavy@wu_2018}]\n",
        encoding="utf-8",
    )
    return file


def test_a_study_cites_the_system_that_it_simulates_and_the_sets_that_it_draws_from(
    edited: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import uuvsim_cosim as uuv

    folder = uuv.Study.read(edited).run(edited.parent / "out", jobs=1, progress=False).folder
    (edited.parent / "my.ssd").rename(edited.parent / "moved.ssd")
    assert status_of(["cite", str(folder)]) == 0
    of_folder = parsed(capsys.readouterr().out)
    (edited.parent / "moved.ssd").rename(edited.parent / "my.ssd")
    assert status_of(["cite", str(edited)]) == 0
    of_file = parsed(capsys.readouterr().out)
    assert of_file == of_folder
    assert r"hull (bluerov2\_heavy@wu\_2018" in of_file["wu_2018"]["note"]
    drawn = r"draws of the study (bluerov2\_heavy/published.yaml)"
    assert of_file["von_benzon_2022"]["note"].endswith(f"Used by {drawn}")
    assert drawn in of_file["wu_2018"]["note"]
    (folder / "system.ssd").unlink()
    assert status_of(["cite", str(folder)]) == 2
    assert "expected the system's .ssd or the study's YAML file" in capsys.readouterr().err


def test_a_yaml_file_of_another_form_is_refused_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "training.yaml"
    file.write_text("task: source\nalgorithm: masac\nsteps: 1000\n", encoding="utf-8")
    assert status_of(["cite", str(file)]) == 2
    error = capsys.readouterr().err
    assert error.count("expected") == 1
    assert "a file of the form training; expected a study file" in error


@pytest.mark.parametrize("target", ["no_such_system", "imu@no_such_preset"])
def test_a_name_that_does_not_exist_is_refused(target: str) -> None:
    assert status_of(["cite", target]) == 2


def test_a_name_is_refused_with_near_systems_and_components_and_a_folder_as_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for target, words in (
        ("remus10", "did you mean remus100?"),
        ("bluerov2_hol", "did you mean bluerov2_hold"),
        (str(tmp_path), "a folder without a system that was simulated"),
    ):
        assert status_of(["cite", target]) == 2
        assert words in capsys.readouterr().err
