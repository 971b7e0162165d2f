"""The reader of pages has the libraries of an extra only on a page that names it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from extras import hidden, named
from reader import Reader, blocks

USES = [
    "```python\nimport cryptography\n```\n",
    "```bash\npython -c 'import cryptography'\n```\n",
    "```bash\nuuvsim access certificates $(mktemp -d)/pki\n```\n",
]
NAMES = [
    "`pip install 'uuvsim-cosim[rl,security]'`",
    "the extras `rl` and `security`",
    "`pip install cryptography`",
]


def read(text: str) -> str:
    page = Path("page.md")
    page.write_text(text, encoding="utf-8")
    with Reader(page) as reader:
        for block in blocks(page):
            reader.reads(block)
    return reader.output


@pytest.mark.parametrize("use", USES)
def test_a_page_that_uses_an_extra_names_it(
    use: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises((AssertionError, pytest.fail.Exception), match="cryptography"):
        read(f"`pip install 'uuvsim-cosim[rl,dev]'`\n{use}")
    for name in NAMES:
        read(f"{name}\n{use}")


def test_a_library_that_is_not_named_is_not_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("laspy.py").write_text("value = 2\n")
    said = read("""```python
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
import laspy

print(laspy.value, find_spec("torch"), find_spec("numpy").name, bool(version("numpy")))
try:
    version("Stable_Baselines3")
except PackageNotFoundError as error:
    print(error.name)
```
""")
    assert said == "2 None numpy True\nStable_Baselines3\n"


def test_python_keeps_what_a_page_defines_and_fails_for_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    block = "```python\n{}\n```\n"
    assert read(block.format("a = 2") + block.format("print(a)")) == "2\n"
    with pytest.raises(pytest.fail.Exception, match=r"(?s)line 6.*UserWarning"):
        read(block.format("a = 2") + block.format("import warnings\nwarnings.warn('w')"))


def test_the_core_and_what_it_needs_is_there_on_every_page() -> None:
    modules, packages = hidden("")
    assert {"torch", "rasterio", "viser", "pymavlink", "onnxruntime"} <= modules
    assert not modules & {"numpy", "scipy", "casadi", "matplotlib", "pip"}
    assert "torch" not in hidden("needs the extra `rl`")[1]
    assert "cryptography" in packages


def test_a_page_names_extras_in_several_ways_and_no_other_names() -> None:
    text = "'uuvsim-cosim[rl, view]', extras `scene`, `rerun` and `security`; the extra `bench`"
    extras = "uuvsim-cosim[bench,rerun,rl,scene,security,view]"
    assert named(f"{text}\npip install '.[rl]' 'onnxruntime>=1'  # both") == {
        extras,
        "onnxruntime>=1",
    }
    with pytest.raises(AssertionError, match="'lr'}: no such extra"):
        named("`pip install 'uuvsim-cosim[lr]'`")
