"""Kernels that other kernels include without the parts that only Python needs.

numba compiles each function that a compiled one calls as if Python called it, too: machine code, a
wrapper for Python, one for C and a file in the cache for every step within a tick; and each caller
optimises again all that it links. Here a kernel has a second flavour for its callers among kernels:
its own intermediate code alone. Only the outermost kernel, which Python calls, links and optimises
it all, once, and becomes machine code and a file in the cache.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, NoReturn

from llvmlite import binding
from numba.core import caching, codegen, compiler, registry, sigutils, targetconfig

from teleop_rt.kernels.compile_lock import only_process
from teleop_rt.kernels.lean_numba import undetected

_compile_extra: Any = compiler.compile_extra
_Flags: Any = compiler.Flags
_normalized: Any = sigutils.normalize_signature
_Dispatcher: Any = registry.CPUDispatcher
_Library: Any = codegen.JITCodeLibrary
_Options: Any = targetconfig.TargetConfig
_FunctionCache: Any = caching.FunctionCache
_Payload: Any = caching.CompileResultCacheImpl


def _equal(one: Any, other: Any) -> bool:
    """Return whether two sets of options are equal: those that neither sets have one default."""
    if type(one) is not type(other):
        return False
    named = one._values.keys() | other._values.keys()  # noqa: SLF001 - numba's own names them all
    return all(getattr(one, name) == getattr(other, name) for name in named)


def _hashed(one: Any) -> int:
    """Return the input of numba's own hash: the names of the options, not their values."""
    return hash(type(one))


# At each call that it types numba reads all options by their names, and sorts them: without that
# a kernel takes a tenth less time to compile.
_Options.__eq__, _Options.__hash__ = _equal, _hashed


class _InnerLibrary(_Library):  # type: ignore[misc] # numba has no types
    """The code of one function; its callees are linked beside it, not into it."""

    def finalize(self) -> None:
        """Take the code as it is: its outermost caller optimises it."""
        self._raise_if_finalized()
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Return the code of this function and of all that it calls.

        Callers come first, for the linker includes only symbols referred to by then.
        """
        module = self.own_module().clone()
        for library in _callers_first(self)[1:]:
            module.link_in(_own_module(library), preserve=True)
        return module

    def own_module(self) -> Any:
        """Return the code of this function alone."""
        return super()._get_module_for_linking()

    def called(self) -> list[Any]:
        """Return the libraries of the functions that this one calls."""
        return list(self._linking_libraries)


def _own_module(library: Any) -> Any:
    if isinstance(library, _InnerLibrary):
        return library.own_module()
    return library._get_module_for_linking()  # noqa: SLF001 - numba's linker asks for it so


def _callers_first(library: Any) -> list[Any]:
    """Return a library and all that it calls, directly or not, each after all of its callers."""
    found: dict[Any, None] = {}

    def visit(one: Any) -> None:
        if one not in found:
            for called in one.called() if isinstance(one, _InnerLibrary) else ():
                visit(called)
            found[one] = None

    visit(library)
    return list(found)[::-1]


class _InnerFlavour(_Dispatcher):  # type: ignore[misc] # numba has no types
    """The flavour that kernels call: numba finds the code of each signature by its library."""

    def __call__(self, *_values: Any) -> NoReturn:
        """Refuse a call by Python, for which there is no machine code."""
        raise TypeError(f"{self.py_func.__name__}: only kernels call this flavour")

    def compile(self, sig: Any) -> Any:
        """Compile a signature to intermediate code, if this has not been done."""
        args, return_type = _normalized(sig)
        if tuple(args) not in self.overloads:
            with self._compiling_counter:
                self.overloads[tuple(args)] = self._compiled(args, return_type)
        return self.get_overload(sig)

    def get_overload(self, sig: Any) -> Any:
        """Return numba's key of a signature's code."""
        args, _ = _normalized(sig)
        return self.overloads[tuple(args)].library

    def _compiled(self, args: Any, return_type: Any) -> Any:
        flags = _Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        typing, target = self.typingctx, self.targetctx
        library = _InnerLibrary(target.codegen(), self.py_func.__qualname__)
        result = _compile_extra(typing, target, self.py_func, args, return_type, flags, {}, library)
        target.insert_user_function(library, result.fndesc, [library])
        return result


class _MachineCode(_Payload):  # type: ignore[misc] # numba has no types
    """A kernel's content on disk: its machine code, and the names of its entries."""

    def reduce(self, result: Any) -> tuple[Any, ...]:
        """Return the kept part of compiled code.

        numba keeps its intermediate code as well, for callers that take it in, and a text of its
        types; kernels take in the inner flavour. Parsed, that code took ten times the memory of
        the machine code: 10 MB of a daemon, and half of the time to load its kernels.
        """
        library, description, environment, signature, objectmode, lifted, _, *rest = super().reduce(
            result
        )
        name, kind, (code, _) = library
        kept = name, kind, (code, _entries(description))
        return kept, description, environment, signature, objectmode, lifted, "", *rest


def _entries(description: Any) -> bytes:
    """Return intermediate code that defines a function's entries without their content.

    numba looks there whether there is an entry, and asks the machine code for its address. Code
    that took these entries in, or ran them, would stop the process, and not go on with a wrong
    number.
    """
    names = (
        description.llvm_func_name,
        description.llvm_cpython_wrapper_name,
        description.llvm_cfunc_wrapper_name,
    )
    stops = "{\n  call void @llvm.trap()\n  unreachable\n}\n"
    text = "declare void @llvm.trap()\n"
    text += "".join(f'define void @"{name}"() {stops}' for name in names)
    code: bytes = binding.parse_assembly(text).as_bitcode()
    return code


class Cache(_FunctionCache):  # type: ignore[misc] # numba has no types
    """Compiled code on disk, loaded without the parts that only compilation needs.

    numba's own first loads all that its compiler knows of Python and numpy: 0.1 s, and 40 MB.
    """

    _impl_class = _MachineCode

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code of a signature, None where it is not there."""
        with undetected():
            return self._load_overload(sig, target_context)


class Kernel(_Dispatcher):  # type: ignore[misc] # numba has no types
    """A compiled function: complete for Python and as a function pointer, inner for kernels."""

    _make_cache: Callable[[Any], Cache] | None = None

    def keep_in(self, make_cache: Callable[[Any], Cache]) -> None:
        """Keep the code on disk; most kernels are only taken in by others, and never ask for it."""
        self._make_cache = make_cache

    @cached_property
    def _inner(self) -> _InnerFlavour:
        """The flavour for kernels: who only loads compiled code makes none."""
        return _InnerFlavour(self.py_func, targetoptions=self.targetoptions)

    def compile(self, sig: Any) -> Any:
        """Load a signature's code from the cache or compile it, in one process at a time."""
        if self._make_cache is not None:
            self._cache, self._make_cache = self._make_cache(self.py_func), None
        args, _ = _normalized(sig)
        if tuple(args) in self.overloads or self._cache.cache_path is None:
            return super().compile(sig)
        code = self.py_func.__code__
        name = f"{code.co_name}-{code.co_firstlineno}.lock"
        with only_process(Path(self._cache.cache_path) / name):
            return super().compile(sig)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return how a kernel calls this one."""
        return self._inner.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """Return a kernel's key of a signature's code."""
        return self._inner.get_overload(sig)
