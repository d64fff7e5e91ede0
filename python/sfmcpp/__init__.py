"""Bundle adjustment, structure from motion and multi-sensor SLAM: a Python package with a C++ core."""

from importlib import import_module
from threading import RLock
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sfmcpp import ba as ba
    from sfmcpp import doctor as doctor
    from sfmcpp import errors as errors
    from sfmcpp import geometry as geometry
    from sfmcpp import map as map
    from sfmcpp import model as model
    from sfmcpp import sensors as sensors
    from sfmcpp import sfm as sfm
    from sfmcpp import slam as slam
    from sfmcpp import sources as sources
    from sfmcpp import study as study
    from sfmcpp import weighting as weighting
    from sfmcpp._public import *  # noqa: F403
    from sfmcpp._public import __all__ as __all__
else:
    import os

    # Loaded when first used, so that a command heeds Ctrl-C before, not after, half a second of imports.
    _PARTS = ("ba", "doctor", "errors", "geometry", "map", "model")
    _PARTS += ("sensors", "sfm", "slam", "sources", "study", "weighting")

    # One thread at a time: two that begin at different ends would each wait for modules that the other loads,
    # and Python then gives out modules that are half loaded. The core needs none, and they ask for it.
    _LOADING = RLock()
    # A child has no other threads: what one of them was loading would stay half loaded, and the lock closed.
    if hasattr(os, "register_at_fork"):
        _ends = {"after_in_parent": _LOADING.release, "after_in_child": _LOADING.release}
        os.register_at_fork(before=_LOADING.acquire, **_ends)

    def __getattr__(name: str) -> Any:
        if name == "_core":
            return import_module(f"{__name__}.{name}")
        with _LOADING:
            return _loaded(name)

    def _loaded(name: str) -> Any:
        if name in _PARTS:
            return import_module(f"{__name__}.{name}")
        if not name.startswith("_") or name in ("__all__", "__version__"):
            public = import_module(f"{__name__}._public")
            globals().update({each: getattr(public, each) for each in ("__all__", *public.__all__)})
        if name in globals():
            return globals()[name]
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name)

    def __dir__() -> list[str]:
        of_modules = (name for name in globals() if name.startswith("__"))
        return sorted({*of_modules, *_PARTS, *__getattr__("__all__")})
