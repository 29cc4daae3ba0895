"""LLVM's text of an entry and of all that it calls, optimised once.

numba optimises each function by itself and makes machine code of it, since Python may call it, and
optimises it again in each caller. Of kernels nothing but entries is ever called: here numba stops
at the text as it is written, and LLVM's passes run once, over the whole. Both give the same bits,
since neither may change the order or the rounding of an operation; it takes about half the time.

For that time some of numba's own methods are replaced. A version of numba that does not have them
compiles as it always does.
"""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Callable, Iterator
from typing import Any

#: numba's methods that are replaced, by class: what is optimised, and what makes code ready to run.
_LIBRARY = (
    "_optimize_functions", "_optimize_final_module", "_finalize_specific",
    "get_pointer_to_function",
)  # fmt: skip
_CODE = ("_add_module", "set_env")


@contextlib.contextmanager
def collecting_nothing() -> Iterator[None]:
    """Leave what has cycles where it is: numba makes much of it, and uses all of it."""
    on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if on:
            gc.enable()


@contextlib.contextmanager
def compiled_as_text() -> Iterator[Callable[[Any, str, str], Any]]:
    """Have numba stop at LLVM's text; yield what makes a module of it.

    Called with what numba's ``cfunc`` returns, LLVM's text of it and the name of its entry, that
    returns a module of LLVM, in which nothing but the entry can be called.
    """
    import llvmlite.binding as llvm
    from numba.core import codegen
    from numba.core.compiler_lock import global_compiler_lock

    library, code = codegen.JITCodeLibrary, codegen.JITCPUCodegen
    methods = [(library, name) for name in _LIBRARY] + [(code, name) for name in _CODE]
    if not all(callable(getattr(kind, name, None)) for kind, name in methods):
        yield lambda compiled, text, entry: llvm.parse_assembly(text)
        return
    optimise = library._optimize_final_module

    def whole(compiled: Any, text: str, entry: str) -> Any:
        found = llvm.parse_assembly(text)
        for function in found.functions:
            if not function.is_declaration and function.name != entry:
                function.linkage = "internal"
        owner = compiled._library
        owner._final_module = found
        optimise(owner)
        return owner._final_module

    def laid_out(owner: Any, module: Any) -> None:
        module.data_layout = owner._codegen._data_layout

    def nowhere(owner: Any, name: str) -> int:
        owner._ensure_finalized()
        return 0

    def unless_inlined(owner: Any) -> None:
        own = [
            f
            for f in owner._final_module.functions
            if not f.is_declaration and f.linkage == llvm.Linkage.external
        ]
        if not any(b"alwaysinline" in a for f in own for a in f.attributes):
            optimise(owner)

    instead: dict[str, Callable[..., Any]] = {
        "_optimize_functions": laid_out, "get_pointer_to_function": nowhere,
        "_optimize_final_module": unless_inlined,
    }  # fmt: skip
    with global_compiler_lock, contextlib.ExitStack() as stack:  # no other thread compiles
        for kind, name in methods:
            if name in vars(kind):
                stack.callback(setattr, kind, name, vars(kind)[name])
            else:
                stack.callback(delattr, kind, name)
            setattr(kind, name, instead.get(name, _without_effect))
        yield whole


def _without_effect(*_: Any) -> None:
    pass
