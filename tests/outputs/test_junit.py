"""JUnit's XML for CI servers, with any names and texts."""

from xml.etree import ElementTree as ET

from lagsim.outputs.junit import CaseResult, document

# What such files hold, by the servers that read them: no other attributes.
KNOWN = {
    "testsuites": {"tests", "failures", "errors", "time"},
    "testsuite": {"name", "tests", "failures", "errors", "time"},
    "testcase": {"classname", "name", "file", "time"},
    "failure": {"type", "message"},
    "error": {"type", "message"},
}

FOUND = [
    CaseResult("good", "models/good.yaml", 0.25),
    CaseResult("bad", "models/bad.yaml", 1.5, "failure", "differs", "two columns\n  x"),
    CaseResult("ugly", "models/ugly.yaml", 0.0, "error", "no-golden", "there is none"),
]


def test_counts_times_and_texts():
    content = document("lagsim golden", FOUND)
    assert content.startswith(b"<?xml")
    root = ET.fromstring(content)
    for element in root.iter():
        assert set(element.attrib) == KNOWN[element.tag]
    [suite] = root
    for whole in (root, suite):
        found = [whole.get(k) for k in ("tests", "failures", "errors", "time")]
        assert found == ["3", "1", "1", "1.750"]
    assert [case.get("name") for case in suite] == ["good", "bad", "ugly"]
    assert [[child.tag for child in case] for case in suite] == [
        [], ["failure"], ["error"],
    ]  # fmt: skip
    [failure] = suite[1]
    assert failure.get("message") == "two columns"
    assert failure.text == "two columns\n  x"


def test_no_letter_spoils_it():
    # What markup is made of, what XML cannot hold at all, and half a surrogate pair.
    odd = '<a b="c">&\'\x00\x1b[31m\ufffe\ud800\U0001f600\n]]>'
    root = ET.fromstring(
        document("s", [CaseResult(odd, odd, 0.0, "failure", "x", odd)])
    )
    [failure] = root.iter("failure")
    told = '<a b="c">&\'\\x00\\x1b[31m\\ufffe\\ud800\U0001f600\n]]>'
    assert failure.text == told
    [case] = root.iter("testcase")
    assert case.get("name") == told


def test_nothing_to_tell():
    assert ET.fromstring(document("s", [])).get("tests") == "0"
