"""The peers, one file each; every module here that defines ``PEER`` takes part."""

from __future__ import annotations

import importlib
import pkgutil

from harness.protocol import Peer


def all_peers() -> dict[str, Peer]:
    """Every peer by name, whether or not it can run here."""
    modules = (importlib.import_module(f"solvers.{m.name}") for m in pkgutil.iter_modules(__path__))
    peers: list[Peer] = [module.PEER for module in modules if hasattr(module, "PEER")]
    return {peer.name: peer for peer in peers}
