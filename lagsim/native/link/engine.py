"""LLVM IR -> object code -> callables, by llvmlite.

This module alone imports llvmlite, when it is first needed: the import takes longer
than that of all of lagsim.
"""

from __future__ import annotations

import ctypes
import functools
import os
import platform
import re
import sys
import weakref
from typing import TYPE_CHECKING, Any, NamedTuple

from lagsim.codes.known import UNKNOWN_CPU
from lagsim.errors import InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

CPU_VARIABLE = "LAGSIM_CPU"
"""Environment variable naming the CPU to compile for: "host" (default), "generic",
"x86-64-v3" or any other of LLVM's names, or PORTABLE."""

PORTABLE = "portable"
"""Any CPU, by code with equal bits on all CPUs: each operation is rounded as written,
none is contracted, and elementary functions are lagsim's own."""

_LIBRARY = "lagsim"

_CONTRACTED = " contract "
_FUNCTION = re.compile(
    r"^define (?P<internal>internal )?(?P<head>[^@]*@(?P<name>[\w.]+)\([^)]*\))[^\n]*\n"
    r"(?P<body>.*?)^\}\n?",
    re.MULTILINE | re.DOTALL,
)

# Names of processors that are known on all systems.
_COMMON = (PORTABLE, "generic", "x86-64", "x86-64-v2", "x86-64-v3", "x86-64-v4")
_ASK = """
import sys
import llvmlite.binding as llvm
llvm.initialize_native_target()
target = llvm.Target.from_triple(llvm.get_process_triple())
target.create_target_machine(cpu=sys.argv[1], opt=2, jit=True)
"""

# LLVM's level of optimisation: at 2 kernels compile a fifth longer, and are no faster.
LEVEL = 1
# At level 0, with these passes alone, kernels compile in a tenth of the time, and run
# 1.1 to 1.9 times as long.
QUICK_LEVEL = 0
QUICK_PASSES = ("sroa", "simplify_cfg", "instruction_combine")


class NativeError(RuntimeError):
    """Native code cannot be compiled or linked: a fault of lagsim, not of its input."""


class Target(NamedTuple):
    """Target of compilation: all that object code depends on besides its IR.

    Attributes
    ----------
    portable : bool
        Whether code has equal bits on all CPUs, see `PORTABLE`.
    """

    llvmlite: str
    llvm: str
    triple: str
    cpu: str
    features: str
    portable: bool


