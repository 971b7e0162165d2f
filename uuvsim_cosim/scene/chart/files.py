"""Files of a chart: the base cell, and its updates in their sequence.

An S-57 file is ISO 8211: a leader, a directory, and fields. Only the first data record is read
here. It identifies the file: purpose, name, edition, update number, dates (S-57 part 3,
7.3.1.1 "Data set identification field").
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.scene.chart.records import check_records

__all__ = ["ChartFiles", "Identification", "chart_files", "identification", "in_sequence"]

FIELD_END, UNIT_END = b"\x1e", b"\x1f"
_REVISION = 2  # EXPP of a file that updates another


@dataclass(frozen=True)
class Identification:
    """Identification of an S-57 file, from its first data record."""

    name: str
    edition: str
    update: int  # the last update that it holds, or that it is
    is_update: bool
    updated: str  # date as YYYYMMDD up to which updates are in it
    issued: str  # date as YYYYMMDD


@dataclass(frozen=True)
class ChartFiles:
    """A base cell, the updates that follow it without a gap, and notes on updates not applied."""

    base: Path
    identification: Identification
    updates: tuple[Path, ...]
    notes: tuple[str, ...]

    @property
    def last_update(self) -> int:
        """Number of the last update that is applied."""
        return self.identification.update + len(self.updates)


def identification(file: Path) -> Identification:
    """Read the identification of a file; raises `InputInvalid` if it is no S-57 file."""
    with file.open("rb") as opened:
        head = opened.read(1 << 16)
    if not head:
        raise InputInvalid(file, "the file is empty", "an S-57 base cell (.000)")
    try:
        start = int(head[:5])  # the length of the data descriptive record
        if head[6:7] != b"L":
            raise ValueError
        if len(head) < start + (1 << 12):
            with file.open("rb") as opened:
                head = opened.read(start + (1 << 13))
        if len(head) <= start:
            raise InputInvalid(f"{file}: an S-57 file that ends after its description; it is empty")
        return _read(head[start:])
    except (ValueError, IndexError, struct.error):
        raise InputInvalid(
            file,
            "not an S-57 chart: it does not begin with the leader and DSID record of one",
            (
                "a base cell (.000; S-101 is not read, and cells encrypted by S-63 "
                "have to be decrypted first)"
            ),
        ) from None


def _read(record: bytes) -> Identification:
    base = int(record[12:17])
    size_length, size_position = int(record[20:21]), int(record[21:22])
    size_tag = int(record[23:24])
    entry = size_tag + size_length + size_position
    for at in range(24, base - 1, entry):
        tag = record[at : at + size_tag]
        length = int(record[at + size_tag : at + size_tag + size_length])
        position = int(record[at + size_tag + size_length : at + entry])
        if tag != b"DSID":
            continue
        field = record[base + position : base + position + length].rstrip(FIELD_END)
        purpose = field[5]  # after RCNM (1 byte) and RCID (4 bytes); then INTU (1 byte)
        name, edition, update, rest = field[7:].split(UNIT_END, 3)
        dates = rest[:16].decode("latin-1")
        return Identification(
            name.decode("latin-1").strip(),
            edition.decode("latin-1").strip(),
            int(update or b"0"),
            purpose == _REVISION,
            dates[:8].strip(),
            dates[8:16].strip(),
        )
    raise ValueError("no DSID")


def chart_files(file: Path) -> ChartFiles:
    """Find a base cell's updates beside it (or in numbered folders, as exchange sets have them).

    The sequence ends at a gap or at an update of another edition. Later updates are not applied,
    and `notes` names the file that is missing.
    """
    cell = identification(file)
    if cell.is_update or re.fullmatch(r"\.(?!000)\d\d\d", file.suffix):
        base = file.with_suffix(".000")
        where = f"open {base}" if base.is_file() else f"its base cell {base.name} is not beside it"
        raise InputInvalid(
            f"{file}: this is update {cell.update} of a chart, not the chart; {where}"
        )
    check_records(file)
    found = _updates(file)
    notes: list[str] = []
    applied: list[Path] = []
    number = cell.update
    for n in [n for n in sorted(found) if n > cell.update]:
        if n != number + 1:
            gone = [f"{file.stem}.{m:03d}" for m in range(number + 1, n)]
            kept = [f"{file.stem}.{m:03d}" for m in sorted(found) if m >= n]
            notes.append(
                f"{', '.join(gone)} {'is' if len(gone) == 1 else 'are'} missing from the sequence "
                f"of updates: {', '.join(kept)} cannot be applied; the chart stands at update "
                f"{number}"
            )
            break
        try:
            update = identification(found[n])
            check_records(found[n])
        except InputInvalid as reason:
            notes.append(f"{reason}: not applied; the chart stands at update {number}")
            break
        if update.edition == "0":  # edition 0 withdraws a cell (S-57 appendix B.1, 5.7)
            notes.append(f"{found[n].name} withdraws this chart: it is no longer in force")
            break
        if update.edition != cell.edition:
            notes.append(
                f"{found[n].name} belongs to edition {update.edition}, the base cell is edition "
                f"{cell.edition}: not applied; the chart stands at update {number}"
            )
            break
        if not update.is_update or update.update != n:
            notes.append(
                f"{found[n].name} says that it is update {update.update}: not applied; the chart "
                f"stands at update {number}"
            )
            break
        applied.append(found[n])
        number = n
    return ChartFiles(file, cell, tuple(applied), tuple(notes))


def _updates(file: Path) -> dict[int, Path]:
    """Return the update files of a base cell by number."""
    folders = [file.parent]
    if file.parent.name.isdigit():  # an exchange set: CELL/0/CELL.000, CELL/1/CELL.001, ...
        folders += sorted(p for p in file.parent.parent.iterdir() if p.is_dir() and p != file.parent
                          and p.name.isdigit())  # fmt: skip
    found: dict[int, Path] = {}
    for folder in folders:
        for path in sorted(folder.iterdir()):
            same = path.stem.lower() == file.stem.lower() and path.is_file()
            if same and re.fullmatch(r"\.\d\d\d", path.suffix) and path.suffix != ".000":
                found.setdefault(int(path.suffix[1:]), path)
    return found


@contextmanager
def in_sequence(files: ChartFiles) -> Iterator[Path]:
    """Return the base cell's path in a folder where its updates stand as .001, .002, ...

    GDAL reads updates by file name, from .001 to the first gap. But the updates of a reissued base
    cell begin at a higher number, and updates of another edition may lie in the same folder.
    """
    from tempfile import TemporaryDirectory

    with TemporaryDirectory(prefix="uuvsim-chart-") as name:
        folder = Path(name)
        targets = (files.base, *files.updates)
        for number, target in enumerate(targets):
            link = folder / f"{files.base.stem}.{number:03d}"
            try:
                link.symlink_to(target.resolve())
            except OSError:  # Windows needs a right for links that not every user has
                from shutil import copyfile

                copyfile(target.resolve(), link)
        yield folder / f"{files.base.stem}.000"
