"""`lagsim explore` as it is typed: its page in a file, and its end."""

import contextlib
import re
import signal
import subprocess
import sys
import threading
import time
import urllib.request

import pytest

from lagsim.codes import number
from tests.patience import PATIENCE
from tests.studies.explore.test_explorer import OSCILLATOR
from tests.support import MODELS


def test_what_no_file_can_hold_is_refused(lagsim, tmp_path):
    target, wall = tmp_path / "page.html", tmp_path / "wall.yaml"
    text = "constraints: {wall: {relation: x >= -1, restitution: 0.5}}\n"
    wall.write_text(OSCILLATOR + text)
    done = lagsim("explore", wall, "-o", target)
    assert done.code == 2
    assert number("not-in-a-file") in done.err
    assert "`wall`" in done.err
    assert "without -o" in done.err
    assert not target.exists()


def test_a_file_that_cannot_be_written_is_refused_before_any_work(lagsim, tmp_path):
    model = tmp_path / "oscillator.yaml"
    model.write_text(OSCILLATOR)
    for bad in (tmp_path, tmp_path / "none" / "page.html", model):
        done = lagsim("explore", model, "-o", bad)
        assert done.code == 2
        assert number("output-file") in done.err
    assert model.read_text() == OSCILLATOR


def ask_motion(address):
    body = b'{"values": {}, "page": "1"}'
    request = urllib.request.Request(
        f"{address}motion", body, {"Content-Type": "application/json"}
    )
    # The server ends before it answers.
    with contextlib.suppress(OSError):
        urllib.request.urlopen(request).read()


# The kernels are compiled from some 0.3 to 1.5 s after the request.
@pytest.mark.slow
@pytest.mark.usefixtures("heeded_signals")
@pytest.mark.parametrize("pause", [0.3, 0.6, 0.9, 1.2])
def test_ctrl_c_ends_it_in_order_while_a_motion_is_compiled(
    tmp_path, monkeypatch, pause
):
    monkeypatch.setenv("LAGSIM_CACHE", str(tmp_path))
    command = [sys.executable, "-m", "lagsim", "explore", "--no-browser"]
    with subprocess.Popen(
        [*command, str(MODELS / "elastic-pendulum.yaml")],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        [address] = re.findall(r"http://\S+", process.stdout.readline().decode())
        threading.Thread(target=ask_motion, args=(address,), daemon=True).start()
        time.sleep(pause)
        process.send_signal(signal.SIGINT)
        try:
            _, said = process.communicate(timeout=20 * PATIENCE)
        finally:
            process.kill()
    assert process.returncode == 0
    assert said == b"Ctrl-C ends\n"
