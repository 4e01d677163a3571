"""Work of a second process beside the first."""

import contextlib
import functools
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


def test_tasks_are_shared_and_their_results_are_in_order():
    first = os.getpid()
    large = os.urandom(10**6)  # more than a pipe holds

    def task(k):
        while os.getpid() == first and not others():  # the other one takes a task first
            time.sleep(1e-3)
        written()
        return b"%d" % k + large

    reads, writes = os.pipe()
    os.set_blocking(reads, False)

    def written():
        os.write(writes, b"%d" % (os.getpid() != first))

    seen = []

    def others():
        with contextlib.suppress(BlockingIOError):
            seen.append(os.read(reads, 100))
        return b"1" in b"".join(seen)

    with ahead.second_processes():
        made = ahead.shared([functools.partial(task, k) for k in range(5)])
    assert made == [b"%d" % k + large for k in range(5)]
    others()
    assert sorted(set(b"".join(seen))) == sorted(b"01")
    assert len(b"".join(seen)) == 5  # each is done once


def test_tasks_are_not_shared_while_all_cores_are_busy(monkeypatch):
    first = number()
    monkeypatch.setattr(ahead, "_cores", lambda: 2)
    with ahead.second_processes():
        helper = ahead.Helper(lambda: None, lambda _: iter([]))
        try:
            assert ahead.shared([number] * 5) == [first] * 5

            def late():  # the second process takes a task meanwhile
                time.sleep(0.2)
                return number()

            assert set(ahead.shared([late] * 5, alone=True)) > {first}
        finally:
            helper.end()


def test_tasks_of_a_killed_process_are_done_by_the_first():
    first = os.getpid()

    def task(k):
        if os.getpid() != first:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.05)
        return b"%d" % k

    with ahead.second_processes():
        made = ahead.shared([functools.partial(task, k) for k in range(4)])
    assert made == [b"0", b"1", b"2", b"3"]
    assert ahead.shared([functools.partial(task, k) for k in range(2)]) == [b"0", b"1"]


def test_of_tasks_beside_one_process_is_at_work(tmp_path):
    def wait_for(name):
        while not (tmp_path / name).exists():
            time.sleep(1e-3)

    assert ahead.beside([]) is None
    with ahead.second_processes():
        has_ended = ahead.beside([lambda: wait_for("go")])
        again = ahead.beside([(tmp_path / "no").touch])
        assert not has_ended()
        assert not again()
        (tmp_path / "go").touch()
        while not has_ended():
            time.sleep(1e-3)
        assert again()
        assert not (tmp_path / "no").exists()


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
