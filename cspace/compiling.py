"""Compiled functions: how they are made, kept between runs, and how a person hears that one is being compiled."""

from __future__ import annotations

import gc
import inspect
import logging
import os
import stat
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final, TypeGuard, TypeVar, cast, overload

F = TypeVar("F", bound=Callable[..., Any])

LOGGER: Final = logging.getLogger("cspace.compiling")
"""Says at INFO, once for each module of compiled functions, that one of it is being compiled.

A program that shows progress adds a handler of its own; this module is quick to import."""

_PARTS: Final[dict[str, list[FunctionType]]] = {}
"""What is decorated by :func:`part`, by its name."""

_WAITING: Final[list[FunctionType]] = []
"""Those of it that numba does not know of yet."""

NEEDLESS: Final = {"InlineClosureLikes", "InlineInlinables", "InlineOverloads", "NopythonRewrites"}
"""Names of numba's passes that find nothing in a :func:`reader`."""


class _Clock:
    """Seconds, as :func:`time.perf_counter`, that stand still while a function is compiled and put into the cache.

    Who is given a time limit goes by them. While one function is compiled another one may be, but by one thread alone.
    """

    def __init__(self) -> None:
        self._stood: tuple[float, float | None] = 0.0, None  # for how long, and since when again

    def __call__(self) -> float:
        before, since = self._stood
        return (time.perf_counter() if since is None else since) - before

    def stop(self) -> bool:
        """Stand still from now on; False where it does already."""
        before, since = self._stood
        if since is None:
            self._stood = before, time.perf_counter()
        return since is None

    def go_on(self) -> None:
        before, since = self._stood
        if since is not None:
            self._stood = before + time.perf_counter() - since, None


clock: Final = _Clock()


@overload
def jit(function: F, /, **options: Any) -> F: ...
@overload
def jit(function: None = None, /, **options: Any) -> Callable[[F], F]: ...
def jit(function: F | None = None, /, **options: Any) -> Any:
    """A function compiled by numba at its first call, which lets other threads run meanwhile.

    What was compiled is kept on disk, beside the module or in the user's cache folder, or where ``NUMBA_CACHE_DIR``
    says: in the first of them that may be written, and that nobody else may write to (:func:`is_own`), for what is
    kept is run. Where there is none, it is compiled again in each run. Options are those of ``numba.njit``. If left
    out, ``cache`` and ``nogil`` are True, and division by zero gives infinity or NaN, of whole numbers 0: what has
    the same options is compiled sooner, as numba types its parts once for each.
    """
    if function is None:
        return lambda decorated: jit(decorated, **options)
    from numba import njit

    _announce_compiling()
    _add_parts()
    options = {"cache": True, "nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy", **options}
    cached = options.pop("cache")
    made = njit(**options)(function)
    if cached:
        try:
            made._cache = _cache_class()(function)
        except RuntimeError:  # numba found no folder that it may write to
            return made
    return made


@cache
def _cache_class() -> Any:
    """Numba's cache, which looks at a function's own file alone, with an eye on all that its code is made from.

    Else a function would go on with what another one, in a file that has changed since, was. Folders that others write
    to are passed by, and what a file holds is used only if it is what was looked for: of two processes that save at
    once, each may leave its own index beside the other's code.
    """
    from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
    from numba.core.runtime.nrt import rtsys
    from numba.core.sigutils import normalize_signature

    class Own:
        def ensure_cache_path(self) -> None:
            super().ensure_cache_path()  # type: ignore[misc]
            if not is_own(Path(self.get_cache_path())):  # type: ignore[attr-defined]
                raise PermissionError

    class Places(CompileResultCacheImpl):
        _locator_classes = [  # noqa: RUF012
            cast(type[object], type(each.__name__, (Own, each), {})) for each in CompileResultCacheImpl._locator_classes
        ]

    class File(IndexDataCacheFile):
        sources: Sequence[tuple[str, str]] = ()

        def load(self, key: Any) -> Any:
            with suppress(Exception):  # a file that is damaged holds nothing
                stamp, cached_key, code = super().load(key)  # type: ignore[no-untyped-call]
                return code if (stamp, cached_key) == (self.sources, key) else None

        def save(self, key: Any, code: Any) -> None:
            with suppress(OSError):  # a full disk
                super().save(key, (self.sources, key, code))  # type: ignore[no-untyped-call]

        def _load_index(self) -> Any:
            with suppress(Exception):
                return super()._load_index()  # type: ignore[no-untyped-call]
            return {}

    class Cache(FunctionCache):
        _impl_class = Places

        def __init__(self, function: Callable[..., Any]) -> None:
            super().__init__(function)  # type: ignore[no-untyped-call]
            stamp = _stamp(function.__code__.co_filename)
            self._cache_file = File(self._cache_path, self._impl.filename_base, stamp)  # type: ignore[no-untyped-call]

        def load_overload(self, signature: Any, target: Any) -> Any:
            if not self._look_around(signature):
                return None
            # Numba would first import all that it could compile, which takes longer than all that is read here.
            rtsys.initialize(target)
            return self._load_overload(signature, target)  # type: ignore[no-untyped-call]

        def save_overload(self, signature: Any, compiled: Any) -> None:
            _refuse_recursion(self._py_func.__qualname__, compiled.library)
            stopped = clock.stop()
            try:
                if self._look_around(signature):
                    super().save_overload(signature, compiled)  # type: ignore[no-untyped-call]
            except OSError:  # a folder that has gone
                pass
            finally:
                if stopped:
                    clock.go_on()

        def _look_around(self, signature: Any) -> bool:
            """Note what code is made from; False where that is not ours alone."""
            sources: set[tuple[str, str]] = set()
            records = _records(normalize_signature(signature)[0])  # type: ignore[no-untyped-call]
            _add_sources(self._py_func, sources, set(), records)
            self._cache_file.sources = sorted(sources)  # type: ignore[attr-defined]
            return all(_is_ours(record.__module__) for record in records)

    return Cache


