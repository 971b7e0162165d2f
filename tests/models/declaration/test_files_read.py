import json
import os
import pickle
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.models.declaration import files_read
from uuvsim_cosim.models.declaration.files_read import (
    _Basis,
    kept_until_changed,
    noted,
    shared_until_changed,
)
from uuvsim_cosim.models.declaration.library import available
from uuvsim_cosim.orchestrator.system.sources import ModelSource, _declared

EVERY_FILE_IS_NOTED = """
import os, sys
from pathlib import Path
from uuvsim_cosim.models.declaration import files_read
from uuvsim_cosim.models.declaration.library import available, declare_source

opened = set()
def hook(event, arguments):
    if event == "open" and isinstance(arguments[0], str) and Path(arguments[0]).suffix in (
        ".yaml", ".json", ".npz", ".csv", ".nc", ".stl", ".obj", ".txt", ".xml", ".gltf", ".bin"
    ):
        opened.add(Path(arguments[0]).absolute())
sys.addaudithook(hook)
further = ["multibeam?scene=tacoma", "altimeter?scene=tacoma", "policy", "imu@stim300"]
for name in [*available(), *further, *sys.argv[1:]]:
    opened.clear()
    basis = files_read._Basis()
    token = files_read._reading.set(basis)
    declare_source(name)
    files_read._reading.reset(token)
    missing = {  # python-control imports matplotlib, which lists its fonts
        str(p) for p in opened - set(basis.files)
        if "site-packages" not in str(p) and "fontlist" not in p.name
    }
    assert not missing, (name, missing)
print("all noted")
"""


def test_a_result_is_shared_until_its_file_changes(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    calls: list[str] = []

    @shared_until_changed
    def text(name: str) -> str:
        calls.append(name)
        return noted(tmp_path / name).read_text()

    @shared_until_changed
    def twice(name: str) -> str:
        return 2 * text(name)

    with pytest.raises(FileNotFoundError):
        twice("a.txt")
    file.write_text("1")
    assert [twice("a.txt"), twice("a.txt"), text("a.txt")] == ["11", "11", "1"]
    assert calls == ["a.txt"] * 2
    before = file.stat()
    file.write_text("2")
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns + 1))
    assert twice("a.txt") == "22"  # it knows the files of what it calls, shared or not


def scene_with_gltf(folder: Path, size: float) -> Path:
    """Write a scene with a box [m] whose buffer is in a subfolder."""
    trimesh = pytest.importorskip("trimesh", reason="the extra `scene` is not installed")
    (folder / "sub").mkdir(parents=True, exist_ok=True)
    parts = trimesh.creation.box((size, 1, 1)).export(file_type="gltf")
    for name, data in parts.items():
        if name.endswith(".gltf"):
            text = json.loads(data)
            for buffer in text["buffers"]:
                buffer["uri"] = f"sub/{buffer['uri']}"
            (folder / "a.gltf").write_text(json.dumps(text))
        else:
            (folder / "sub" / name).write_bytes(data)
    (folder / "scene.yaml").write_text(
        'id: g\ndescription: a box\nsource: drawn\nunits: "m, rad"\nobstacles: []\n'
        "meshes:\n  - {file: a.gltf, position: [0, 0, 5]}\n"
    )
    return folder


