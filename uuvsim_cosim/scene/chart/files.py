"""Files of a chart: the base cell, and its updates in their sequence.

An S-57 file is ISO 8211: records of a leader, a directory, and fields. The first data record
identifies the file: purpose, name, edition, update number, dates (S-57 part 3, 7.3.1.1 "Data set
identification field"). All records are checked, as some damaged files make GDAL end the process.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid

__all__ = [
    "ChartFiles",
    "Identification",
    "chart_files",
    "identification",
    "in_sequence",
]

FIELD_END, UNIT_END = b"\x1e", b"\x1f"
_REVISION = 2  # EXPP of a file that updates another
_COORDINATES = (b"SG2D", b"SG3D")
_DSSI = struct.Struct("<3B8I")
_KINDS = {b"FRID": "feature", b"VRID": "spatial"}


@dataclass(frozen=True)
class Identification:
    """Identification of an S-57 file, from its first data record."""

    name: str
    edition: str
    update: int  # the last update that it holds, or that it is
    is_update: bool
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
        record = head[start:]
        begin, length = next(f[1:] for f in _directory(record) if f[0] == b"DSID")
        field = record[begin : begin + length].rstrip(FIELD_END)
        # RCNM (1 byte), RCID (4), EXPP: the purpose (1), INTU (1), and texts
        name, edition, update, rest = field[7:].split(UNIT_END, 3)
        dates = rest[:16].decode("latin-1")
        return Identification(
            name.decode("latin-1").strip(), edition.decode("latin-1").strip(), int(update or b"0"),
            field[5] == _REVISION, dates[8:16].strip(),
        )  # fmt: skip
    except (ValueError, IndexError, StopIteration):
        raise InputInvalid(
            file,
            "not an S-57 chart: it does not begin with the leader and DSID record of one",
            (
                "a base cell (.000; S-101 is not read, and cells encrypted by S-63 "
                "have to be decrypted first)"
            ),
        ) from None


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
                f"of updates: {', '.join(kept)} cannot be applied; the chart remains at update "
                f"{number}"
            )
            break
        try:
            update = identification(found[n])
            check_records(found[n])
        except InputInvalid as reason:
            notes.append(f"{reason}: not applied; the chart remains at update {number}")
            break
        if update.edition == "0":  # edition 0 withdraws a cell (S-57 appendix B.1, 5.7)
            notes.append(f"{found[n].name} withdraws this chart: it is no longer in force")
            break
        if update.edition != cell.edition:
            notes.append(
                f"{found[n].name} belongs to edition {update.edition}, the base cell is edition "
                f"{cell.edition}: not applied; the chart remains at update {number}"
            )
            break
        if not update.is_update or update.update != n:
            notes.append(
                f"{found[n].name} states that it is update {update.update}: not applied; the chart "
                f"remains at update {number}"
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


def check_records(file: Path) -> None:
    """Check the ISO 8211 records up to the end of the file.

    The numbers of feature and spatial records are compared with those that the file states in its
    field DSSI (S-57 part 3, 7.3.1.2), so that a file cut between two records is found. Raises
    `InputInvalid` with the place of the first record that is damaged, or with the numbers.
    """
    data = file.read_bytes()
    at, number = 0, 0
    records: Counter[bytes] = Counter()
    stated: dict[bytes, int] = {}  # numbers of records by the tag of their first field
    while at < len(data):
        leader = data[at : at + 24]
        if not leader.strip(b"\0 \r\n\x1a"):  # padding at the end
            break
        number += 1
        try:
            if len(leader) < 24:
                raise ValueError("its leader is cut")
            length, base = int(leader[:5]), int(leader[12:17])
            if length == 0:  # longer than five digits can say: GDAL finds its end
                return
            if at + length > len(data):
                raise ValueError(f"it ends {at + length - len(data):,} bytes behind the file")
            if not 24 < base <= length:
                raise ValueError(f"its data begin at {base} of {length} bytes")
            if number > 1:  # the first describes the others
                record = data[at : at + length]
                entry = sum(int(leader[k : k + 1]) for k in (20, 21, 23))
                if not entry or (base - 25) % entry:
                    raise ValueError("its directory does not fit")
                for tag, begin, size in _directory(record):
                    if size < 1 or begin + size > length:
                        raise ValueError("its fields reach beyond it")
                    if size == 1 and tag in _COORDINATES:
                        raise ValueError("it has no coordinates")
                    records[tag] += 1
                    if tag == b"DSSI":
                        if size < _DSSI.size:
                            raise ValueError("its counts are cut")
                        # Counts follow three levels of text and structure. Some producers count
                        # connected nodes as isolated, so only the sums are compared.
                        counts = _DSSI.unpack_from(record, begin)[3:]
                        stated = {b"FRID": sum(counts[:4]), b"VRID": sum(counts[4:])}
        except ValueError as reason:
            what = str(reason) if str(reason).startswith("it") else "its leader is no leader"
            raise InputInvalid(
                f"{file}: damaged at byte {at:,}, record {number}: {what}; fetch it again"
            ) from None
        at += length
    for tag, expected in stated.items():
        if records[tag] < expected:
            raise InputInvalid(
                f"{file}: incomplete: its DSSI field states {expected:,} {_KINDS[tag]} records "
                f"and the file has {records[tag]:,}; fetch it again"
            )


def _directory(record: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Yield tag, begin and length of each field of a record; raises ValueError if damaged."""
    base = int(record[12:17])
    size_length, size_position, size_tag = (int(record[k : k + 1]) for k in (20, 21, 23))
    entry = size_tag + size_length + size_position
    for k in range(24, base - 1, entry):
        length_at = k + size_tag
        position_at = length_at + size_length
        position = int(record[position_at : k + entry])
        yield record[k:length_at], base + position, int(record[length_at:position_at])