def _refuse_recursion(name: str, library: Any) -> None:
    """Refuse what comes to call itself, by another function or with other types: read from a file, numba's is a crash.

    Of a call that it could not link, numba leaves a place in the code, and fills it in only when it compiles.
    """
    module = getattr(library, "_final_module", None)
    if module is not None and any(each.name.startswith(".numba.unresolved$") for each in module.global_variables):
        message = f"{name} calls itself, by another function or with other types: write a loop"
        raise NotImplementedError(message)


@cache
def is_own(folder: Path) -> bool:
    """Whether what a folder holds was put there by the user alone.

    It must be the user's, and neither others nor a group that is not the user's own may write to it, nor to a folder
    that it lies in, but where that is sticky, like ``/tmp``. On Windows nothing is checked: the folders of a user are
    closed to others there.
    """
    if sys.platform == "win32":
        return True
    import grp
    import pwd

    own = {0}
    with suppress(KeyError):  # a user or a group without a name
        user = pwd.getpwuid(os.geteuid())
        if grp.getgrgid(user.pw_gid).gr_name == user.pw_name:
            own.add(user.pw_gid)
    folder = folder.resolve()
    places = [(place, place.stat()) for place in (folder, *folder.parents)]
    theirs = [place for place, about in places[:1] if about.st_uid != os.geteuid()]
    for place, about in places:
        others = stat.S_IWOTH if about.st_gid in own else stat.S_IWOTH | stat.S_IWGRP
        if about.st_mode & others and (place == folder or not about.st_mode & stat.S_ISVTX):
            theirs.append(place)
    if theirs:
        LOGGER.info("what is compiled is not cached in %s: others may write to %s", folder, theirs[0])
    return not theirs


def _records(types: Iterable[Any]) -> set[type]:
    """Classes of the records among arguments of these types, and of those that they hold."""
    waiting, records = list(types), set[type]()
    while waiting:
        each = waiting.pop()
        records.update([each.instance_class] if hasattr(each, "instance_class") else [])
        waiting.extend(getattr(each, "types", ()))
    return records


def _is_ours(module: str) -> bool:
    return module.startswith(("cspace.", "planners."))


