"""Objects as JSON and arrays: encoded objects are decoded, and no others."""

import json
import math
import os
import re
from collections import deque

import numpy as np
import pytest

from lagsim.notes import Event
from lagsim.run.events.constraints import RankLosses
from lagsim.run.trajectory import Outcome
from lagsim.studies.restart import UndeclaredError, decoded, encoded

CLASSES = (
    "lagsim.notes:Event",
    "lagsim.run.trajectory:Outcome",
    "lagsim.run.events.constraints:RankLosses",
)


def nobody(_):
    return None


def back(what, classes=CLASSES):
    return decoded(encoded(what, classes, nobody), classes, nobody)


def test_values_come_back_with_their_types_and_bits():
    what = [None, True, 1, 1.0, 0.1, -0.0, math.inf, "é\n", (1, (2.0,)), {1, 2}]
    what += [{"a": 1, 2: "b", (1, 2): 3}, deque([1, 2], 5), frozenset({3})]
    found = back(what)
    assert found == what
    assert list(map(type, found)) == list(map(type, what))
    assert math.copysign(1.0, found[5]) == -1.0
    assert found[11].maxlen == 5
    assert math.isnan(back([math.nan])[0])


@pytest.mark.parametrize("kind", ["f8", "i8", "?", "u4", "c16"])
def test_arrays_come_back_to_the_bit_and_can_be_written(kind):
    raw = np.frombuffer(os.urandom(96), np.uint8)
    array = (raw % 2).astype(bool) if kind == "?" else raw.view(kind)
    for given in (array, array[::2], array.reshape(2, -1).T, array[:0]):
        found = back([given])[0]
        assert (found.dtype, found.shape) == (given.dtype, given.shape)
        assert found.tobytes() == given.tobytes()
        assert found.flags.writeable
    assert type(back([array[0]])[0]) is type(array[0])


def test_objects_stay_one_and_may_hold_themselves():
    shared = [1.0]
    losses = RankLosses.__new__(RankLosses)
    losses.__dict__.update(me=losses, one=shared, two=shared, end=Outcome.DONE)
    found = back(losses)
    assert type(found) is RankLosses
    assert found.me is found
    assert found.one is found.two
    assert found.end is Outcome.DONE
    assert back(Event(1.0, "impact", "floor")) == Event(1.0, "impact", "floor")


def test_what_the_reader_has_is_only_named():
    own, other = object(), object()
    names = {id(own): "own", id(other): ["a", 2]}
    content = encoded([own, [other]], (), lambda x: names.get(id(x)))
    things = {"'own'": own, "['a', 2]": other}
    assert decoded(content, (), lambda name: things[repr(name)]) == [own, [other]]


@pytest.mark.parametrize(
    "what", [os.system, print, object(), (x for x in ()), np.array([object()]), Event]
)
def test_what_is_not_declared_is_not_encoded(what):
    with pytest.raises(UndeclaredError):
        encoded([what], CLASSES, nobody)


def planted(*nodes):
    return json.dumps([[0], nodes]).encode() + b"\n"


@pytest.mark.parametrize(
    "name", ["os:system", "subprocess:Popen", "builtins:eval", "lagsim.cli:main"]
)
@pytest.mark.parametrize("kind", ["object", "named tuple", "memory", "member"])
def test_a_document_cannot_name_what_is_not_declared(name, kind):
    with pytest.raises(UndeclaredError, match=re.escape(name)):
        decoded(planted([kind, name, "true"]), CLASSES, nobody)


@pytest.mark.parametrize(
    "node",
    [
        ["array", "O", [1], 0],
        ["array", "f8", [4], 0],
        ["array", "f8", [1], -1],
        ["call", "lagsim.notes:Event"],
    ],
)
def test_damaged_documents_are_refused(node):
    with pytest.raises(ValueError, match=r"."):
        decoded(planted(node), CLASSES, nobody)