@functools.cache
def _binding() -> Any:
    """Return llvmlite's binding, ready to compile for this machine."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


def target() -> Target:
    """Return the target of `compile_object`: this machine, or the CPU in LAGSIM_CPU."""
    return _target(os.environ.get(CPU_VARIABLE) or "host")


@functools.cache
def _target(cpu: str) -> Target:
    import llvmlite

    llvm = _binding()
    features = ""
    portable = cpu == PORTABLE
    if portable:
        cpu = "generic"
    elif cpu == "host":
        cpu = llvm.get_host_cpu_name()
        features = llvm.get_host_cpu_features().flatten()
    elif cpu not in _COMMON:
        _demand_known(cpu)
    return Target(
        llvmlite=llvmlite.__version__,
        llvm=".".join(map(str, llvm.llvm_version_info)),
        triple=llvm.get_process_triple(),
        cpu=cpu,
        features=features,
        portable=portable,
    )


def wasm_target() -> Target:
    """Return the target of WebAssembly, with vectors of 128 bits; portable."""
    return _target(PORTABLE)._replace(
        triple="wasm32-unknown-unknown", features="+simd128"
    )


def _demand_known(cpu: str) -> None:
    """Raise InputError for a CPU name that LLVM does not know.

    LLVM itself would end the process.

    Raises
    ------
    InputError
    """
    import subprocess

    # LLVM reports an unknown processor on stderr only.
    arguments = [sys.executable, "-P", "-c", _ASK, cpu]
    done = subprocess.run(arguments, capture_output=True, check=False)
    if done.returncode or done.stderr:
        text = f"{CPU_VARIABLE}={cpu}: LLVM has no such processor for this machine"
        hint = f"leave it out, or use one of {', '.join(_COMMON)}"
        raise InputError([Problem(UNKNOWN_CPU, text, hint=hint)])


def _machine(chosen: Target, level: int = LEVEL) -> Any:
    llvm = _binding()
    native = chosen.triple == llvm.get_process_triple()
    if not native:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(chosen.triple).create_target_machine(
        cpu=chosen.cpu, features=chosen.features, opt=level, jit=native
    )


def compile_object(ir: str, *, optimise: bool = True, quick: bool = False) -> bytes:
    """Compile LLVM IR to object code for `target()`.

    Parameters
    ----------
    ir : str
    optimise : bool
        Whether to run LLVM's passes over the IR. Not useful for straight-line code from
        a graph, in which common subexpressions are shared already: it becomes no
        faster, and compiles five times longer.
    quick : bool
        Whether to compile at `QUICK_LEVEL`, with `QUICK_PASSES` in place of LLVM's
        usual ones. Code without contraction has equal bits either way.

    Raises
    ------
    NativeError
        If the IR does not parse or verify.
    """
    chosen = target()
    machine = _machine(chosen, QUICK_LEVEL if quick else LEVEL)
    module = _module(ir, chosen, machine, optimise=optimise and not quick)
    if quick and optimise:
        passes = _binding().create_new_module_pass_manager()
        for name in QUICK_PASSES:
            getattr(passes, f"add_{name}_pass")()
        passes.run(module, _passes(machine))
    return bytes(machine.emit_object(module))


def quick_objects(ir: str, *, optimise: bool = True) -> list[bytes]:
    """Compile LLVM IR quickly to one or two objects, with the bits of `compile_object`.

    Functions that LLVM may contract are compiled as always, apart from the others.

    ir, optimise : see `compile_object`.
    """
    if _CONTRACTED not in ir or target().portable:
        return [compile_object(ir, optimise=optimise, quick=True)]
    found = list(_FUNCTION.finditer(ir))
    usual = {_CONTRACTED in x["body"] for x in found}
    if usual == {True}:
        return [compile_object(ir, optimise=optimise)]
    # Symbols of one object are visible to the other, under names of their own.
    rest = _FUNCTION.sub("", ir)
    internal = "|".join(re.escape(x["name"]) for x in found if x["internal"])
    split: tuple[list[str], list[str]] = [], []
    for function in found:
        contracted = _CONTRACTED in function["body"]
        text = function[0].replace("define internal ", "define ", 1)
        split[contracted].append(text)
        split[not contracted].append(f"declare {function['head']}\n")
    texts = ["".join(lines) for lines in split]
    for line in rest.splitlines(keepends=True):
        name = line.partition(" = ")[0] if line.startswith("@") else ""
        for text, lines in zip(texts, split, strict=True):
            if name in text:
                lines.append(line)  # LLVM allows any order
    texts = ["".join(lines) for lines in split]
    if internal:
        texts = [re.sub(rf"@({internal})\(", r"@apart.\1(", text) for text in texts]
    return [
        compile_object(texts[0], optimise=optimise, quick=True),
        compile_object(texts[1], optimise=optimise),
    ]


def link_object(
    irs: Sequence[tuple[str, bool]], exports: Collection[str], chosen: Target
) -> bytes:
    """Compile several texts of IR to one object, with the visible symbols `exports`.

    irs : pairs of a text and its flag `optimise`, see `compile_object`.
    chosen : the target.
    """
    machine = _machine(chosen)
    whole = _module("", chosen, machine, optimise=False)
    for ir, optimise in irs:
        whole.link_in(_module(ir, chosen, machine, optimise=optimise))
    for function in whole.functions:
        if not function.is_declaration and function.name not in exports:
            function.linkage = "internal"
    passes = _binding().create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(whole, _passes(machine))
    whole.verify()
    return bytes(machine.emit_object(whole))


def _module(ir: str, chosen: Target, machine: Any, *, optimise: bool) -> Any:
    """Return the LLVM module of an IR text for the target `chosen`.

    machine : LLVM's machine of the target.
    optimise : see `compile_object`.

    Raises
    ------
    NativeError
        If the text does not parse or verify.
    """
    llvm = _binding()
    try:
        module = llvm.parse_assembly(portable(ir) if chosen.portable else ir)
        module.verify()
    except RuntimeError as fault:
        raise NativeError(f"LLVM refuses the generated code: {fault}") from fault
    module.triple = machine.triple
    module.data_layout = str(machine.target_data)
    if optimise:
        builder = _passes(machine)
        builder.getModulePassManager().run(module, builder)
    return module


def portable(ir: str) -> str:
    """Return IR without contraction, which calls `elementary` in place of libm.

    The functions of `elementary` are renamed, since LLVM would replace a function
    called `exp`.
    """
    from lagsim.native import elementary
    from lagsim.native.kernels.translation import translate

    names = "|".join(x.__name__ for x in elementary.FUNCTIONS)
    fma = "@llvm.fma.f64("
    if fma in ir:
        # In the module of its callers, so that it can be inlined.
        ir = re.sub(rf"^declare .*{re.escape(fma)}.*\n", "", ir, flags=re.MULTILINE)
        ir += translate([elementary.fused]).replace(
            "define double", "define internal double"
        )
        ir = ir.replace(fma, "@fused(")
        ir = re.sub(r"@(fused|lost)\(", r"@portable.\1(", ir)
    ir = re.sub(rf"@(?:llvm\.)?({names})(?:\.f64)?\(", r"@portable.\1(", ir)
    return ir.replace(" contract ", " ")


def _passes(machine: Any) -> Any:
    llvm = _binding()
    tuning = llvm.create_pipeline_tuning_options(speed_level=LEVEL)
    # Measured on a DOP853 kernel: compiled in 180 ms instead of 840, and faster for
    # systems of a few coordinates.
    tuning.loop_vectorization = False
    tuning.slp_vectorization = False
    tuning.loop_unrolling = False
    tuning.loop_interleaving = False
    # LLVM's own threshold, 225, makes the driver's kernel a quarter slower to compile,
    # and no run faster.
    tuning.inlining_threshold = 100
    return llvm.create_pass_builder(machine, tuning)


class Engine:
    """Object code linked in this process.

    Symbols of one engine are invisible to other engines: each may have its own
    `derivative`. The code is freed with the engine, and every callable from `function`
    keeps the engine alive.

    Parameters
    ----------
    objects : sequence of bytes
        Object code from `compile_object`. Undefined symbols are resolved among the
        objects and, for mathematical functions, in this process.

    Raises
    ------
    NativeError
        If the objects cannot be loaded, or two define one symbol.
    """

    def __init__(self, objects: Sequence[bytes]) -> None:
        llvm = _binding()
        builder = llvm.JITLibraryBuilder().add_current_process()
        for code in objects:
            builder.add_object_img(code)
        # A separate LLJIT for each: the name of a library stays taken after the library
        # is deleted. Its messages name undefined symbols. JITLink is LLVM's choice for
        # ARM, where the older linker has limits.
        self._jit = llvm.create_lljit_compiler(
            _machine(target()),
            use_jit_link=platform.machine().lower() in ("arm64", "aarch64"),
        )
        try:
            library = builder.link(self._jit, _LIBRARY)
        except RuntimeError as fault:
            raise NativeError(f"native code does not link: {fault}") from fault
        self._trackers = [library]
        self._addresses: dict[str, int] = {}
        # The code is freed before its compiler, also if both are found in a reference
        # cycle. Not at exit: a callable may still be used there, and the process frees
        # all memory.
        weakref.finalize(self, _close, self._trackers, self._jit).atexit = False

    def address(self, name: str) -> int:
        """Return the address of a symbol; it is valid while this engine exists.

        Raises
        ------
        NativeError
            If no object defines `name`, or a symbol that its code uses.
        """
        if name not in self._addresses:
            try:
                tracker = self._jit.lookup(_LIBRARY, name)
            except RuntimeError as fault:
                raise NativeError(f"no native code for `{name}`: {fault}") from fault
            self._trackers.append(tracker)
            self._addresses[name] = tracker[name]
        return self._addresses[name]

    def function(
        self, name: str, restype: Any, argtypes: Sequence[Any]
    ) -> Callable[..., Any]:
        """Return a symbol as a ctypes callable.

        Parameters
        ----------
        name : str
            The symbol.
        restype, argtypes : ctypes type, sequence of ctypes types
            As for `ctypes.CFUNCTYPE`; None for no result. An int is `c_int64`, a float
            `c_double`, a bool `c_bool`, an array a pointer to its first element.
        """
        prototype = ctypes.CFUNCTYPE(restype, *argtypes)
        callable_ = prototype(self.address(name))
        callable_.engine = self  # type: ignore[attr-defined]
        return callable_


def _close(trackers: list[Any], jit: Any) -> None:
    while trackers:
        trackers.pop().close()
    jit.close()