def _add_sources(
    function: Callable[..., Any], sources: set[tuple[str, str]], seen: set[object], records: set[type]
) -> None:
    """Add what the machine code of a function is made from: files with their stamps, constants with their values.

    Its arguments are or hold records of some classes.
    """
    seen.add(function)
    sources.add((function.__module__, _stamp(function.__code__.co_filename)))
    names, codes = set[str](), [function.__code__]
    while codes:
        code = codes.pop()
        names.update(code.co_names)
        codes += [each for each in code.co_consts if isinstance(each, CodeType)]
    values = [(name, function.__globals__[name]) for name in names if name in function.__globals__]
    modules = [value for _, value in values if isinstance(value, ModuleType)]
    values += [(name, getattr(module, name)) for module in modules for name in names if hasattr(module, name)]
    values += [(name, getattr(record, name)) for name in names for record in records if hasattr(record, name)]
    for name, value in values:
        if isinstance(value, bool | int | float | str | tuple):
            sources.add((name, repr(value)))
            continue
        home = sys.modules.get(str(getattr(value, "__module__", "")))
        if home is None or not _is_ours(home.__name__):
            continue
        sources.add((home.__name__, _stamp(str(home.__file__))))
        # A function that is not compiled itself stands for overloads, which are with it.
        others = [value] if hasattr(value, "py_func") or _is_part(value) else vars(home).values()
        for other in others:
            inner = other if _is_part(other) else getattr(other, "py_func", None)
            if inner is not None and inner not in seen:
                _add_sources(inner, sources, seen, records)


def _is_part(value: object) -> TypeGuard[FunctionType]:
    return isinstance(value, FunctionType) and value in _PARTS.get(value.__name__, ())


@cache
def _stamp(path: str) -> str:
    stat = Path(path).stat()
    return f"{stat.st_mtime_ns} {stat.st_size}"


@overload
def reader(function: F, /) -> F: ...
@overload
def reader(**options: Any) -> Callable[[F], F]: ...
def reader(function: F | None = None, /, **options: Any) -> Any:
    """:func:`jit` for what only reads and writes the arrays that it is given, and makes none.

    Numba then counts no references, which from Python takes 30 ns an array, and in inner loops as long as the work.
    """
    return jit(function, _nrt=False, pipeline_class=_lean_compiler(), **options)


@overload
def inner(function: F, /) -> F: ...
@overload
def inner(**options: Any) -> Callable[[F], F]: ...
def inner(function: F | None = None, /, **options: Any) -> Any:
    """:func:`reader` for what only compiled code calls; without a door for Python it is compiled sooner.

    What makes arrays says ``_nrt=True``, and has loops for what it does to them.
    """
    if function is None:
        return lambda decorated: inner(decorated, **options)
    made = cast(Any, jit(function, **{"_nrt": False, **part_options(options.pop("forceinline", False)), **options}))

    def add(compiled: Any) -> None:
        made.overloads[tuple(compiled.signature.args)] = compiled

    def refuse(*arguments: object, **named: object) -> None:
        raise TypeError(f"{made.__name__} is called by compiled code alone: decorate it with reader")

    # Numba itself would let Python in, where nothing is.
    made.add_overload, made._compile_for_args = add, refuse
    return made


@cache
def _lean_compiler() -> Any:
    """Numba's compiler with :func:`_lean_pipeline`."""
    from numba.core.compiler import CompilerBase

    libraries = _libraries()

    class LeanCompiler(CompilerBase):
        def define_pipelines(self) -> list[Any]:
            if libraries:
                _set_library(self.state, libraries[0])
            return [_lean_pipeline(self.state)]

    return LeanCompiler


def _lean_pipeline(state: Any) -> Any:
    """Numba's passes without those that look for what no :func:`reader` has.

    They look for functions within functions, for those that are to be inlined as Python, and for arithmetic of whole
    arrays, which makes arrays; and each reads all of a function for it.
    """
    from numba.core.compiler import DefaultPassBuilder

    pipeline: Any = DefaultPassBuilder.define_nopython_pipeline(state)  # type: ignore[no-untyped-call]
    pipeline.passes = [each for each in pipeline.passes if each[0].__name__ not in NEEDLESS]
    pipeline.finalize()
    return pipeline


@cache
def part_options(forceinline: bool) -> dict[str, Any]:
    """What numba is told of a function that becomes a part of others; nothing of its own where that has changed within.

    Numba types and makes ``min`` and such anew for callers of each set of options; so options of parts are set behind
    its back, and they share them with others.
    """
    from numba.core.compiler import CompilerBase

    options = {"no_cpython_wrapper": True, "forceinline": forceinline}
    libraries = _libraries()
    if libraries is None:
        return options
    library = libraries[1]

    class PartCompiler(CompilerBase):
        def define_pipelines(self) -> list[Any]:
            for name, value in options.items():
                setattr(self.state.flags, name, value)
            _set_library(self.state, library)
            return [_lean_pipeline(self.state)]

    return {"pipeline_class": PartCompiler}


def _set_library(state: Any, kind: Any) -> None:
    """Have numba put the code of what it compiles in a library of ours."""
    state.library = kind(state.targetctx.codegen(), state.func_id.func_qualname)
    state.library.enable_object_caching()


