"""A kernel that does not return is ended by the timeout that every test has."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.patience import PATIENCE
from tests.support import ROOT

# Machine code, in which no signal is looked at: `while x < 1: x = x * 0.5`.
TEST = """
import ctypes
from lagsim.native.link.engine import Engine, compile_object

IR = '''
define double @endless(double %start) {
entry:
  br label %loop
loop:
  %x = phi double [ %start, %entry ], [ %half, %loop ]
  %half = fmul double %x, 5.0e-1
  %more = fcmp olt double %half, 1.0
  br i1 %more, label %loop, label %end
end:
  ret double %half
}
'''

def test_endless():
    engine = Engine([compile_object(IR)])
    endless = engine.function("endless", ctypes.c_double, [ctypes.c_double])
    endless(0.5)
"""


@pytest.mark.slow
def test_an_endless_kernel_is_ended(tmp_path):
    (tmp_path / "test_one.py").write_text(TEST)
    settings = ROOT / "pyproject.toml"
    command = ["-m", "pytest", "-c", str(settings), "--rootdir", str(tmp_path)]
    command += ["-n", "0", f"--timeout={5 * PATIENCE:g}", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [sys.executable, *command, "."],
        cwd=tmp_path, capture_output=True, text=True, timeout=120 * PATIENCE,
    )  # fmt: skip
    assert done.returncode != 0
    told = done.stdout + done.stderr
    assert "Timeout" in told
    assert "in test_endless" in told
