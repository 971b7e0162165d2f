"""A font of straight strokes for ASCII, drawn on a grid that meets the pixels at 10 px.

A glyph is strokes separated by spaces, a stroke is points, a point is two digits: column 0 to 4,
row 0 (top of capitals) to 6 (baseline) to 8 (descenders).  Size is ten rows.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.pictures.canvas_coverage import segments_coverage

__all__ = ["cap_height", "text_mask", "text_width"]

GLYPHS = {
    "A": "0602204246 0444", "B": "06003041423303 3344453606", "C": "4130100105163645",
    "D": "00304145360600", "E": "40000646 0333", "F": "400006 0333",
    "G": "41301001051636454323", "H": "0006 4046 0343", "I": "0020 1016 0626", "J": "4045361605",
    "K": "0006 401346 0313", "L": "000646", "M": "0600234046", "N": "06004640",
    "O": "103041453616050110", "P": "06003041423303", "Q": "103041453616050110 2446",
    "R": "06003041423303 2346", "S": "413010010213334445361605", "T": "0040 2026",
    "U": "000516364540", "V": "002640", "W": "0016233640", "X": "0046 4006", "Y": "002340 2326",
    "Z": "00400646",
    "a": "12324346 441405163645", "b": "0006 0312324345361605", "c": "4332120305163645",
    "d": "4046 4332120305163645", "e": "04444332120305163645", "f": "30201116 0232",
    "g": "4332120305163645 4247381807", "h": "0006 0312324346", "i": "00 0206", "j": "20 22271808",
    "k": "0006 3205 1436", "l": "000516", "m": "0602 03122326 23324346", "n": "0602 0312324346",
    "o": "123243453616050312", "p": "0208 0312324345361605", "q": "4248 4332120305163645",
    "r": "0602 04133242", "s": "4212031434453606", "t": "10152636 0232", "u": "0205163645 4246",
    "v": "022642", "w": "0216243642", "x": "0246 4206", "y": "0226 421808", "z": "02420646",
    "0": "103041453616050110", "1": "112026 1636", "2": "01103041420646",
    "3": "0110304142334445361605 1333", "4": "36300444", "5": "400002324345361605",
    "6": "413010010516364544331304", "7": "004016", "8": "103041423313020110 1304051636454433",
    "9": "051636454130100102133342",
    "!": "0004 06", '"': "0002 2022", "#": "1016 3036 0242 0444",
    "$": "413010010213334445361605 2026", "%": "4006 0010110100 3545463635",
    "&": "46011020310405162644", "'": "0002", "(": "20020426", ")": "00222406",
    "*": "2125 0244 0442", "+": "2125 0343", ",": "1608", "-": "0333", ".": "06", "/": "4006",
    ":": "03 06", ";": "13 1608", "<": "310335", "=": "0242 0444", ">": "013305",
    "?": "01103041422324 26", "@": "36160501103041443432221314 2434", "[": "20000626",
    "\\": "0046", "]": "00202606", "^": "022042", "_": "0747", "`": "0011", "{": "20111203141526",
    "|": "0007", "}": "00111223141506", "~": "03123443", "°": "1021120110",
}  # fmt: skip
MISSING = "0040460600 0046"  # a crossed box, for what the font does not have


def cap_height(size: float) -> int:
    """Return the height of capitals, from the top row to the baseline, both drawn [px]."""
    return round(0.6 * size) + 1


def text_width(text: str, size: float) -> int:
    """Return how far a text reaches to the right [px]."""
    return sum(_glyph(c, size)[1] for c in text) - (_gap(size) if text else 0)


@lru_cache(maxsize=512)
def text_mask(text: str, size: float) -> NDArray[np.float64]:
    """Return the coverage of a text; row 0 is the top of capitals, descenders are below."""
    mask = np.zeros((round(0.8 * size) + 2, max(text_width(text, size), 0) + 2))
    x = 0
    for character in text:
        glyph, advance = _glyph(character, size)
        if glyph is not None:
            place = mask[:, x : x + glyph.shape[1]]
            np.maximum(place, glyph[:, : place.shape[1]], out=place)
        x += advance
    mask.flags.writeable = False
    return mask


def _gap(size: float) -> int:
    return max(round(0.1 * size), 1)


@lru_cache(maxsize=2048)
def _glyph(character: str, size: float) -> tuple[NDArray[np.float64] | None, int]:
    """Return one character's coverage and its advance."""
    unit, gap = 0.1 * size, _gap(size)
    if character == " ":
        return None, round(3.0 * unit)
    strokes = [
        np.array([(int(s[i]), int(s[i + 1])) for i in range(0, len(s), 2)], float)
        for s in GLYPHS.get(character, MISSING).split()
    ]
    columns = 4.0 if character.isdigit() else max(s[:, 0].max() for s in strokes)
    width = max(1.0, unit)
    middle = 0.5 * round(width)  # of a stroke on whole pixels, so that it is crisp
    start = np.concatenate([s[:-1] if len(s) > 1 else s for s in strokes])
    end = np.concatenate([s[1:] if len(s) > 1 else s for s in strokes])
    box = (0, 0, round(columns * unit) + round(width) + 1, round(0.8 * size) + 2)
    rows, cells, cover = segments_coverage(
        np.round(start * unit) + middle, np.round(end * unit) + middle,
        width, np.ones(len(start)), box,
    )  # fmt: skip
    mask = np.zeros((box[3], box[2]))
    np.maximum.at(mask, (rows, cells), cover)
    return mask, round(columns * unit) + round(width) + gap
