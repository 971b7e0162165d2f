from __future__ import annotations

import io
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.importer.archive import shown, unpack

DESCRIPTION = ("modelDescription.xml", b"<fmiModelDescription/>")


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UUVSIM_CACHE", str(tmp_path / "cache"))


def write(path: Path, *members: tuple[str | zipfile.ZipInfo, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members:
            archive.writestr(name, data)
    return path


def left_behind(tmp_path: Path) -> list[str]:
    return [p.name for p in (tmp_path / "cache").glob("archives/*")]


def test_members_are_unpacked_with_their_contents(tmp_path: Path) -> None:
    fmu = write(tmp_path / "x.fmu", DESCRIPTION, ("resources/a/b.txt", b"hello"))
    assert (unpack(fmu) / "resources" / "a" / "b.txt").read_bytes() == b"hello"


def test_equal_content_is_unpacked_once(tmp_path: Path) -> None:
    first = write(tmp_path / "x.fmu", DESCRIPTION, ("resources/", b""))  # with a folder's entry
    folder = unpack(first)
    (folder / "mark").touch()
    second = tmp_path / "copy.fmu"
    second.write_bytes(first.read_bytes())
    assert unpack(second) == folder
    assert (folder / "mark").exists()
    assert left_behind(tmp_path) == [folder.name]


def test_changed_content_is_unpacked_anew(tmp_path: Path) -> None:
    fmu = write(tmp_path / "x.fmu", DESCRIPTION, ("a", b"1"))
    first = unpack(fmu)
    write(fmu, DESCRIPTION, ("a", b"2"))
    assert (unpack(fmu) / "a").read_bytes() == b"2"
    assert (first / "a").read_bytes() == b"1"


def test_a_half_deleted_folder_is_unpacked_again(tmp_path: Path) -> None:
    fmu = write(tmp_path / "x.fmu", DESCRIPTION, ("a", b"1"))
    (unpack(fmu) / "modelDescription.xml").unlink()
    assert (unpack(fmu) / "modelDescription.xml").is_file()


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


def overwrite(path: Path) -> None:
    path.write_bytes(b"x" * path.stat().st_size)


def become_a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize("damage", [Path.unlink, truncate, overwrite, become_a_folder])
@pytest.mark.parametrize("member", ["modelDescription.xml", "binaries/linux64/x.so"])
def test_a_damaged_folder_is_unpacked_again(
    damage: Callable[[Path], None], member: str, tmp_path: Path
) -> None:
    fmu = write(tmp_path / "x.fmu", DESCRIPTION, ("binaries/linux64/x.so", b"code"))
    folder = unpack(fmu)
    whole = (folder / member).read_bytes()
    damage(folder / member)
    assert unpack(fmu) == folder
    assert (folder / member).read_bytes() == whole
    assert left_behind(tmp_path) == [folder.name]


def test_a_file_in_the_place_of_the_folder_is_replaced(tmp_path: Path) -> None:
    fmu = write(tmp_path / "x.fmu", DESCRIPTION)
    folder = unpack(fmu)
    (folder / "modelDescription.xml").unlink()
    folder.rmdir()
    folder.write_text("junk")
    assert (unpack(fmu) / "modelDescription.xml").is_file()


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_member_that_is_there_twice_is_unpacked_once(tmp_path: Path) -> None:
    fmu = write(tmp_path / "x.fmu", DESCRIPTION, ("a", b"1"), ("a", b"22"))
    folder = unpack(fmu)
    (folder / "mark").touch()
    assert (unpack(fmu) / "a").read_bytes() == b"22"
    assert (folder / "mark").exists()


def test_a_file_of_an_archive_is_shown_by_the_archive_also_when_nested(tmp_path: Path) -> None:
    inner = write(tmp_path / "inner.fmu", DESCRIPTION)
    outer = tmp_path / "outer.ssp"
    write(outer, ("SystemStructure.ssd", b"<a/>"), ("resources/inner.fmu", inner.read_bytes()))
    nested = unpack(outer) / "resources" / "inner.fmu"
    assert shown(unpack(nested) / "a.xml") == f"{outer}/resources/inner.fmu/a.xml"
    assert shown(inner) == str(inner)


@pytest.mark.parametrize(
    "name",
    ["../evil", "a/../../evil", "/etc/evil", "C:/evil", "c:evil", "a\\..\\evil", "\\\\host\\evil"],
)
def test_members_that_would_leave_their_folder_are_refused(tmp_path: Path, name: str) -> None:
    fmu = write(tmp_path / "x.fmu", DESCRIPTION, (name, b"evil"))
    with pytest.raises(FmuError, match="would leave its folder; expected a relative name"):
        unpack(fmu)
    assert left_behind(tmp_path) == []
    assert not list(tmp_path.glob("**/evil"))


def test_archives_with_the_separators_of_windows_are_unpacked(tmp_path: Path) -> None:
    folder_ = ("binaries\\win64\\", b"")
    fmu = write(tmp_path / "x.fmu", DESCRIPTION, folder_, ("resources\\deep\\y.txt", b"a"))
    folder = unpack(fmu)
    assert (folder / "resources" / "deep" / "y.txt").read_bytes() == b"a"
    assert (folder / "binaries" / "win64").is_dir()


def test_symbolic_links_are_refused(tmp_path: Path) -> None:
    link = zipfile.ZipInfo("link")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    fmu = write(tmp_path / "x.fmu", DESCRIPTION, (link, b"/etc/passwd"))
    with pytest.raises(FmuError, match="'link' is a symbolic link"):
        unpack(fmu)


def test_an_archive_bomb_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    fmu = write(tmp_path / "x.fmu", DESCRIPTION, ("zeros", bytes(100 * 1024**2)))
    with pytest.raises(FmuError, match=r"archive bomb, unpacks to .* times its size"):
        unpack(fmu)
    assert left_behind(tmp_path) == []


def test_an_archive_that_unpacks_to_too_much_is_refused_whatever_its_ratio(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uuvsim_cosim.fmus.importer.archive.MAX_BYTES", 1000)
    fmu = write(tmp_path / "x.fmu", ("a", bytes(range(256)) * 4))
    with pytest.raises(FmuError, match="an archive bomb, 1024 bytes unpacked; expected at most"):
        unpack(fmu)


def test_a_bomb_of_members_is_refused(tmp_path: Path) -> None:
    many = [(str(i), b"") for i in range(50_001)]
    with pytest.raises(FmuError, match="50002 members; expected at most 50000"):
        unpack(write(tmp_path / "x.fmu", DESCRIPTION, *many))


def test_a_member_that_lies_about_its_size_is_refused(tmp_path: Path) -> None:
    fmu = write(tmp_path / "x.fmu", DESCRIPTION, ("a", bytes(10_000)))
    data = bytearray(fmu.read_bytes())
    size = (10_000).to_bytes(4, "little")
    at = data.find(size)
    while at >= 0:
        data[at : at + 4] = (10).to_bytes(4, "little")
        at = data.find(size, at)
    fmu.write_bytes(data)
    with pytest.raises(FmuError, match="corrupt"):
        unpack(fmu)
    assert left_behind(tmp_path) == []


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04 but no more"])
def test_what_is_no_archive_is_refused(tmp_path: Path, content: bytes) -> None:
    fmu = tmp_path / "x.fmu"
    fmu.write_bytes(content)
    with pytest.raises(FmuError, match=r"x\.fmu: (not a zip|a corrupt) archive"):
        unpack(fmu)


@pytest.mark.parametrize("fraction", [0.3, 0.6, 0.95])
def test_a_truncated_archive_is_refused(tmp_path: Path, fraction: float) -> None:
    fmu = write(tmp_path / "x.fmu", DESCRIPTION, ("a", bytes(range(256)) * 40))
    data = fmu.read_bytes()
    fmu.write_bytes(data[: int(fraction * len(data))])
    with pytest.raises(FmuError, match="corrupt archive"):
        unpack(fmu)


def test_a_damaged_member_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(*DESCRIPTION)
        archive.writestr("a", b"precious data")
    fmu = tmp_path / "x.fmu"
    fmu.write_bytes(buffer.getvalue().replace(b"precious", b"precioux"))
    with pytest.raises(FmuError, match="corrupt"):
        unpack(fmu)
    assert left_behind(tmp_path) == []


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match=r"gone\.fmu: no such file"):
        unpack(tmp_path / "gone.fmu")


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match="cannot be read"):
        unpack(tmp_path)


@pytest.mark.parametrize(
    ("name", "member"), [("x.fmu", "modelDescription.xml"), ("x.ssp", "SystemStructure.ssd")]
)
def test_an_archive_without_its_main_member_is_refused(
    tmp_path: Path, name: str, member: str
) -> None:
    with pytest.raises(FmuError, match=f"has no {member}"):
        unpack(write(tmp_path / name, ("other", b"")))
