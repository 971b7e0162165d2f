"""Writes small S-57 cells and updates (ISO 8211), so that tests need no chart of anybody's."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

FT, UT = b"\x1e", b"\x1f"
CLASSES = {
    "BOYLAT": 17, "COALNE": 30, "DEPARE": 42, "DEPCNT": 43, "DRGARE": 46, "LNDARE": 71,
    "OBSTRN": 86, "PILPNT": 90, "PIPSOL": 94, "PONTON": 95, "SBDARE": 121, "SOUNDG": 129,
    "UNSARE": 154, "UWTROC": 153, "WRECKS": 159, "M_COVR": 302, "M_QUAL": 308, "M_SDAT": 309,
}  # fmt: skip
ATTRIBUTES = {
    "CATCOV": 18, "CATOBS": 42, "CATWRK": 71, "CATZOC": 72, "DRVAL1": 87, "DRVAL2": 88,
    "NATSUR": 113, "OBJNAM": 116, "QUASOU": 125, "VALDCO": 174, "VALSOU": 179, "VERDAT": 185,
    "WATLEV": 187,
}  # fmt: skip
FORMATS = {
    "0001": ("0500;&   ", "", "(b12)"),
    "DSID": ("1600;&   ", "RCNM!RCID!EXPP!INTU!DSNM!EDTN!UPDN!UADT!ISDT!STED!PRSP!PSDN!PRED!PROF!"
             "AGEN!COMT", "(b11,b14,2b11,3A,2A(8),R(4),b11,2A,b11,b12,A)"),
    "DSSI": ("1600;&   ", "DSTR!AALL!NALL!NOMR!NOCR!NOGR!NOLR!NOIN!NOCN!NOED!NOFA",
             "(3b11,8b14)"),
    "DSPM": ("1600;&   ", "RCNM!RCID!HDAT!VDAT!SDAT!CSCL!DUNI!HUNI!PUNI!COUN!COMF!SOMF!COMT",
             "(b11,b14,3b11,b14,4b11,2b14,A)"),
    "FRID": ("1600;&   ", "RCNM!RCID!PRIM!GRUP!OBJL!RVER!RUIN", "(b11,b14,2b11,2b12,b11)"),
    "FOID": ("1600;&   ", "AGEN!FIDN!FIDS", "(b12,b14,b12)"),
    "ATTF": ("2600;&-A ", "*ATTL!ATVL", "(b12,A)"),
    "FSPT": ("2600;&   ", "*NAME!ORNT!USAG!MASK", "(B(40),3b11)"),
    "VRID": ("1600;&   ", "RCNM!RCID!RVER!RUIN", "(b11,b14,b12,b11)"),
    "VRPT": ("2600;&   ", "*NAME!ORNT!USAG!TOPI!MASK", "(B(40),4b11)"),
    "SGCC": ("1600;&   ", "CCUI!CCIX!CCNC", "(b11,2b12)"),
    "SG2D": ("2500;&   ", "*YCOO!XCOO", "(2b24)"),
    "SG3D": ("2500;&   ", "*YCOO!XCOO!VE3D", "(3b24)"),
}  # fmt: skip
COMF, SOMF = 10_000_000, 10
Place = tuple[float, float]  # longitude, latitude


@dataclass
class Cell:
    """A cell that is filled feature by feature and then written."""

    scale: int = 20_000
    duni: int = 1
    sdat: int = 12
    hdat: int = 2
    edition: str = "3"
    update: int = 0
    is_update: bool = False
    first: int = 1  # number of the first record
    records: list[list[tuple[str, bytes]]] = field(default_factory=list)
    vectors: list[list[tuple[str, bytes]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._next = self.first

    def _number(self) -> int:
        self._next += 1
        return self._next - 1

    def _vector(self, kind: int, *fields: tuple[str, bytes]) -> bytes:
        number = self._number()
        self.vectors.append([("VRID", struct.pack("<BIHB", kind, number, 1, 1)), *fields])
        return struct.pack("<BI", kind, number)

    def _node(self, kind: int, place: Place) -> bytes:
        return self._vector(kind, ("SG2D", _coordinates([place])))

    def _edge(self, places: Sequence[Place]) -> bytes:
        ends = [self._node(120, places[0])]
        ends.append(ends[0] if places[0] == places[-1] else self._node(120, places[-1]))
        topology = b"".join(
            e + struct.pack("<4B", 255, 255, k + 1, 255) for k, e in enumerate(ends)
        )
        fields = [("VRPT", topology)]
        if len(places) > 2:
            fields.append(("SG2D", _coordinates(places[1:-1])))
        return self._vector(130, *fields)

    def _feature(self, kind: str, prim: int, pointers: bytes, values: dict[str, object]) -> int:
        number = self._number()
        fields = [
            ("FRID", struct.pack("<BIBBHHB", 100, number, prim, 1, CLASSES[kind], 1, 1)),
            ("FOID", struct.pack("<HIH", 550, number, 1)),
        ]
        if values:
            fields.append(("ATTF", b"".join(
                struct.pack("<H", ATTRIBUTES[k]) + str(v).encode() + UT for k, v in values.items()
            )))  # fmt: skip
        fields.append(("FSPT", pointers))
        self.records.append(fields)
        return number

    def soundings(self, places: Sequence[tuple[float, float, float]], **values: object) -> int:
        """Add soundings (longitude, latitude, depth); gives the number of their spatial record."""
        points = b"".join(
            struct.pack("<3i", *(round(v) for v in (la * COMF, lo * COMF, z * SOMF)))
            for lo, la, z in places
        )
        name = self._vector(110, ("SG3D", points))
        self._feature("SOUNDG", 1, name + bytes((255, 255, 255)), values)
        return int(struct.unpack("<BI", name)[1])

    def point(self, kind: str, place: Place, **values: object) -> int:
        """Add a point feature."""
        name = self._node(110, place)
        return self._feature(kind, 1, name + bytes((255, 255, 255)), values)

    def line(self, kind: str, places: Sequence[Place], **values: object) -> int:
        """Add a line feature."""
        name = self._edge(places)
        return self._feature(kind, 2, name + bytes((1, 255, 2)), values)

    def area(self, kind: str, *rings: Sequence[Place], **values: object) -> int:
        """Add an area feature: its outer ring, then holes."""
        pointers = b"".join(
            self._edge(ring) + bytes((1, 1 if k == 0 else 2, 2)) for k, ring in enumerate(rings)
        )
        return self._feature(kind, 3, pointers, values)

    def delete(self, feature: int, version: int = 2) -> None:
        """Say in an update that a feature of the base cell is gone."""
        self.records.append(
            [("FRID", struct.pack("<BIBBHHB", 100, feature, 255, 1, 0, version, 2))]
        )

    def write(self, path: Path) -> Path:
        """Write the file."""
        head = struct.pack("<BIBB", 10, 1, 2 if self.is_update else 1, 5)
        name = f"{path.stem}.{path.suffix[1:]}".encode()
        head += name + UT + self.edition.encode() + UT + str(self.update).encode() + UT
        head += b"20260101" + b"20260102" + b"03.1" + struct.pack("<B", 1) + UT + b"2.0" + UT
        head += struct.pack("<BH", 1, 550) + UT
        kinds = [fields[0][1][0] for fields in self.vectors]
        spatial = [kinds.count(kind) for kind in (110, 120, 130, 140)]
        counts = struct.pack("<3B8I", 2, 1, 1, 0, 0, len(self.records), 0, *spatial)
        records = [[("DSID", head), ("DSSI", counts)]]
        if not self.is_update:
            records.append([("DSPM", struct.pack(
                "<BIBBBIBBBBII", 20, 1, self.hdat, 16, self.sdat, self.scale, self.duni, 1, 1, 1,
                COMF, SOMF) + UT)])  # fmt: skip
        records += self.vectors + self.records
        parts = [_description()]
        for k, fields in enumerate(records, 1):
            parts.append(_record(b" ", b"D", b"     ", b"   ",
                                 [("0001", struct.pack("<H", k)), *fields]))  # fmt: skip
        path.write_bytes(b"".join(parts))
        return path


def _coordinates(places: Sequence[Place]) -> bytes:
    return b"".join(struct.pack("<2i", round(la * COMF), round(lo * COMF)) for lo, la in places)


def _description() -> bytes:
    tags = list(FORMATS)
    tree = "".join(
        parent + child
        for parent, children in {
            "0001": ("DSID", "DSPM", "FRID", "VRID"), "DSID": ("DSSI",),
            "FRID": ("FOID", "ATTF", "FSPT"), "VRID": ("VRPT", "SGCC", "SG2D", "SG3D"),
        }.items()
        for child in children
    )  # fmt: skip
    fields = [("0000", b"0000;&   " + UT + tree.encode())]
    for tag in tags:
        control, labels, formats = FORMATS[tag]
        text = control.encode() + tag.encode() + UT + labels.encode() + UT + formats.encode()
        fields.append((tag, text))
    return _record(b"3", b"L", b"E1 09", b" ! ", fields)


def _record(
    level: bytes, kind: bytes, middle: bytes, extension: bytes, fields: list[tuple[str, bytes]]
) -> bytes:
    data = [(tag.encode(), value + FT) for tag, value in fields]
    directory, position = b"", 0
    for tag, value in data:
        directory += tag + b"%06d%06d" % (len(value), position)
        position += len(value)
    base = 24 + len(directory) + 1
    leader = b"%05d" % (base + position) + level + kind + middle
    leader += b"%05d" % base + extension + b"6604"
    return leader + directory + FT + b"".join(v for _, v in data)


def rectangle(west: float, south: float, east: float, north: float) -> list[Place]:
    """Return a closed ring."""
    return [(west, south), (east, south), (east, north), (west, north), (west, south)]


def slope(
    west: float = 10.0, south: float = 54.0, size: float = 0.02, count: int = 12, **said: object
) -> Cell:
    """Return a cell over a plane: land in the west, 0 m at the shore, 40 m at the eastern edge.

    The plane in degrees is depth = 40 (longitude - shore) / (east - shore); contours are exact.
    """
    cell = Cell(**said)  # type: ignore[arg-type]
    east, north = west + size, south + size
    shore = west + 0.1 * size
    edges = [0.0, 10.0, 20.0, 40.0]
    at = [shore + (east - shore) * d / 40 for d in edges]
    cell.area("M_COVR", rectangle(west, south, east, north), CATCOV=1)
    cell.area("M_QUAL", rectangle(west, south, east, north), CATZOC=2)
    cell.area("LNDARE", rectangle(west, south, shore, north))
    for a, b, low, high in zip(at[:-1], at[1:], edges[:-1], edges[1:], strict=True):
        cell.area("DEPARE", rectangle(a, south, b, north), DRVAL1=low, DRVAL2=high)
    for x, d in zip(at[:-1], edges[:-1], strict=True):
        cell.line("DEPCNT", [(x, south), (x, north)], VALDCO=d)
    grid = (np.arange(count) + 0.5) / max(count, 1)
    if count:
        cell.soundings([
            (shore + (east - shore) * u, south + size * v, 40 * u) for u in grid for v in grid
        ])  # fmt: skip
    return cell
