import os
import subprocess
import sys
from pathlib import Path

import pytest

from uuvsim_cosim.models.declaration.files_read import noted, shared_until_changed

EVERY_FILE_IS_NOTED = """
import os, sys
from pathlib import Path
from uuvsim_cosim.models.declaration import files_read
from uuvsim_cosim.models.declaration.library import available, declare_source

opened = set()
def hook(event, arguments):
    if event == "open" and isinstance(arguments[0], str) and Path(arguments[0]).suffix in (
        ".yaml", ".json", ".npz", ".csv", ".nc", ".stl", ".obj", ".txt", ".xml"
    ):
        opened.add(Path(arguments[0]).absolute())
sys.addaudithook(hook)
for name in [*available(), "range_sensor?scene=tacoma", "policy", "imu@stim300"]:
    opened.clear()
    files = {}
    token = files_read._reading.set(files)
    try:
        declare_source(name)
    except ValueError:
        raise
    except Exception as error:
        if "expected" not in str(error):
            raise
    files_read._reading.reset(token)
    missing = {str(p) for p in opened - set(files) if "site-packages" not in str(p)}
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


def test_every_file_that_a_declaration_reads_is_noted() -> None:
    done = subprocess.run(
        [sys.executable, "-c", EVERY_FILE_IS_NOTED], capture_output=True, text=True, check=False
    )
    assert done.stdout == "all noted\n", done.stderr
