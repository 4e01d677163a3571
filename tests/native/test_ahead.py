"""Work of a second process beside the first."""

import os
import signal
import sys
import time

import pytest

from lagsim.native.link import ahead

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2,
    reason="nobody is sent without a second core, and elsewhere than on Linux",
)


def number():
    return str(os.getpid()).encode()


def test_another_process_makes_it_where_others_may_be_sent():
    first = number()
    with ahead.second_processes():
        assert ahead.start(number)() != first
    assert ahead.start(number)() == first


def test_nobody_is_left_behind(tmp_path):
    first, made = os.getpid(), tmp_path / "made"

    def make():
        made.write_bytes(number())
        if os.getpid() != first:
            time.sleep(60)
        return b"late"

    with ahead.second_processes():
        late = ahead.start(make)
        while not made.exists() or not made.read_bytes():
            time.sleep(1e-3)
    with pytest.raises(ProcessLookupError):
        os.kill(int(made.read_bytes()), 0)
    assert late() == b"late"  # made by the first


def test_signals_to_it_are_not_those_of_the_first():
    first, heard = os.getpid(), []

    def killed():
        if os.getpid() != first:
            os.kill(os.getpid(), signal.SIGTERM)
        return b"made"

    before = signal.signal(signal.SIGTERM, lambda *_: heard.append(1))
    try:
        with ahead.second_processes():
            assert ahead.start(killed)() == b"made"
    finally:
        signal.signal(signal.SIGTERM, before)
    assert heard == []


def test_what_it_brings_is_whole_or_made_by_the_first():
    first, content = os.getpid(), os.urandom(10**6)

    def killed():
        if os.getpid() != first:
            os.kill(os.getpid(), signal.SIGKILL)
        return b"made"

    with ahead.second_processes():
        assert ahead.start(lambda: content)() == content
        assert ahead.start(killed)() == b"made"


def test_a_helper_gives_one_content_after_the_other(tmp_path):
    ready = tmp_path / "ready"
    large = os.urandom(10**6)  # more than a pipe holds
    made = ahead.Helper(ready.touch, lambda order: iter([order, large]))
    assert list(made.send(large[::-1])) == [large[::-1], large]
    assert made.done
    made.end()
    assert ready.exists()


def test_a_helper_that_ends_on_the_way_is_not_done():
    def work(_):
        yield b"first"
        os.kill(os.getpid(), signal.SIGKILL)

    for ready, expected in ((lambda: None, [b"first"]), (killed, [])):
        made = ahead.Helper(ready, work)
        assert list(made.send(os.urandom(10**6))) == expected
        assert not made.done
        made.end()


def killed():
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_helper_that_nobody_needs_is_not_left_behind(tmp_path):
    number = tmp_path / "number"
    made = ahead.Helper(lambda: number.write_text(str(os.getpid())), iter)
    while not number.exists() or not number.read_text():
        time.sleep(1e-3)
    made.end()
    with pytest.raises(ProcessLookupError):
        os.kill(int(number.read_text()), 0)