@cache
def _libraries() -> tuple[Any, Any] | None:
    """Numba's library of the code of a function, for a whole and for a part of others; None if numba changed within.

    Numba has LLVM optimise each function alone, then with all that it calls for size, for the sake of references, and
    then again for speed; and it makes machine code of it. It does so for what is called as well, all the way up. Of a
    :func:`reader`, only the third time counts, and of parts the first.
    """
    try:
        from llvmlite.binding import Target, parse_assembly
        from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary, JITCPUCodegen
    except ImportError:
        return None
    used = {
        CPUCodeLibrary: ("_optimize_functions", "_optimize_final_module"),
        JITCodeLibrary: ("_finalize_final_module", "_finalize_dynamic_globals"),
        JITCPUCodegen: ("_add_module", "_create_empty_module", "_module_pass_manager"),
    }
    if not all(hasattr(kind, name) for kind, names in used.items() for name in names):
        return None

    class Whole(JITCodeLibrary):
        def _optimize_functions(self, module: Any) -> None:
            module.data_layout = self._codegen._data_layout

        def _optimize_final_module(self) -> None:
            codegen: Any = self._codegen
            passes, builder = codegen._module_pass_manager()
            passes.run(self._final_module, builder)

    class Part(JITCodeLibrary):
        def _optimize_final_module(self) -> None:
            pass

        def _finalize_final_module(self) -> None:
            _refuse_recursion(self.name, self)
            # Machine code is left out as well, but for places that numba fills in at once.
            self._codegen._add_module(self._places())  # type: ignore[no-untyped-call]
            self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
            self._finalized = True

        def serialize_using_object_code(self) -> Any:
            # Nor is any made where a part is read from the cache: callers would take theirs from it, which is slow.
            machine: Any = Target.from_default_triple().create_target_machine(codemodel="jitdefault", jit=True)
            whole: Any = self._get_module_for_linking()  # type: ignore[no-untyped-call]
            return self.name, "object", (machine.emit_object(self._places()), whole.as_bitcode())

        def _places(self) -> Any:
            codegen: Any = self._codegen
            variables: Any = self._final_module.global_variables
            names = [each.name for each in variables if each.name.startswith("_ZN08NumbaEnv")]
            places = [f'@"{name}" = common global i8* null' for name in names]
            return parse_assembly("\n".join([str(codegen._create_empty_module("")), *places]))

    return Whole, Part


def by_kind(function: Callable[..., Any], made: dict[type, Callable[..., Any]]) -> None:
    """Have compiled code that calls a function take one of several for it, by the kind of the first argument.

    Kinds are classes of records, or ``numpy.ndarray``. Only the one that is taken is compiled, and into its caller.
    """
    import numpy as np
    from numba import types
    from numba.extending import overload

    options: Any = {"error_model": "numpy", "no_cfunc_wrapper": True, "nogil": True, "_nrt": False}
    options |= part_options(forceinline=True)

    @overload(function, jit_options=options, strict=False)
    def taken(first: Any, *others: Any) -> Any:
        return made.get(np.ndarray if isinstance(first, types.Array) else getattr(first, "instance_class", object))


def part(plain: F) -> F:
    """Have compiled code call a plain function, or the methods of records of a class, and compile them into itself.

    What is decorated stays as it is, and its module is quick to import. The methods that several classes have by the
    same name take as many arguments in each.
    """
    new = [plain] if isinstance(plain, FunctionType) else [each for each in vars(plain).values() if _is_method(each)]
    for function in new:
        _PARTS.setdefault(function.__name__, []).append(function)
    _WAITING.extend(new)
    if _announce_compiling.cache_info().currsize:
        _add_parts()
    return plain


def _is_method(member: object) -> TypeGuard[FunctionType]:
    return isinstance(member, FunctionType) and not member.__name__.startswith("_")


def _add_parts() -> None:
    """Let numba know of what waits for it."""
    from numba import types
    from numba.core.typing import templates
    from numba.extending import overload

    options: Any = {"error_model": "numpy", "no_cfunc_wrapper": True, "nogil": True}
    for part in _WAITING:
        taken = _taken(part)
        if "." not in part.__qualname__:
            own: Any = {**options, **part_options(forceinline=False), "_nrt": False}
            overload(part, jit_options=own, strict=False)(taken)
        elif part is _PARTS[part.__name__][0]:
            own = {**options, **part_options(forceinline=True)}
            overload(taken, jit_options=own, strict=False)(taken)
            make: Any = templates.make_overload_method_template
            template = make(types.BaseNamedTuple, part.__name__, taken, inline="never", jit_options=own)
            cast(Any, templates.infer_getattr)(_of_own(template))
    _WAITING.clear()


