"""Import of a user's Python file, which may import modules of the same folder.

Two folders may each have a `gains.py`, but Python keeps only one module of a name. So before a file
is imported, the modules of other users' folders are removed from `sys.modules`. Those of its own
folder are removed too if one of them was edited, as others may have read values from it. An import
inside a function is not covered: it finds the folder of the file that was imported last.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from uuvsim_cosim.cache import content_hash

__all__ = ["import_file"]

# Modules beside users' files, by their names: the file and the hash of its content when imported.
_BESIDE: dict[str, tuple[Path, str]] = {}
# The modules of _BESIDE that existed when each user's module had been imported.
_IMPORTED: dict[str, dict[str, tuple[Path, str]]] = {}
_FOLDERS: set[str] = set()  # folders of users' files, as written in sys.path


def import_file(path: Path) -> ModuleType:
    """Return the module of a file; import it again if it or a module beside it was edited.

    Errors of the file's own code are passed on.
    """
    name = f"uuvsim_user_{path.stem}_{content_hash([str(path), path.read_bytes()])}"
    if name in sys.modules and all(_is_unchanged(m) for m in _IMPORTED.get(name, {}).values()):
        return sys.modules[name]
    _forget_bytecode(path)
    is_edited = not all(_is_unchanged(beside) for beside in _BESIDE.values())
    for other, (source, _) in list(_BESIDE.items()):
        if is_edited or _root(other, source) != path.parent:
            sys.modules.pop(other, None)
            del _BESIDE[other]
            _forget_bytecode(source)
    # The folder is searched after Python's own, before those of other users.
    importlib.invalidate_caches()
    folder = str(path.parent)
    if folder not in sys.path or folder in _FOLDERS:
        if folder in sys.path:
            sys.path.remove(folder)
        first = next((i for i, p in enumerate(sys.path) if p in _FOLDERS), len(sys.path))
        sys.path.insert(first, folder)
        _FOLDERS.add(folder)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    others = sys.modules.keys() - _BESIDE.keys()
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    finally:
        for fresh in sys.modules.keys() - others:
            file = getattr(sys.modules[fresh], "__file__", None)
            if file is None or fresh.partition(".")[0] in others:
                continue  # a part of a package that somebody else had imported before
            if _root(fresh, Path(file)) == path.parent:
                _BESIDE[fresh] = (Path(file), content_hash([Path(file).read_bytes()]))
    _IMPORTED[name] = dict(_BESIDE)
    return module


def _forget_bytecode(file: Path) -> None:
    """Delete the compiled file, which Python trusts for a source of equal size and second."""
    with contextlib.suppress(OSError, NotImplementedError):
        Path(importlib.util.cache_from_source(str(file))).unlink()


def _root(name: str, file: Path) -> Path:
    """Return the folder where a module of this dotted name was found."""
    return file.parents[name.count(".") + (file.name == "__init__.py")]


def _is_unchanged(beside: tuple[Path, str]) -> bool:
    file, content = beside
    try:
        return content_hash([file.read_bytes()]) == content
    except OSError:
        return False
