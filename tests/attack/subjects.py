"""Every public function, class and method of adaptsize, found by walking the package."""

import importlib
import inspect
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, NamedTuple

import adaptsize as ads

#: Why some are not called, and which.
_REASONS = {
    "changes the process for all later cases": "register_backend",
    "a protocol, a type, a base class or a result": ("Backend Background"),
    "called by functions that have checked the arguments": (
        "supports solve iterate on_whole split of once lower_sizes refuse_surfaces rows "
        "corners middle segments extended after"
    ),
    "needs another package": (
        "from_object like plot to_dolfinx to_gmsh to_meshio to_mfem to_netgen to_pyvista to_skfem "
        "to_trimesh"
    ),
}
LEFT_OUT = {name for names in _REASONS.values() for name in names.split()}


class Subject(NamedTuple):
    """Something to call."""

    name: str
    owner: str
    """The class of a method, else empty."""
    call: Callable[..., Any]
    parameters: dict[str, inspect.Parameter]
    """Without ``self``."""
    annotations: dict[str, str]

    @classmethod
    def of(cls, name: str, call: Callable[..., Any], owner: str = "") -> "Subject":
        found = inspect.signature(call).parameters
        # Without ``**options``, which have no name of their own.
        parameters = {key: p for key, p in found.items() if p.kind is not p.VAR_KEYWORD}
        if owner:
            parameters.pop("self")
        return cls(name, owner, call, parameters, {k: _text(p) for k, p in parameters.items()})


def _text(parameter: inspect.Parameter) -> str:
    annotation = parameter.annotation
    if hasattr(annotation, "__metadata__"):  # of an option: what is annotated
        annotation = annotation.__origin__
    if not isinstance(annotation, str):
        annotation = inspect.formatannotation(annotation).replace("typing.", "")
    return annotation.strip("'\"")


@cache
def subjects() -> list[Subject]:
    """Return all public callables, sorted by name."""
    found: dict[str, Subject] = {}
    for home in ("", *ads._SUBMODULES):
        module = importlib.import_module(f"adaptsize.{home}".rstrip("."))
        for name in getattr(module, "__all__", ()):
            thing = getattr(module, name)
            if name in LEFT_OUT or home in ("typing", "errors") or not callable(thing):
                continue
            # A function of a submodule may have the name of one of the package.
            shared = home and name in ads.__all__ and thing is not getattr(ads, name)
            for subject in _of(f"{home}.{name}" if shared else name, thing):
                found[subject.name] = subject
    return [found[name] for name in sorted(found)]


def _of(name: str, thing: Any) -> Iterator[Subject]:
    if not inspect.isclass(thing):
        yield Subject.of(name, thing)
        if hasattr(thing, "with_info"):
            yield Subject.of(f"{name}.with_info", thing.with_info)
        return
    if _is_record(thing):
        return
    yield Subject.of(name, thing)
    for method, raw in _methods_of(thing):
        is_public = not method.startswith("_") or method == "__call__"
        if not is_public or method in LEFT_OUT:
            continue
        if isinstance(raw, classmethod | staticmethod):
            yield Subject.of(f"{name}.{method}", getattr(thing, method))
        elif inspect.isfunction(raw):
            yield Subject.of(f"{name}.{method}", raw, owner=name)


def _methods_of(thing: type) -> Iterator[tuple[str, Any]]:
    """Return the methods of a class, and those of groups of methods that it inherits."""
    groups = [base for base in thing.__mro__ if ".methods." in base.__module__]
    for owner in (thing, *groups):
        yield from vars(owner).items()


def _is_record(thing: type) -> bool:
    """Return whether a class holds results only: a plain dataclass or a named tuple."""
    if issubclass(thing, tuple):
        return True
    parameters = getattr(thing, "__dataclass_params__", None)
    if parameters is None or hasattr(thing, "__post_init__"):
        return False
    return bool(thing.__init__.__code__.co_filename == "<string>")  # written by dataclass