def test_every_file_that_a_declaration_reads_is_noted(tmp_path: Path) -> None:
    scene = scene_with_gltf(tmp_path / "g", 2.0)
    done = subprocess.run(
        [sys.executable, "-c", EVERY_FILE_IS_NOTED, f"multibeam?scene={scene}"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout == "all noted\n", done.stderr


def test_an_edited_buffer_of_a_mesh_changes_the_declaration(tmp_path: Path) -> None:
    source = ModelSource(f"model:multibeam?scene={scene_with_gltf(tmp_path / 'g', 2.0)}")
    first = source.lowered().token
    scene_with_gltf(tmp_path / "g", 3.0)
    assert source.lowered().token != first


def forget(function: object) -> None:
    """Forget what the process has kept, as a new process would; the cache's files stay."""
    shared = getattr(function, "__closure__", ())
    for cell in shared:
        if isinstance(cell.cell_contents, dict):
            cell.cell_contents.clear()


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UUVSIM_CACHE", str(tmp_path / "cache"))


class Texts:
    """A kept function that reads a text file; `calls` lists the files that it has read itself."""

    def __init__(self) -> None:
        self.calls: list[str] = []

        @kept_until_changed
        def text(name: str) -> str:
            self.calls.append(name)
            return noted(Path(name).expanduser()).read_text()

        self.in_this_process = text

    def in_another_process(self, name: Path | str) -> str:
        forget(self.in_this_process)
        return self.in_this_process(str(name))


@pytest.mark.usefixtures("own_cache")
def test_a_result_in_the_cache_is_used_until_one_of_its_files_changes(tmp_path: Path) -> None:
    texts, file = Texts(), tmp_path / "a.txt"
    file.write_text("1")
    assert texts.in_another_process(file) == texts.in_another_process(file) == "1"
    assert len(texts.calls) == 1
    file.write_text("22")
    assert texts.in_this_process(str(file)) == "22"
    for kept in (tmp_path / "cache" / "results").iterdir():
        kept.write_bytes(b"damaged")
    assert texts.in_another_process(file) == "22"
    assert len(texts.calls) == 3


@pytest.mark.usefixtures("own_cache")
def test_an_edit_whose_time_is_set_back_is_seen(tmp_path: Path) -> None:
    texts, file = Texts(), tmp_path / "a.txt"
    file.write_text("1")
    before = file.stat()
    assert texts.in_another_process(file) == "1"
    while file.stat().st_ctime_ns == before.st_ctime_ns:  # it counts in ticks of the kernel
        file.write_text("2")
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert texts.in_another_process(file) == "2"


@pytest.mark.usefixtures("own_cache")
def test_a_home_means_another_file_for_another_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = Texts()
    for name in ("ann", "bob"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.txt").write_text(name)
        monkeypatch.setenv("HOME", str(tmp_path / name))
        monkeypatch.setenv("USERPROFILE", str(tmp_path / name))  # Windows
        assert texts.in_another_process("~/a.txt") == name


@pytest.mark.usefixtures("own_cache")
def test_a_kept_result_with_other_bytes_or_from_others_is_not_used(tmp_path: Path) -> None:
    @kept_until_changed
    def number(text: str) -> float:
        return float(text)

    assert number("31.479") == 31.479
    (file,) = (tmp_path / "cache" / "results").iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole.replace(struct.pack(">d", 31.479), struct.pack(">d", 99.0)))
    assert file.read_bytes() != whole
    forget(number)
    assert number("31.479") == 31.479
    data = pickle.dumps((7.0, _Basis()))
    file.write_bytes(content_hash([data]).encode() + b"\n" + data)  # as another user could
    forget(number)
    assert number("31.479") == 7.0
    if os.name == "posix":
        file.chmod(0o666)
        forget(number)
        assert number("31.479") == 31.479


@pytest.mark.usefixtures("own_cache")
def test_a_relative_path_means_another_file_in_another_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts = Texts()
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.txt").write_text(name)
        monkeypatch.chdir(tmp_path / name)
        assert texts.in_another_process("a.txt") == texts.in_another_process("a.txt") == name


@pytest.mark.usefixtures("own_cache")
def test_a_process_that_may_run_older_code_than_its_files_keeps_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    texts, file = Texts(), tmp_path / "a.txt"
    file.write_text("1")
    monkeypatch.setattr(files_read, "_BEGAN", 0)  # all files of the package are newer
    files_read._program.cache_clear()
    try:
        assert texts.in_another_process(file) == texts.in_another_process(file) == "1"
    finally:
        files_read._program.cache_clear()
    assert len(texts.calls) == 2
    assert not (tmp_path / "cache").exists()


def test_a_cache_that_cannot_be_written_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("UUVSIM_CACHE", str(tmp_path / "file" / "cache"))

    @kept_until_changed
    def length(text: str) -> int:
        return len(text)

    assert length("abc") == 3


def test_kept_descriptions_are_those_of_the_declarations() -> None:
    for name in available():
        source = ModelSource(f"model:{name}")
        source.describe()  # kept, if it was not
        assert repr(source.describe()) == repr(_declared(source).description), name


def test_an_fmu_that_was_deleted_or_changed_is_built_again() -> None:
    source = ModelSource("model:pressure")
    fmu = source.fmu()
    before = fmu.read_bytes()
    fmu.unlink()
    assert source.fmu().read_bytes() == before
    fmu.write_bytes(b"damaged")
    assert source.fmu().read_bytes() == before
