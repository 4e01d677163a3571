"""What decides that a number is zero, equal, small or done: each tolerance, once.

A value is a multiple of the unit roundoff where rounding decides, and a share of the
scale that its name says where an error of a method or of a solve decides. Budgets (how
many, how long, how large a file) stand in `limits`, a method's parameters in its file.
Kernels read these like any global of their module: they are constants when compiled.
"""

from __future__ import annotations

UNIT_ROUNDOFF = 2.0**-53
"""The largest relative error of one operation in double precision."""