def _of_own(template: Any) -> Any:
    """Numba's template of a method, for records that have it; those of others may have a field of that name."""

    class Own(template):  # type: ignore[misc]
        def _resolve(self, record: Any, name: str) -> Any:
            return super()._resolve(record, name) if _is_part(getattr(record.instance_class, name, None)) else None

    return Own


def _taken(part: FunctionType) -> Callable[..., Any]:
    """What gives numba a part for the types of its arguments; of a method, that of the record's own class."""

    def taken(*arguments: Any) -> Any:
        return getattr(arguments[0].instance_class, part.__name__) if "." in part.__qualname__ else part

    taken.__signature__ = inspect.signature(part)  # type: ignore[attr-defined]
    return taken


def entry(kernel: Any, fixed: tuple[Any, ...], floats: int) -> Callable[..., Any]:
    """A kernel with its first arguments given and some floats to come, without numba's dispatch on every call."""
    import numba

    types = (*map(numba.typeof, fixed), *[numba.float64] * floats)
    kernel.compile(types)
    return partial(kernel.get_overload(types), *fixed)


def row_entry(kernel: Any, fixed: Any, floats: int) -> Callable[[tuple[float, ...]], Any]:
    """As :func:`entry`, of one argument and the floats to come in a tuple."""
    return partial(entry(kernel, (fixed, (0.0,) * floats), 0).func, fixed)  # type: ignore[attr-defined]


def _remembering(usual: Callable[..., Any]) -> Callable[..., Any]:
    """Numba's typing of calls, which remembers what came of calls of numba's own functions for some types.

    Numba itself tries all that a function could mean at each call: of ``a + b``, two dozen, and first what it means for
    arrays. What stands for overloads depends on the options of who calls, and is not remembered.
    """
    known: dict[Any, Any] = {}

    def get_call_type(self: Any, context: Any, arguments: Any, named: Any) -> Any:
        key = self, context, tuple(arguments)
        signature = None if named else known.get(key)
        if signature is None:
            signature = usual(self, context, arguments, named)
            if not named and self.get_impl_key(signature) is self.typing_key:
                known[key] = signature
        return signature

    return get_call_type


@cache
def _announce_compiling() -> None:
    """Have numba tell when it compiles; what it reads from its cache does not count.

    Meanwhile the :data:`clock` stands still, and garbage is left lying: looking for it among all that numba makes takes
    a tenth of the time. What calls give is remembered (:func:`_remembering`). And nobody hears when LLVM is locked and
    free again, tens of thousands of times, which takes a twentieth.
    """
    from llvmlite.binding import ffi
    from numba.core import event
    from numba.core.types.functions import BaseFunction

    usual = BaseFunction.get_call_type
    remembering = _remembering(usual)
    lock: Any = getattr(ffi.lib, "_lock", None)
    quietable = hasattr(lock, "_lock") and hasattr(lock, "_cblist")

    def hear(listeners: list[Any]) -> list[Any]:
        """Set who hears of LLVM's lock, while nobody has it; return who did."""
        if not quietable:
            return []
        with lock._lock:
            before, lock._cblist = lock._cblist, listeners
        return cast(list[Any], before)

    class Announcer(event.Listener):
        def __init__(self) -> None:
            self.announced: set[str] = set()
            self.paused: list[bool] = []
            self.listeners: list[Any] = []

        def on_start(self, event: Any) -> None:
            module = str(event.data["dispatcher"].py_func.__module__)
            own = _is_ours(module)
            if own and module not in self.announced:
                self.announced.add(module)
                LOGGER.info("compiling %s, once per machine", module)
            # One function is compiled while another one is.
            if not self.paused:
                clock.stop()
                self.listeners = hear([]) if own else []
            self.paused.append(own and gc.isenabled())
            if own:
                gc.disable()
                BaseFunction.get_call_type = remembering  # type: ignore[method-assign]

        def on_end(self, event: Any) -> None:
            if self.paused.pop():
                gc.enable()
            if not self.paused:
                BaseFunction.get_call_type = usual  # type: ignore[method-assign]
                hear(self.listeners + hear([]))
                clock.go_on()

    event.register("numba:compile", Announcer())  # type: ignore[no-untyped-call]
