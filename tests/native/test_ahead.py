"""What a second process makes while the first goes on."""

from __future__ import annotations

import os
import signal
import sys

import pytest

from lagsim.native.link import ahead

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2,
    reason="nobody is sent without a second core, and elsewhere than on Linux",
)


def test_it_is_there_when_it_is_waited_for(tmp_path):
    with ahead.helped():
        ahead.send("key", lambda: (tmp_path / "made").write_text(str(os.getpid())))
        assert not ahead.wait("another")
        assert ahead.wait("key")
        assert int((tmp_path / "made").read_text()) != os.getpid()
        assert not ahead.wait("key")


def test_nobody_is_sent_where_nobody_may_be(tmp_path):
    ahead.send("key", (tmp_path / "made").touch)
    assert not ahead.wait("key")
    assert not (tmp_path / "made").exists()


def test_nobody_is_left_behind(tmp_path):
    with ahead.helped():
        ahead.send("key", lambda: (tmp_path / "made").write_text(str(os.getpid())))
    number = int((tmp_path / "made").read_text())
    with pytest.raises(ChildProcessError):
        os.waitpid(number, os.WNOHANG)


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


def test_what_it_brings_is_whole():
    content = os.urandom(10**6)
    with ahead.helped():
        bring = ahead.bring(lambda: content)
        assert bring() == content


def test_what_it_fails_to_bring_the_first_makes_itself():
    first = os.getpid()

    def make():
        if os.getpid() != first:
            os.kill(os.getpid(), signal.SIGKILL)
        return b"made"

    with ahead.helped():
        assert ahead.bring(make)() == b"made"
