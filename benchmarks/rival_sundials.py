"""CVODE of SUNDIALS (Adams' methods) from the library in scikit-sundae's wheel.

scikit-sundae calls Python for every evaluation. Here the right-hand side and the loop
over the rows are compiled: no Python code runs between the first row and the last.
"""

from __future__ import annotations

import ctypes
import time
from importlib.metadata import distribution

import numpy as np
from by_textbook import Compiled

from lagsim.studies.bench import solved

ADAMS, NORMAL = 1, 1
MOST_STEPS = 200_000  # between two rows
PARTS = ("sundials_core", "sundials_nvecserial", "sundials_cvode")

# {array}: N_VGetArrayPointer; {solve}: CVode. Their addresses, as the engine knows none
# of the symbols of other libraries.
GLUE = """
declare void @derivative(double, ptr, ptr, ptr)

define i32 @rhs(double %t, ptr %y, ptr %rate, ptr %p) {{
  %in = call ptr inttoptr (i64 {array} to ptr)(ptr %y)
  %out = call ptr inttoptr (i64 {array} to ptr)(ptr %rate)
  call void @derivative(double %t, ptr %in, ptr %p, ptr %out)
  ret i32 0
}}

define i32 @rows(ptr %mem, ptr %y, ptr %times, ptr %out, i64 %count, i64 %size) {{
entry:
  %reached = alloca double
  %data = call ptr inttoptr (i64 {array} to ptr)(ptr %y)
  %bytes = mul i64 %size, 8
  br label %row
row:
  %k = phi i64 [ 0, %entry ], [ %next, %kept ]
  %at = getelementptr double, ptr %times, i64 %k
  %t = load double, ptr %at
  %code = call i32 inttoptr (i64 {solve} to ptr)(
    ptr %mem, double %t, ptr %y, ptr %reached, i32 1)
  %bad = icmp slt i32 %code, 0
  br i1 %bad, label %end, label %kept
kept:
  %from = mul i64 %k, %size
  %place = getelementptr double, ptr %out, i64 %from
  call void @llvm.memcpy.p0.p0.i64(ptr %place, ptr %data, i64 %bytes, i1 false)
  %next = add i64 %k, 1
  %more = icmp slt i64 %next, %count
  br i1 %more, label %row, label %end
end:
  %last = phi i32 [ %code, %row ], [ 0, %kept ]
  ret i32 %last
}}

declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
"""


def library():
    """Return the three parts of the C library that comes with scikit-sundae."""
    files = distribution("scikit-sundae").files
    found = []
    for part in PARTS:
        path = next(f for f in files if f"lib{part}-" in f.name)
        found.append(ctypes.CDLL(str(path.locate()), mode=ctypes.RTLD_GLOBAL))
    return found


class Library:
    """The functions of the C library that the benchmark calls."""

    def __init__(self):
        core, vectors, cvode = library()
        pointer, number, whole = ctypes.c_void_p, ctypes.c_double, ctypes.c_int
        index, long = ctypes.c_int64, ctypes.c_long

        def function(part, name, result, *arguments):
            call = getattr(part, name)
            call.restype, call.argtypes = result, arguments
            return call

        p, i = pointer, whole
        self.context = function(core, "SUNContext_Create", i, i, p)
        self.array = function(core, "N_VGetArrayPointer", p, p)
        # An index is 4 or 8 bytes long: as an argument both are the same.
        self.vector = function(vectors, "N_VMake_Serial", p, index, p, p)
        self.create = function(cvode, "CVodeCreate", p, i, p)
        self.init = function(cvode, "CVodeInit", i, p, p, number, p)
        self.again = function(cvode, "CVodeReInit", i, p, number, p)
        self.tolerances = function(cvode, "CVodeSVtolerances", i, p, number, p)
        self.data = function(cvode, "CVodeSetUserData", i, p, p)
        self.most = function(cvode, "CVodeSetMaxNumSteps", i, p, long)
        self.fixed_point = function(cvode, "SUNNonlinSol_FixedPoint", p, p, i, p)
        self.nonlinear = function(cvode, "CVodeSetNonlinearSolver", i, p, p)
        self.evaluations = function(cvode, "CVodeGetNumRhsEvals", i, p, p)
        self.solve = function(cvode, "CVode", i, p, number, p, p, i)
        self.silent = function(core, "SUNContext_ClearErrHandlers", i, p)

    def glue(self):
        """Return the IR of the right-hand side, and of the loop over rows."""
        pointers = {"array": self.array, "solve": self.solve}
        places = {k: ctypes.cast(f, ctypes.c_void_p).value for k, f in pointers.items()}
        return GLUE.format(**places)


class Cvode:
    """CVODE with Adams' methods at one tolerance; rows : (k, 1 + state)."""

    def __init__(self, library, g, nodes, names, times, sizes, rtol):
        self.library = library
        self.compiled = Compiled(g, nodes, names, [library.glue()])
        self.times = np.ascontiguousarray(times)
        self.out = np.zeros((len(times) - 1, len(names)))
        self.y, self.atol = np.zeros(len(names)), rtol * np.asarray(sizes)
        engine, p = self.compiled.engine, ctypes.c_void_p
        whole = ctypes.c_int64
        self.rows = engine.function("rows", ctypes.c_int, [p, p, p, p, whole, whole])
        context = ctypes.c_void_p()
        _good(library.context(0, ctypes.byref(context)))
        _good(library.silent(context))
        self.vector, tolerances = (
            p(library.vector(len(names), array.ctypes.data, context))
            for array in (self.y, self.atol)
        )
        self.memory = p(library.create(ADAMS, context))
        right = p(engine.address("rhs"))
        _good(library.init(self.memory, right, self.times[0], self.vector))
        _good(library.tolerances(self.memory, rtol, tolerances))
        _good(library.data(self.memory, self.compiled.p.ctypes.data))
        _good(library.most(self.memory, MOST_STEPS))
        solver = p(library.fixed_point(self.vector, 0, context))
        _good(library.nonlinear(self.memory, solver))

    def solve(self, start):
        """Integrate once from a start; return rows, seconds and evaluations."""
        self.y[:] = start
        began = time.perf_counter()
        _good(self.library.again(self.memory, self.times[0], self.vector))
        places = [a.ctypes.data for a in (self.times[1:], self.out)]
        code = self.rows(self.memory, self.vector, *places, *self.out.shape)
        seconds = time.perf_counter() - began
        count = ctypes.c_long()
        _good(self.library.evaluations(self.memory, ctypes.byref(count)))
        if code:
            return solved(None, seconds, count.value, f"CVode: {code}")
        states = np.vstack([start, self.out])
        rows = np.column_stack([self.times, states])
        return solved(rows, seconds, count.value)


def _good(code):
    if code:
        raise RuntimeError(f"SUNDIALS returned {code}")
