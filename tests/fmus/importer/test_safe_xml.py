from __future__ import annotations

import pytest

from uuvsim_cosim.errors import FmuError, InputInvalid
from uuvsim_cosim.fmus.importer.safe_xml import parse_xml

LAUGHS = """<?xml version="1.0"?>
<!DOCTYPE a [<!ENTITY x "ha"><!ENTITY y "&x;&x;&x;&x;">]>
<a>&y;</a>"""
OUTSIDE = '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><a>&x;</a>'


@pytest.mark.parametrize("text", [LAUGHS, OUTSIDE, OUTSIDE.lower()])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_entities_are_refused_in_every_encoding(text: str, encoding: str) -> None:
    with pytest.raises(FmuError, match=r"x\.xml: declares a document type or entities"):
        parse_xml(text.encode(encoding), "x.xml")


def test_utf_7_cannot_hide_a_document_type() -> None:
    data = b'<?xml version="1.0" encoding="utf-7"?>+ADwAIQ-DOCTYPE a+AD4-<a/>'
    with pytest.raises(FmuError, match="encoding 'utf-7'; expected UTF-8"):
        parse_xml(data, "x.xml")


def test_malformed_xml_is_refused_with_its_line() -> None:
    with pytest.raises(InputInvalid, match=r"malformed XML.*line 3"):
        parse_xml(b'<?xml version="1.0"?>\n<a>\n</b>', "x.xml", InputInvalid)


def test_plain_xml_is_read_in_its_declared_encoding() -> None:
    data = "<?xml version='1.0' encoding='ISO-8859-1'?><a b='Tauchgerät'/>".encode("latin-1")
    assert parse_xml(data, "x.xml").get("b") == "Tauchgerät"
