"""JUnit XML for CI servers: test cases that passed, failed, or could not be judged."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree as ET

if TYPE_CHECKING:
    from collections.abc import Sequence

# Characters that XML 1.0 excludes, escaped or not.
_UNSPEAKABLE = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class CaseResult(NamedTuple):
    """Test case and its outcome.

    Attributes
    ----------
    name, file : str
    seconds : float
        Duration.
    kind : str
        Empty for a case that passed, `failure` for one that failed, `error` for one
        that could not be judged.
    code, text : str
        Code and text of the reason; empty for a case that passed.
    """

    name: str
    file: str
    seconds: float
    kind: str = ""
    code: str = ""
    text: str = ""


def document(suite: str, cases: Sequence[CaseResult]) -> bytes:
    """Return the JUnit XML document of the suite called `suite`.

    Examples
    --------
    >>> found = document("golden", [CaseResult("pendulum", "pendulum.yaml", 0.25)])
    >>> b'tests="1" failures="0"' in found
    True
    """
    whole = {
        "tests": str(len(cases)),
        "failures": str(sum(case.kind == "failure" for case in cases)),
        "errors": str(sum(case.kind == "error" for case in cases)),
        "time": _seconds(sum(case.seconds for case in cases)),
    }
    root = ET.Element("testsuites", whole)
    element = ET.SubElement(root, "testsuite", {"name": suite, **whole})
    for case in cases:
        about = {
            "classname": suite,
            "name": _spoken(case.name),
            "file": _spoken(case.file),
            "time": _seconds(case.seconds),
        }
        found = ET.SubElement(element, "testcase", about)
        if case.kind:
            text = _spoken(case.text)
            message = text.split("\n", 1)[0]
            why = {"type": _spoken(case.code), "message": message}
            ET.SubElement(found, case.kind, why).text = text
    ET.indent(root)
    written = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return bytes(written) + b"\n"


def _seconds(time: float) -> str:
    return f"{time:.3f}"


def _spoken(text: str) -> str:
    """Return `text` with Python escapes for the characters that XML 1.0 excludes."""
    return _UNSPEAKABLE.sub(lambda m: ascii(m[0])[1:-1], text)
