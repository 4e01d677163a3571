"""What a second process makes while the first goes on."""

from __future__ import annotations

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


def test_it_is_there_when_it_is_waited_for(tmp_path):
    made = tmp_path / "made"
    with ahead.helped():
        ahead.send("key", lambda: made.write_text(str(os.getpid())))
        assert not ahead.wait("another")
        assert ahead.wait("key")
        assert int(made.read_text()) != os.getpid()
        assert not ahead.wait("key")
        ahead.send("again", lambda: made.write_text(str(os.getpid())))
    # Nobody is left behind.
    with pytest.raises(ChildProcessError):
        os.waitpid(int(made.read_text()), os.WNOHANG)


def test_nobody_is_sent_where_nobody_may_be(tmp_path):
    ahead.send("key", (tmp_path / "made").touch)
    assert not ahead.wait("key")
    assert not (tmp_path / "made").exists()


def test_who_fails_says_nothing(capfd):
    def fails():
        raise RuntimeError

    with ahead.helped():
        ahead.send("key", fails)
        assert ahead.wait("key")
    assert capfd.readouterr() == ("", "")


def test_signals_to_it_are_not_those_of_the_first(tmp_path):
    def killed():
        os.kill(os.getpid(), signal.SIGTERM)
        (tmp_path / "made").touch()

    heard = []
    before = signal.signal(signal.SIGTERM, lambda *_: heard.append(1))
    try:
        with ahead.helped():
            ahead.send("key", killed)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert heard == []
    assert not (tmp_path / "made").exists()


def test_what_it_brings_is_whole_or_made_by_the_first():
    first, content = os.getpid(), os.urandom(10**6)

    def killed():
        if os.getpid() != first:
            os.kill(os.getpid(), signal.SIGKILL)
        return b"made"

    with ahead.helped():
        assert ahead.bring(lambda: content)() == content
        assert ahead.bring(killed)() == b"made"


def test_a_helper_gives_one_content_after_the_other(tmp_path):
    ready = tmp_path / "ready"
    large = os.urandom(10**6)  # more than a pipe holds
    made = ahead.Helper(ready.touch, lambda order: iter([order, large]))
    assert list(made.give(large[::-1])) == [large[::-1], large]
    assert made.done
    made.end()
    assert ready.exists()


def test_a_helper_that_ends_on_the_way_is_not_done():
    def work(_):
        yield b"first"
        os.kill(os.getpid(), signal.SIGKILL)

    for ready, expected in ((lambda: None, [b"first"]), (killed, [])):
        made = ahead.Helper(ready, work)
        assert list(made.give(os.urandom(10**6))) == expected
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
